"""Chips with registers, whatever their bus: what the drivers `i2c` and `spi` have in common."""
