"""`umo show`: what runs, and how it is doing."""
