"""Rings of stations that do not exist, with sequences to check: `python -m bench.fleet.rings FOLDER NAME NUMBER`.

Each station has `OBJECTS` sensors, of which half change in every period of `PERIOD` s. Value k of frame n is that of
`value(n)`; so whoever has a frame knows what its values must be. The raw integer of the first object is the monotonic
time at which the frame was made, ns. SIGUSR1 puts the UTC clock of these stations one hour forward, SIGUSR2 back.
"""

from __future__ import annotations

import os
import signal
import sys
import time
from typing import Any

import numpy as np
import numpy.typing as npt

from umo.cycle.stage import Stage
from umo.process.frames.frame_server import FrameServer, new_path
from umo.process.frames.layout import Layout, Live
from umo.process.frames.memory import RunDescriptors
from umo.process.frames.ring_copy import RingCopy
from umo.system.utc import utc

OBJECTS = 60
PERIOD = 0.1
CLOCK_STEP = 3_600_000_000_000
"""ns."""


def value(number: int, objects: int = OBJECTS) -> npt.NDArray[np.float64]:
    """The values of a frame: the even objects change in each period, the odd ones every 50."""
    places = np.arange(objects)
    return np.where(places % 2 == 0, number * 1000.0 + places, number // 50 * 1000.0 + places)


def layout_of(station: str, objects: int = OBJECTS) -> Layout:
    about = {
        "station": station, "wiring": "made", "place": "", "devices": [], "pid": os.getpid(), "started": time.time(),
        "started_monotonic": time.monotonic_ns(), "period": PERIOD, "realtime": False,
    }  # fmt: skip
    described = tuple(
        {"path": f"cell.o{number:03d}", "kind": "digital", "unit": "mm", "minimum": -1e12, "maximum": 1e12}
        for number in range(objects)
    )
    return Layout(described, ("read", "write"), about)


class MadeRing:
    """One of them."""

    def __init__(self, station: str, objects: int = OBJECTS) -> None:
        layout = layout_of(station, objects)
        writer, readers = RunDescriptors.pair()
        self._ring = RingCopy(layout, writer)
        self._ring.live({Live.STATE: Stage.RUNNING})
        self._server = FrameServer(new_path(station), readers)
        self._server.listen()
        self._server.start()
        self._frame: Any = np.zeros(1, layout.dtype)
        self._objects, self.number = objects, 0
        self.clock_error = 0
        """Of its UTC, ns."""

    def step(self) -> None:
        """The next frame."""
        frame, now = self._frame, time.monotonic_ns()
        offset, error = utc()
        frame["number"], frame["time"], frame["began"] = self.number, self.number * PERIOD, now
        frame["utc"], frame["utc_error"] = offset + self.clock_error, error
        frame["execution"], frame["wake"] = 1000, 1000
        frame["values"] = value(self.number, self._objects)
        frame["raws"] = frame["values"]
        frame["raws"][0, 0] = now
        self._ring.frame(frame.tobytes())
        self.number += 1

    def close(self) -> None:
        self._server.close()
        self._ring.close()


def main(names: list[str]) -> None:
    """Write all of them until SIGTERM; each at its own moment within the period."""
    rings = [MadeRing(name) for name in names]
    ends: list[int] = []

    def step_clocks(number: int, _: object) -> None:
        for ring in rings:
            ring.clock_error += CLOCK_STEP if number == signal.SIGUSR1 else -CLOCK_STEP

    signal.signal(signal.SIGUSR1, step_clocks)
    signal.signal(signal.SIGUSR2, step_clocks)
    signal.signal(signal.SIGTERM, lambda number, _: ends.append(number))
    began, turn = time.monotonic(), 0
    while not ends:
        for place, ring in enumerate(rings):
            due = began + (turn + place / len(rings)) * PERIOD
            if (wait := due - time.monotonic()) > 0.002:
                time.sleep(wait)
            ring.step()
        turn += 1
    for ring in rings:
        ring.close()


if __name__ == "__main__":
    os.environ["UMO_FRAMES"] = sys.argv[1]
    main([f"{sys.argv[2]}{number:03d}" for number in range(int(sys.argv[3]))])
