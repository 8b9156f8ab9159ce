"""`umo connect`: other protocols and other computers."""
