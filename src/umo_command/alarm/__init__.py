"""`umo alarm`: the alarms of a station."""
