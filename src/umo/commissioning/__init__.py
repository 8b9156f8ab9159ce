"""The work before a machine goes into service: measuring the timing of a computer (`commissioning.latency`) and tuning
control laws (`commissioning.tuning`). The laws themselves are in `umo.control`."""
