"""`umo check`: the mistakes of a station, found without hardware."""
