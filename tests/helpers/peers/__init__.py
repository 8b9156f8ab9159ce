"""Devices on the other end of a line: independent counterparts, and devices that misbehave."""
