"""The page: running stations in a browser, served by a process of its own from the frames (`umo show page`)."""
