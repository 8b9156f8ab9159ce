"""A program of a user's own that starts the machine: `python program.py STATION [OPTIONS]`.

    --periods N, --fork N, --loop N     as the station's application has them
    --leave LEAST MOST

It leaves the block at some moment from LEAST to MOST seconds after the machine has begun to run, else waits for the
machine's own end; its exit status is the outcome's.
"""

from __future__ import annotations

import argparse
import random
import sys
import time

import umo


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("station")
    for name in ("--periods", "--fork", "--loop"):
        parser.add_argument(name, type=int, default=0)
    parser.add_argument("--leave", type=float, nargs=2)
    options = parser.parse_args()
    chosen = {"periods": options.periods, "fork": options.fork, "loop": options.loop}
    started = umo.start(options.station, "box", **chosen, acknowledge=True)
    try:
        with started:
            if options.leave is None:
                started.wait()
            else:
                while started.pid is None and started.outcome is None:
                    started.poll(0.01)
                time.sleep(random.uniform(*options.leave))
    except umo.RunFailed as failed:
        print(failed, file=sys.stderr)
    assert started.outcome is not None
    return started.outcome.status


if __name__ == "__main__":
    sys.exit(main())
