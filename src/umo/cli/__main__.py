"""`python -m umo.cli`: the command `umo`, by the Python that has it."""

from umo.cli import main

main()
