"""`python -m bench --fleet MINUTES`: ten computers, two routers, a hundred stations, and what befalls them."""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from bench.fleet import report_file, verdicts
from bench.fleet.commands import done_by
from bench.fleet.history import Disk, compared
from bench.fleet.namespaces import missing
from bench.fleet.parts import UMO, Part
from bench.fleet.plant import OWN, OWN_ADDRESS, FleetPlant
from bench.fleet.strikes import Striker
from bench.report import Doing, Target

TITLE = "A fleet: computers as network namespaces, routers, gateways, stations; each killed in turn"
SEED = 25
SETTLING = 4.0
"""Time in s after all is there, and before the end."""
CALM = 30.0
"""Time in s from the last strike to the end: a station that ends takes what it keeps with it."""
STRIKE_TAKES = 11.0
"""Time in s of a strike with the pause after it, about."""
WRITING = 120.0
"""Time in s in which the recorder must have written what has come."""
COMMAND_RATE = 6.0
"""Commands a second at most."""
COMMAND_STATION = f"{OWN}/Plant"


@dataclass(frozen=True)
class Size:
    computers: int = 10
    made: int = 10
    """Stations of each computer; they are only rings, but for the real ones."""
    real: int = 5
    """Computers of which one station is real."""
    commands: int = 10_000

    @property
    def stations(self) -> int:
        return self.computers * self.made


FULL = Size()
SHORT = Size(computers=3, made=4, real=1, commands=300)


def takes(minutes: float) -> float:
    return 60.0 * minutes + 60.0


def measure(minutes: float, doing: Doing, size: Size = FULL, seed: int = SEED) -> Iterator[Target]:
    if (why := missing()) is not None:
        yield Target("a fleet", "", "-", f"not measured: {why}")
        return
    with FleetPlant(Path(tempfile.mkdtemp(prefix="umo-fleet-")), size.computers, size.made, size.real) as plant:
        yield from Campaign(plant, size, seed).run(60.0 * minutes, doing)


class Campaign:
    def __init__(self, plant: FleetPlant, size: Size, seed: int) -> None:
        self._plant, self._size = plant, size
        followers = [plant.router_address(0), plant.router_address(1)]
        views = [f"{site}/made000" for site in plant.sites[:4]]
        self.checker = self._follower("checker", "checker", followers[0])
        self.disk = Disk(plant.folder / "history")
        words = ("recording", "history", str(self.disk.folder), "--connect", followers[1])
        self.recorder = plant.part("recorder", plant.desk, *UMO, *words)
        self.viewer = self._follower("viewer", "viewer", followers[0], *views)
        self._seed = seed

    def _follower(self, name: str, module: str, *words: str) -> Part:
        plant = self._plant
        return plant.python(name, plant.desk, f"bench.fleet.{module}", str(plant.folder / f"{name}.json"), *words)

    def _commands(self, seconds: float) -> Part:
        plant, count = self._plant, min(self._size.commands, round(COMMAND_RATE * seconds))
        rate = count / seconds
        words = (str(plant.folder / "commands.json"), OWN_ADDRESS, COMMAND_STATION, str(count), f"{rate:g}")
        return plant.python("commands", plant.alone, "bench.fleet.commands", *words)

    def report(self, name: str) -> Any:
        return report_file.read(self._plant.folder / f"{name}.json") or {}

    # The run ---------------------------------------------------------------------------------------------

    def run(self, seconds: float, doing: Doing) -> Iterator[Target]:
        plant, parts = self._plant, [self.checker, self.recorder, self.viewer]
        commands = self._commands(seconds)
        self.disk.mount()
        try:
            doing("it begins")
            for part in (*parts, *plant.rings, *plant.stations):
                part.start()
            plant.wait(lambda: len(plant.truths) == self._size.stations, "all rings are there")
            plant.wait(self._all_seen, "all stations are seen")
            for part in plant.faces:
                part.start()
            plant.wait(lambda: all("prometheus: " in each.said for each in plant.faces), "the faces serve")
            for part in plant.scrapers:
                part.start()
            plant.own_gateway.start()
            plant.own_station.start()
            plant.wait(lambda: COMMAND_STATION in plant.own_gateway.said, "the station that takes commands is there")
            commands.start()
            others = {"recorder": self.recorder, "checker": self.checker}
            striker = Striker(plant, others, self.disk, self._seed)
            began = time.monotonic()
            self._strike(striker, seconds, doing)
            doing("it ends")
            striker.pause(CALM, CALM)
            plant.wait(lambda: not commands.is_running, "all commands have an answer", seconds + WRITING)
            self.viewer.end()
            for part in (*plant.scrapers, *plant.faces):
                part.end()
            for part in (*plant.rings, *plant.stations):
                part.end()
            striker.pause(2 * SETTLING, 2 * SETTLING)
            for part in parts:
                part.end(WRITING)
        finally:
            for each in (*parts, commands):
                each.kill()
        try:
            yield from self._verdicts(striker, began)
        finally:
            self.disk.unmount()

    def _all_seen(self) -> bool:
        present: set[str] = set()
        for _, key, comes in self.report("viewer").get("changes", []):
            (present.add if comes else present.discard)(key)
        return len(present) == self._size.stations

    def _strike(self, striker: Striker, seconds: float, doing: Doing) -> None:
        """As many of each kind as there is time for."""
        times = max(1, round(seconds / STRIKE_TAKES / len(striker.kinds)))
        order = striker.order(times)
        for number, strike in enumerate(order):
            doing(f"strike {number + 1} of {len(order)}")
            striker.done.append(strike())
            told = json.dumps([asdict(each) for each in striker.done])
            (self._plant.folder / "strikes.json").write_text(told)
            striker.pause(SETTLING, 1.5 * SETTLING)

    def _verdicts(self, striker: Striker, began: float) -> Iterator[Target]:
        kinds = [each.kind for each in striker.done]
        told = ", ".join(f"{kinds.count(kind)} {kind}" for kind in sorted(set(kinds)))
        size = self._size
        where = f"{size.stations} stations ({size.real} real) on {size.computers} computers, two routers"
        yield Target(where, "-", told, "")
        sums = verdicts.sums_of(list(self._plant.truths.values()), self.report("checker"))
        yield from verdicts.deltas(sums)
        for line in sums.worst[:10]:
            yield Target("    " + line, "", "", "")
        yield from compared(self.disk.folder, list(self._plant.truths.values()))
        viewed = self.report("viewer")
        yield verdicts.views(viewed)
        yield verdicts.scrapes([self.report(f"scraper{number}") for number in range(size.real)])
        yield from verdicts.presence(striker.done, viewed["changes"], began)
        yield from verdicts.commands(self.report("commands"), done_by(self._plant.carried_out))
