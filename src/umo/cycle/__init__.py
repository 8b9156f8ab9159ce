"""The cycle: the process image, the sampling period, connecting and leaving."""
