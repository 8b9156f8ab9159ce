"""Services of the operating system: scheduling, counters, folders, the holding of devices."""
