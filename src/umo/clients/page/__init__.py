"""The page: it shows running stations in a browser. A separate process reads the frames and serves the page (`umo show
page`)."""
