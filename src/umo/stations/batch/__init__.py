"""A batch plant: two reactors that share a scale (docs/batch.md)."""
