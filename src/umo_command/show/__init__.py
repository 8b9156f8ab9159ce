"""`umo show`: shows the running stations and their state."""
