"""Access to the operating system: priorities, locks, counters, folders, clocks. This package does not depend on
machines."""
