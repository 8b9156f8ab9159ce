"""`umo tune`: the numbers of a machine, its gains and its recipes."""
