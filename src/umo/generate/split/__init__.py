"""Parts of a machine that run on controllers: the link between host and controller, and the part as the host has it."""
