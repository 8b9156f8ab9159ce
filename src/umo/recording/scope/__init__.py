"""Samples of a run against time: kept, reduced to pixels, measured, and drawn for notebooks."""
