"""`python -m umo.process FD JOB NAME`: a guardian (`umo.process.start`). NAME is for lists of processes."""

import sys

from umo.process.guardian import main

sys.exit(main(int(sys.argv[1]), int(sys.argv[2])))
