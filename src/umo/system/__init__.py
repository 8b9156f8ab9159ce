"""Access to the operating system: priorities, locks, counters, folders, clocks. This package has nothing to do with
machines."""
