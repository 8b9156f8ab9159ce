"""Chips with registers on any bus: the common part of the drivers `i2c` and `spi`."""
