"""`umo device`: tries devices and drivers by hand."""
