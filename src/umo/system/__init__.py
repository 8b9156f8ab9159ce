"""What the operating system offers: priorities, locks, counters, folders, clocks. Nothing here knows machines."""
