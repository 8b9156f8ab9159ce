"""`python -m umo_command`."""

from umo_command import main

main()
