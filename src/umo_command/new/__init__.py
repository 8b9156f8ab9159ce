"""`umo new`: writes files with which a user continues."""
