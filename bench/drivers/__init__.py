"""What a driver costs beside the bare library that does the same by hand: `python -m bench --drivers`.

One module for each driver, with one function, `cases(channels, stack)`, that yields its rows (case.py); table.py finds
the modules, runs the rows in turns and makes the table.
"""
