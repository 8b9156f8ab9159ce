"""`umo recording`: recordings, runs and the history of a fleet."""
