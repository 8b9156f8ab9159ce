"""Tables of values over time: those of a fleet and of recordings, for Parquet, CSV, NumPy and xarray."""
