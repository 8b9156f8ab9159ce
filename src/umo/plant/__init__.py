"""A station's plant as Modbus boxes: a process of its own that serves it in wall-clock time (`umo plant`)."""
