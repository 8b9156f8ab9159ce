"""Kills and faults against a box that knows nothing of umo: `python -m bench --kills`.

`box.c` is the box, `station/` the machine, `run.py` starts it as a user would, `strikes.py` is what is done to it,
`kinds.py` the table of kinds with the status that each must end with, `campaign.py` tries them and counts.
"""
