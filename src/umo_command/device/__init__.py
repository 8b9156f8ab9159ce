"""`umo device`: devices and drivers, tried by hand."""
