"""Prints the form as C, together with the other files. Only this package writes C."""
