"""Clients: commands from outside a running machine, a capability of it (`umo.cycle.capability`)."""
