"""Commands that clients send to a running machine, as a capability of the machine (`umo.cycle.capability`)."""
