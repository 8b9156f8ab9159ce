"""What is found out of the form: what may change what, where statements lead, and what has no effect."""
