"""Commanding a running machine from outside: the queue of its commands, and `umo.attach`."""
