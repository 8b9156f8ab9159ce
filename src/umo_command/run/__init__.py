"""`umo run`: a run, the processes beside it, and the files that it leaves."""
