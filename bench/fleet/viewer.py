"""Somebody who looks at a fleet: `python -m bench.fleet.viewer REPORT ADDRESS STATION...`.

It notes who is present and when that changes, and looks at the mirrors of the stations that are named: no value that is
older than `OLDEST` may be shown as good.
"""

from __future__ import annotations

import sys
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from bench.fleet import report_file
from bench.fleet.checker import MADE
from umo.clients.fleet.fleet_mirror import find
from umo.clients.fleet.fleet_presence import FleetPresence
from umo.clients.fleet.fleet_session import FleetNetwork, opened
from umo.clients.fleet.fleet_settings import FleetSettings
from umo.cycle.stage import Stage
from umo.errors import UmoError
from umo.objects import Quality
from umo.process.frames import Reader

OLDEST = 2.0
"""s."""
LOOK = 0.05
"""Time in s from one look to the next."""


class Viewed:
    """The mirror of a station, again and again as it begins and ends."""

    def __init__(self, name: str, settings: FleetSettings) -> None:
        self.name, self._settings = name, settings
        self.looks = 0
        self.old: list[tuple[float, float]] = []
        """When a value was shown as good that was too old, and how old it was, s; one for each spell."""
        self.ends = False
        self._looked = time.monotonic_ns()
        threading.Thread(target=self._follow, daemon=True).start()

    def _follow(self) -> None:
        while not self.ends:
            with suppress(UmoError), find(self.name, self._settings) as reader:
                self._look_at(reader)
            time.sleep(LOOK)

    def _look_at(self, reader: Reader) -> None:
        is_old = False
        while not self.ends and reader.state is not Stage.ENDED:
            frame, now = reader.latest(), time.monotonic_ns()
            is_punctual = now - self._looked < 10 * LOOK * 1e9  # not stopped itself since
            self._looked = now
            if frame is not None and is_punctual:
                self.looks += 1
                made = frame["raws"][0] if MADE in self.name else frame["began"]
                age = (now - int(made)) * 1e-9
                was, is_old = is_old, age > OLDEST and bool((frame["quality"] == Quality.GOOD).any())
                if is_old and not was:
                    self.old.append((now * 1e-9, age))
            time.sleep(LOOK)


def main(report: Path, address: str, names: list[str]) -> None:
    file = report_file.ReportFile(report)
    network = FleetNetwork(connect=[address])
    session = opened(network, "client")
    presence = FleetPresence(session)
    views = [Viewed(name, FleetSettings("desk", network, "ann")) for name in names]
    there: set[str] = set()
    changes: list[tuple[float, str, bool]] = []

    def found() -> dict[str, Any]:
        seen = {view.name: {"looks": view.looks, "old": view.old} for view in views}
        return {"changes": changes, "views": seen}

    while not file.ends:
        now = time.monotonic()
        present = {str(each.key) for each in presence.stations() if each.is_present(now)}
        changes += [(now, key, key in present) for key in present ^ there]
        there = present
        file.write(found)
        time.sleep(LOOK)
    file.write(found, now=True)
    for view in views:
        view.ends = True
    session.close()


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2], sys.argv[3:])
