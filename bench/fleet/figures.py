"""`python -m bench --fleet-figures`: what a fleet costs: gateways, a router, somebody who joins late.

All on this computer, over loopback. Costs are processor time of one process over `BLOCK` s.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from bench.fleet import report_file
from bench.fleet.parts import UMO, Part, environment
from bench.fleet.plant import PUBLISHES, ROUTES
from bench.fleet.rings import OBJECTS, PERIOD
from bench.report import Doing, Target
from umo.clients.fleet.fleet_mirror import find
from umo.clients.fleet.fleet_presence import FleetPresence
from umo.clients.fleet.fleet_session import FleetNetwork, opened
from umo.clients.fleet.fleet_settings import FleetSettings

TITLE = "What a fleet costs: stations of 60 objects, half changed in each period, 10 a second"
BLOCK = 20.0
COUNTS = (100, 300)
MANY, GATEWAYS = 1000, 4
RINGS = 100
"""Stations of one process that writes rings."""
PORT = 17447
LIMIT, SETTLING = 120.0, 5.0
CORE = 0.15
"""Share of a core for a gateway of 300 stations at most."""
JOINED = 1.0
"""Time in s within which who joins late has everything."""
TAKES = 180.0


@dataclass
class Side:
    """Some gateways, with so many stations each."""

    address: str
    gateways: list[Part] = field(default_factory=list)
    others: list[Part] = field(default_factory=list)
    router: Part | None = None
    report: Path = Path()

    def sum(self, what: str = "received") -> int:
        """Of the subscriber's report."""
        return sum(each[what] for each in (report_file.read(self.report) or {}).values())

    def runs(self) -> int:
        return len(report_file.read(self.report) or {})


@contextmanager
def _running(folder: Path, gateways: int, stations: int, port: int) -> Iterator[Side]:
    """A router, so many gateways with so many stations each, and a subscriber of all."""
    folder.mkdir()
    side = Side(f"tcp/127.0.0.1:{port}", report=folder / "checker.json")
    try:
        side.router = _begun(Part("router", (*UMO, "connect", "router", "--listen", side.address), folder,
                                  environment(folder / "router")), ROUTES)  # fmt: skip
        words = (sys.executable, "-m", "bench.fleet.checker", str(side.report), side.address)
        side.others.append(_begun(Part("checker", words, folder, environment(folder / "router"))))
        for number in range(gateways):
            site, environ = f"g{number}", environment(folder / f"g{number}")
            for first in range(0, stations, RINGS):
                count = str(min(RINGS, stations - first))
                rings = (
                    sys.executable,
                    "-m",
                    "bench.fleet.rings",
                    environ["UMO_FRAMES"],
                    f"made{first // RINGS}",
                    count,
                )
                side.others.append(_begun(Part(f"rings {site} {first}", rings, folder, environ)))
            serve = (*UMO, "connect", "fleet", "--site", site, "--connect", side.address)
            side.gateways.append(_begun(Part(f"gateway {site}", serve, folder, environ), PUBLISHES))
        until = time.monotonic() + LIMIT
        while side.runs() < gateways * stations:
            if time.monotonic() > until:
                raise RuntimeError(f"{side.runs()} of {gateways * stations} stations came within {LIMIT:.0f} s")
            time.sleep(0.5)
        time.sleep(SETTLING)
        yield side
    finally:
        for part in (*side.gateways, *side.others, *filter(None, [side.router])):
            part.kill()


def _begun(part: Part, says: str = "") -> Part:
    part.start()
    until = time.monotonic() + LIMIT
    while says not in part.said:
        if time.monotonic() > until or not part.is_running:
            raise RuntimeError(f"{part.name} did not begin: {part.said}")
        time.sleep(0.1)
    return part


def measure(doing: Doing) -> Iterator[Target]:
    with tempfile.TemporaryDirectory() as folder:
        for place, count in enumerate(COUNTS):
            doing(f"a gateway with {count} stations")
            with _running(Path(folder) / str(count), 1, count, PORT + place) as side:
                yield from _gateway(side, count)
        doing(f"{MANY:,} stations through one router")
        with _running(Path(folder) / "many", GATEWAYS, MANY // GATEWAYS, PORT + len(COUNTS)) as side:
            yield from _router(side)
            doing("somebody joins")
            yield from _joined(side)


def _shares(parts: Sequence[Part]) -> list[float]:
    """Each one's part of a core over a block."""
    began, before = time.monotonic(), [each.processor for each in parts]
    time.sleep(BLOCK)
    elapsed = time.monotonic() - began
    return [(each.processor - used) / elapsed for each, used in zip(parts, before, strict=True)]


def _gateway(side: Side, count: int) -> Iterator[Target]:
    [gateway], router = side.gateways, side.router
    assert router is not None
    came, began = side.sum(), time.monotonic()
    size = side.sum("bytes")
    share, passing = _shares([gateway, router])
    came, elapsed = side.sum() - came, time.monotonic() - began
    limit = count == COUNTS[-1]
    verdict = ("met" if share <= CORE else f"missed by {share / CORE - 1:.0%}") if limit else ""
    expected = count * elapsed / PERIOD
    shown = f"{share:.1%} of a core, {gateway.memory:.0f} MB; the router {passing:.1%}"
    yield Target(f"a gateway with {count} stations of {OBJECTS} objects", f"{CORE:.0%} of a core" if limit else "-",
                 shown, verdict)  # fmt: skip
    yield Target("  a station", "-", f"{share / count * 1e3:.2f} per mille of a core", "")
    yield Target("  bytes a second of a station", "-", f"{(side.sum('bytes') - size) / elapsed / count:,.0f}", "")
    yield Target("  deltas that came", "all", f"{came:,} of {expected:,.0f}", "")


def _router(side: Side) -> Iterator[Target]:
    assert side.router is not None
    came, began = side.sum(), time.monotonic()
    router, *gateways = _shares([side.router, *side.gateways])
    came, elapsed = side.sum() - came, time.monotonic() - began
    shown = f"{router:.1%} of a core, {side.router.memory:.0f} MB; {GATEWAYS} gateways {sum(gateways):.1%}"
    yield Target(f"a router with {MANY:,} stations, one subscriber of all", "-", shown, "")
    yield Target("  deltas that came", "all", f"{came:,} of {MANY * elapsed / PERIOD:,.0f}", "")


def _joined(side: Side) -> Iterator[Target]:
    """How long it takes until somebody who joins has the values of one station, and the states of all."""
    network = FleetNetwork(connect=[side.address])
    began = time.monotonic()
    with find("g0/made0000", FleetSettings("desk", network, "ann")) as reader:
        while reader.latest() is None:
            time.sleep(0.001)
        yield _within("a late joiner has the values of a station, opening its session included", began)
    session = opened(network, "client")
    began = time.monotonic()
    presence = FleetPresence(session)
    while time.monotonic() < began + LIMIT and not _is_complete(presence.stations()):
        time.sleep(0.01)
    yield _within(f"  the states of all {MANY:,} stations", began)
    session.close()


def _is_complete(stations: Sequence[Any]) -> bool:
    return len(stations) == MANY and all(each.status for each in stations)


def _within(what: str, began: float) -> Target:
    taken = time.monotonic() - began
    return Target(what, f"{JOINED:g} s", f"{taken:.2f} s", "met" if taken <= JOINED else "missed")
