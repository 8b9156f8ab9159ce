"""What umo costs: `make bench`, or `python -m bench` from the root of the repository."""
