"""`python -m umo.process FD`: a guardian; started by `umo.process.start` alone."""

import sys

from umo.process.guardian import main

sys.exit(main(int(sys.argv[1])))
