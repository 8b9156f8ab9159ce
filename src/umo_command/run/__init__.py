"""`umo run`: a run, what stands beside it, and what it leaves behind."""
