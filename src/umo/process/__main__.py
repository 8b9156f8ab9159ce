"""`python -m umo.process FD JOB NAME`: run a guardian (`umo.process.start`). NAME appears in lists of processes."""

import sys

from umo.process.guardian import main

sys.exit(main(int(sys.argv[1]), int(sys.argv[2])))
