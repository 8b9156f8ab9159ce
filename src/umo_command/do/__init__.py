"""`umo do`: gives commands to a running station."""
