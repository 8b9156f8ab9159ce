"""Prints the form as C, with the files around it. C is written here only."""
