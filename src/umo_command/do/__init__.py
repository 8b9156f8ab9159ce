"""`umo do`: whatever a running station can be told."""
