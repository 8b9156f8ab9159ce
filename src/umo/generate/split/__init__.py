"""Parts of a machine that run on controllers: the link between host and controller, and the host's copy of the part."""
