"""`umo check`: finds the errors of a station without hardware."""
