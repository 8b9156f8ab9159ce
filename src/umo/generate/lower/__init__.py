"""Lowers the control code of a connected machine to the form. Each rule of Python's semantics is implemented here
once."""
