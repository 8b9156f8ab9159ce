"""A tunnel furnace of many zones (docs/furnace.md)."""
