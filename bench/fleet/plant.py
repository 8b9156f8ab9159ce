"""The fleet of the bench: ten computers with their stations and gateways, two routers, and those who follow it."""

from __future__ import annotations

import shutil
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any

from bench.fleet.namespaces import Network
from bench.fleet.parts import UMO, Part, environment
from umo.clients.fleet.fleet_keys import segment
from umo.errors import UmoError
from umo.process.frames import Reader
from umo.process.frames.search import frames_at

ROUTERS = 2
PORT, FACE_PORT = 7447, 9464
LIMIT = 60.0
"""Time in s within which what is waited for must come."""
ROUTES, PUBLISHES = "routes for", "publishes the stations of"
"""What a router and a gateway say when they have begun."""
OWN = "own"
"""The site of the gateway that takes commands, of its own computer only: beyond it that needs certificates."""
OWN_ADDRESS = "tcp/127.0.0.1:7448"


def _says(part: Part, words: str) -> bool:
    return words in part.said


class Truth:
    """What a station has published, from its own ring: a reader outlives those who write."""

    def __init__(self, site: str, reader: Reader, run: bytes) -> None:
        self.name = f"{site}/{segment(str(reader.about['station']))}"
        self.reader, self.run = reader, run
        self.began = time.monotonic()

    @property
    def key(self) -> str:
        return f"{self.name}/{self.run.hex()}"


def stride_of(reader: Reader) -> int:
    """Frames of one delta, at ten deltas a second."""
    return max(1, round(0.1 / float(reader.about["period"])))


class FleetPlant:
    """`computers`, each with `stations`. They are only rings; one of each of the first `real` computers is real."""

    def __init__(self, folder: Path, computers: int, stations: int, real: int) -> None:
        self.folder, self.computers = folder, computers
        self.made = [stations - (number < real) for number in range(computers)]
        """Rings of each computer."""
        self.network = Network(computers + ROUTERS + 2)
        self.desk, self.alone = computers + ROUTERS, computers + ROUTERS + 1
        """The computer of those who follow the fleet, and one that is no part of it: its station takes commands."""
        self.sites = [f"c{number}" for number in range(computers)]
        self._stack = ExitStack()
        self.truths: dict[Path, Truth] = {}
        self.routers = [self._router(number) for number in range(ROUTERS)]
        self.gateways = [self._gateway(number) for number in range(computers)]
        self.rings = [self._rings(number) for number in range(computers)]
        self.stations = [self._station(number) for number in range(real)]
        self.faces = [self._face(number) for number in range(real)]
        self.scrapers = [self._scraper(number) for number in range(real)]
        self.carried_out = folder / "carried_out"
        roles = Path(environment(folder / f"computer{self.alone}")["XDG_CONFIG_HOME"]) / "umo" / "roles.toml"
        roles.parent.mkdir(exist_ok=True)
        roles.write_text('[unverified]\nfleet = "maintain"\n')  # nothing proves a client's name on one computer
        own = ("connect", "fleet", "--commands", "--site", OWN, "--listen", OWN_ADDRESS)
        self.own_gateway = self.part("gateway with commands", self.alone, *UMO, *own)
        self.own_station = self.python("station", self.alone, "bench.fleet.station", str(self.carried_out))

    def router_address(self, number: int) -> str:
        return f"tcp/{self.network.address(self.computers + number)}:{PORT}"

    def part(self, name: str, place: int, *words: str) -> Part:
        folder = self.folder / f"computer{place}"
        return Part(name, words, self.folder, environment(folder), self.network.command(place))

    def python(self, name: str, place: int, *words: str) -> Part:
        return self.part(name, place, sys.executable, "-m", *words)

    def _router(self, number: int) -> Part:
        words = ["connect", "router", "--listen", self.router_address(number)]
        if number:
            words += ["--connect", self.router_address(0)]
        return self.part(f"router{number}", self.computers + number, *UMO, *words)

    def _gateway(self, number: int) -> Part:
        address = self.router_address(number % ROUTERS)
        words = ["connect", "fleet", "--site", self.sites[number], "--connect", address]
        return self.part(f"gateway {self.sites[number]}", number, *UMO, *words)

    def _rings(self, number: int) -> Part:
        frames = environment(self.folder / f"computer{number}")["UMO_FRAMES"]
        return self.python(
            f"rings {self.sites[number]}", number, "bench.fleet.rings", frames, "made", str(self.made[number])
        )

    def _station(self, number: int) -> Part:
        file = self.folder / f"carried_out{number}"
        return self.python(f"station {self.sites[number]}", number, "bench.fleet.station", str(file))

    def _face(self, number: int) -> Part:
        words = ("connect", "face", "prometheus", "--station", "Plant", "--set", f"prometheus.port={FACE_PORT}")
        return self.part(f"face {self.sites[number]}", number, *UMO, *words)

    def _scraper(self, number: int) -> Part:
        report = self.folder / f"scraper{number}.json"
        return self.python(f"scraper {self.sites[number]}", number, "bench.fleet.scraper", str(report), str(FACE_PORT))

    # The truth -----------------------------------------------------------------------------------------------

    def frames(self, number: int) -> Path:
        return Path(environment(self.folder / f"computer{number}")["UMO_FRAMES"])

    def look(self) -> None:
        """Find the rings that have begun."""
        from umo.clients.fleet.station_publisher import run_of

        for number, site in enumerate(self.sites):
            for path in self.frames(number).glob("*.sock"):
                if path not in self.truths:
                    with suppress(UmoError, OSError):
                        reader = frames_at(path)
                        self.truths[path] = Truth(site, reader, run_of(reader.about, stride_of(reader)))

    def wait(self, condition: Callable[[], Any], what: str, limit: float = LIMIT) -> None:
        """RuntimeError if it does not come about."""
        until = time.monotonic() + limit
        while not condition():
            if time.monotonic() > until:
                raise RuntimeError(f"{what} within {limit:.0f} s: it did not come about")
            self.look()
            time.sleep(0.1)

    @property
    def parts(self) -> list[Part]:
        own = [self.own_station, self.own_gateway, *self.faces, *self.scrapers]
        return [*self.rings, *self.stations, *self.gateways, *self.routers, *own]

    def __enter__(self) -> FleetPlant:
        self._stack.enter_context(self.network)
        try:
            for router in self.routers:
                router.start()
                self.wait(partial(_says, router, ROUTES), f"{router.name} is there")
            for gateway in self.gateways:
                gateway.start()
            self.wait(lambda: all(PUBLISHES in each.said for each in self.gateways), "all gateways are there")
        except BaseException:
            self._end()
            raise
        return self

    def _end(self) -> None:
        for part in self.parts:
            part.kill()
        self._stack.close()
        for truth in self.truths.values():
            truth.reader.close()

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._end()
        if kind is None:
            shutil.rmtree(self.folder, ignore_errors=True)
