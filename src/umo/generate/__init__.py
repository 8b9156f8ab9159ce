"""C from the declaration of a machine: `umo generate`."""
