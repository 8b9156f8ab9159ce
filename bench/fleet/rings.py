"""Rings of stations that do not exist, with sequences that can be checked: `python -m bench.fleet.rings FOLDER NUMBER`.

Each station has `OBJECTS` sensors, of which half change in every period of `PERIOD` s. Value k of frame n is
`value(n, k)`; so whoever has a frame knows what its values must be.
"""

from __future__ import annotations

import os
import sys
import time
from typing import Any

import numpy as np
import numpy.typing as npt

from umo.cycle.stage import Stage
from umo.frames.frame_server import FrameServer, new_path
from umo.frames.layout import Layout, Live
from umo.frames.memory import RunDescriptors
from umo.frames.ring_copy import RingCopy
from umo.system.utc import utc

OBJECTS = 60
PERIOD = 0.1


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

    def step(self) -> None:
        """The next frame."""
        frame, now = self._frame, time.monotonic_ns()
        offset, error = utc()
        frame["number"], frame["time"], frame["began"] = self.number, self.number * PERIOD, now
        frame["utc"], frame["utc_error"], frame["execution"], frame["wake"] = offset, error, 1000, 1000
        frame["values"] = value(self.number, self._objects)
        frame["raws"] = frame["values"]
        self._ring.frame(frame.tobytes())
        self.number += 1

    def close(self) -> None:
        self._server.close()
        self._ring.close()


def main(names: list[str]) -> None:
    """Write all of them until this process is ended; each at its own moment within the period."""
    rings = [MadeRing(name) for name in names]
    began = time.monotonic()
    for turn in range(1 << 62):
        for place, ring in enumerate(rings):
            due = began + (turn + place / len(rings)) * PERIOD
            if (wait := due - time.monotonic()) > 0.002:
                time.sleep(wait)
            ring.step()


if __name__ == "__main__":
    os.environ["UMO_FRAMES"] = sys.argv[1]
    main([f"{sys.argv[2]}{number:03d}" for number in range(int(sys.argv[3]))])
