"""`umo new station`: what writes files that a user goes on with."""
