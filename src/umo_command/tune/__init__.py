"""`umo tune number`: the numbers of a machine, its gains and recipes."""
