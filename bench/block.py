"""One tree's side of `python -m bench --against`: measures blocks of the rows that the other process asks for.

Run by path with the Python of the tree to be measured and its root on PYTHONPATH, so `bench` and `umo` are that tree's.
It uses only what both trees have. It writes the names of its rows as one line of JSON, then one number for each name
that it reads: the median of the block, in the row's unit.
"""

from __future__ import annotations

import argparse
import gc
import json
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack
from functools import partial
from importlib import import_module
from statistics import median
from unittest.mock import patch

import numpy as np

import umo
from bench import figures, frames, scan, zones
from bench.live import folders
from bench.mix import SIZES

BLOCK = 0.3
"""Length of a block of periods in s."""
REAL_TIME = 10.0
"""Length of a block in real time in s."""


def rows(stack: ExitStack) -> dict[str, Callable[[], float]]:
    """The rows of `make bench` by name; each measures one block when it is called."""
    found: dict[str, Callable[[], float]] = {}
    for count in SIZES:
        for case in scan.make(count, stack):
            if case.row == "a":
                found[f"{count:,} objects: {case.work}, us"] = partial(_block, case)
    with _without_extension():
        for case in scan.make(13, stack):
            if case.row == "a":
                found[f"13 objects without the extension: {case.work}, us"] = partial(_block, case)
    for kind in zones.KINDS:
        on_vectors, _ = zones.make(zones.ZONES, kind, stack)
        found[f"1,000 zones under PI, {kind}, us"] = partial(_block, scan.Case(kind, 1000, "a", on_vectors.period))
    found |= {
        "a servo axis, us": lambda: figures.axis_period(4000)[1],
        "z-theta's control, us": lambda: figures.control_period(1)[1],
        "publishing a frame of 13 objects, us": lambda: frames.publishing(13, 20).alone[1],
        "publishing a frame of 10,000 objects, us": lambda: frames.publishing(10_000, 3).alone[1],
        "the look for commands, us": lambda: frames.looking(20)[0][1],
        "connecting 10,000 objects, s": lambda: figures.seconds_to_connect(repeats=1)[1],
        "import umo, s": _import,
        "z-theta in real time: waking up + execution, p50, us": _real_time,
    }
    return found


def _without_extension() -> AbstractContextManager[object]:
    """What is connected meanwhile does without the extension in C, of this tree or of one before the one image."""
    try:
        where = import_module("umo.cycle.conversion")
    except ImportError:
        where = import_module("umo.cycle.forms")
    return patch.object(where, "extension", None)


def _block(case: scan.Case) -> float:
    if case.periods == 1:
        case.calibrate()
    case.times.clear()
    until = time.perf_counter() + BLOCK
    while time.perf_counter() < until:
        case.once()
    return median(case.times)


def _import() -> float:
    start = time.perf_counter()
    subprocess.run([sys.executable, "-c", "import umo"], check=True)
    return time.perf_counter() - start


def _real_time() -> float:
    took = []
    with folders(), umo.start("ztheta", parts=1, realtime=True) as started:
        until = time.monotonic() + REAL_TIME
        while time.monotonic() < until and started.outcome is None:
            started.poll(0.05)
            if started.frames is not None:
                seen = started.frames.read()
                took.append((seen["wake"] + seen["execution"])[seen["missed"] == 0])
        started.stop()
    return float(np.median(np.concatenate(took))) * 1e-3


def main() -> None:
    argparse.ArgumentParser(description=__doc__).parse_args()
    with ExitStack() as stack:
        found = rows(stack)
        gc.collect()
        gc.freeze()
        gc.disable()
        print(json.dumps(list(found)), flush=True)
        for line in sys.stdin:
            print(found[json.loads(line)](), flush=True)
            gc.collect()


if __name__ == "__main__":
    main()
