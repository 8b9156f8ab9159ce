"""From a connected machine and its control code to the form: each rule of Python's meaning stands here once."""
