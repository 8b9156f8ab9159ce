"""What the face OPC UA costs: processor time and memory of its process, and what reaches a client of node-opcua.

    python -m bench.face_opcua [COUNT ...]

A station of so many sensors, all of which change in every period, is looked at 10 times a second; one client monitors
them all. A client that gets fewer than 10 values of each a second means that the face falls behind.
"""

from __future__ import annotations

import asyncio
import json
import os
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from umo import Compound, DigitalSensor, connect, published
from umo.drivers.contract import Channel, Direction, Driver, IntArray
from umo.testing.periods import periods
from umo.testing.virtual import VirtualTimer

CLIENT = Path(__file__).parents[1] / "tests" / "faces" / "opcua" / "client.mjs"
SECONDS = 10.0
LOOKS = 10.0
"""Looks a second."""
STEPS = 20.0
"""Periods a second."""
TICK = os.sysconf("SC_CLK_TCK")
SERVE = f"""
import asyncio, sys
from umo.faces.host import FaceHost
from umo.faces.opcua import OpcUa
face = OpcUa(port=0)
host = FaceHost("many", [("opcua", face)], rate={LOOKS}, opened=lambda: print(face.address, flush=True))
asyncio.run(host.run())
"""


class Many(Compound):
    """A timer, and so many sensors."""

    timer: DigitalSensor
    zones: list[DigitalSensor]


class Counting(Driver):
    """Every value is another one in each period."""

    def __init__(self) -> None:
        self._number = 0

    def channel(self, text: str) -> Channel:
        return Channel(text, Direction.INPUT, 16)

    def read(self, channel: Channel) -> int:
        return self._number % 1000

    def read_many(self, channels: Sequence[Channel], out: IntArray) -> None:
        self._number += 1
        out[:] = self._number % 1000


@dataclass(frozen=True)
class Cost:
    """Of one count. `expected`, `told`: values a second (a busy computer makes fewer periods than it should);
    `processor`: of one core, %; `memory`: MB."""

    count: int
    expected: float
    told: float
    processor: float
    alone: float
    """The same without a client."""
    memory: float
    start: float
    """s of processor time until it serves."""

    def __str__(self) -> str:
        return (
            f"{self.count:6} sensors: {self.processor:5.1f} % of a core ({self.alone:.1f} % without a client), "
            f"{self.memory:.0f} MB, {self.told:.0f} of {self.expected:.0f} values/s told; start {self.start:.1f} s"
        )


async def measured(count: int, modules: Path, seconds: float = SECONDS) -> Cost:
    """Measure one count. `modules`: the folder node_modules that has node-opcua-client."""
    made = Many(
        timer=DigitalSensor("sampling_period", minimum=0.0, maximum=1e9, resolution=1.0, synchronous=False),
        zones=[DigitalSensor("degC", minimum=0.0, maximum=1000.0, resolution=0.1) for _ in range(count)],
    )
    wire: dict[str, Any] = {"timer": {"driver": "clock", "period": "50 ms"}, "zones.*": {"driver": "box"}}
    wiring = {"drivers": {"clock": VirtualTimer(), "box": Counting()}, "wire": wire}
    connection = connect(made, wiring)
    with connection, published(connection, "many", "bench"):
        stepping = asyncio.create_task(_step(made))
        try:
            return await _served(count, modules, seconds, lambda: int(connection.machine.clock.number))
        finally:
            stepping.cancel()


async def _step(made: Compound) -> None:
    while True:
        periods(made)
        await asyncio.sleep(1 / STEPS)


async def _served(count: int, modules: Path, seconds: float, periods_so_far: Callable[[], int]) -> Cost:
    face = await asyncio.create_subprocess_exec(sys.executable, "-c", SERVE, stdout=asyncio.subprocess.PIPE)
    more = {"NODE_PATH": str(modules), "UMO_PKI": str(modules.parent / "pki")}
    client = await asyncio.create_subprocess_exec(
        "node", "--no-warnings", str(CLIENT), stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.DEVNULL, env=os.environ | more, limit=1 << 24,
    )  # fmt: skip
    try:
        assert face.stdout is not None
        address = (await face.stdout.readline()).decode().strip()
        start = processor(face.pid)
        await asyncio.sleep(3.0)
        alone = await _share(face.pid, seconds / 2)
        names = [f"zones.{number}" for number in range(count)]
        await ask(client, "connect", url=address, station="many", user=None, security=None)
        await ask(client, "subscribe", names=names, interval=100, queue=10, count=True)
        await asyncio.sleep(2.0)
        before, number = await ask(client, "counted"), periods_so_far()
        share = await _share(face.pid, seconds)
        after = await ask(client, "counted")
        elapsed = after["at"] - before["at"]
        told, steps = (after["count"] - before["count"]) / elapsed, (periods_so_far() - number) / elapsed
        return Cost(count, count * min(LOOKS, steps), told, 100 * share, 100 * alone, memory(face.pid), start)
    finally:
        for process in (client, face):
            process.kill()
            await process.wait()


async def ask(client: asyncio.subprocess.Process, do: str, **more: Any) -> Mapping[str, Any]:
    assert client.stdin is not None and client.stdout is not None
    client.stdin.write((json.dumps({"id": 1, "do": do, **more}) + "\n").encode())
    answer = json.loads(await client.stdout.readline())
    if "refused" in answer:
        raise SystemExit(f"{do}: {answer['refused']}")
    return answer


async def _share(pid: int, seconds: float) -> float:
    """Its part of one core over that time."""
    loop = asyncio.get_running_loop()
    start, used = loop.time(), processor(pid)
    await asyncio.sleep(seconds)
    return (processor(pid) - used) / (loop.time() - start)


def processor(pid: int) -> float:
    """Processor time of a process in s."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICK


def memory(pid: int) -> float:
    """Resident memory of a process in MB."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmRSS")) / 1000


def installed() -> Path:
    """Where the tests of the face have installed node-opcua-client."""
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "umo"
    found = next(cache.glob("faces-*/node_modules/node-opcua-client"), None)
    if found is None:
        raise SystemExit("node-opcua is not installed: run tests/faces/test_opcua.py first")
    return found.parent


def main() -> None:
    """Print a line for each count: 60 and 1,000 by default."""
    counts = [int(each) for each in sys.argv[1:]] or [60, 1000]
    with tempfile.TemporaryDirectory() as folder:
        os.environ |= dict.fromkeys(("UMO_STATE", "UMO_FRAMES"), folder)
        for count in counts:
            print(asyncio.run(measured(count, installed())), flush=True)


if __name__ == "__main__":
    main()
