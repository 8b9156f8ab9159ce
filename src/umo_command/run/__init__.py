"""`umo run`: carries out a run, with the processes that accompany it and the files that it writes."""
