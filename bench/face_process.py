"""A station in real time, `umo connect face` beside it, and clients that are connected to it, for `bench.faces`."""

from __future__ import annotations

import asyncio
import os
import time
from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import umo
from bench.face_clients import LOOKS, FaceClient
from bench.open_page import UMO, expect_running
from umo import Compound, DigitalSensor
from umo.control import next_period
from umo.drivers import Channel, Direction, Driver
from umo.process.start import Started

STARTING, SETTLING = 5.0, 2.0
"""Times in s after a face has begun to listen, and before a measurement."""
Addresses = Mapping[str, str]
"""Where each face is reached, by its name."""
TICK = os.sysconf("SC_CLK_TCK")


class Many(Compound):
    timer: DigitalSensor
    zones: list[DigitalSensor]


class Half(Driver):
    """Its first channels have other values in each period, as many others keep theirs."""

    def __init__(self) -> None:
        self._number = 0

    def channel(self, text: str) -> Channel:
        return Channel(text, Direction.INPUT, 16)

    def read(self, channel: Channel) -> int:
        return self._number

    def read_many(self, channels: Sequence[Channel], out: Any) -> None:
        self._number = (self._number + 1) % 1000
        out[: len(out) // 2] = self._number
        out[len(out) // 2 :] = 500


def machine(count: int = 60) -> Many:
    return Many(
        timer=DigitalSensor("sampling_period", minimum=0.0, maximum=99_999.0, resolution=1.0, synchronous=False),
        zones=[DigitalSensor("degC", minimum=0.0, maximum=1000.0, resolution=1.0) for _ in range(count)],
    )


async def application(m: Many) -> None:
    while True:
        await next_period()


@dataclass(frozen=True)
class FaceProcess:
    """`umo connect face`."""

    pid: int

    @property
    def processor(self) -> float:
        """s that it has had a processor."""
        fields = Path(f"/proc/{self.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / TICK

    @property
    def memory(self) -> float:
        """Resident, MB."""
        return int(Path(f"/proc/{self.pid}/status").read_text().partition("VmRSS:")[2].split()[0]) / 1000

    async def share(self, seconds: float) -> float:
        """Its part of a core over that time."""
        begun, used = time.monotonic(), self.processor
        await asyncio.sleep(seconds)
        return (self.processor - used) / (time.monotonic() - begun)


@asynccontextmanager
async def running(count: int, period: str) -> AsyncIterator[Started]:
    """Such a station, which runs in real time. RuntimeError if it does not."""
    wire = {"timer": {"driver": "timerfd", "period": period}, "zones.*": {"driver": "box"}}
    wiring = {"drivers": {"box": {"type": "bench.face_process:Half"}}, "wire": wire}
    with umo.start(machine, wiring, application, acknowledge=True, count=count) as started:
        while started.frames is None:
            expect_running(started)
            await asyncio.sleep(0.05)
        yield started
        started.stop()


@asynccontextmanager
async def clients_of(kinds: Sequence[type[FaceClient]], folder: Path) -> AsyncIterator[list[FaceClient]]:
    """Clients that are not connected yet; their brokers serve."""
    async with AsyncExitStack() as stack:
        made = []
        for kind in kinds:
            made.append(client := kind(folder))
            await stack.enter_async_context(client.closing)
        yield made


@asynccontextmanager
async def serving(
    clients: Sequence[FaceClient], started: Started
) -> AsyncIterator[tuple[FaceProcess, Mapping[str, str]]]:
    """A process with the faces of these clients, which has begun with the station; where each is reached."""
    words = [f"{each.face}.{name}={value}" for each in clients for name, value in each.options.items()]
    options = [word for each in words for word in ("--set", each)]
    process = await asyncio.create_subprocess_exec(
        *UMO, "connect", "face", *(each.face for each in clients), "--station", str(started.pid),
        "--rate", f"{LOOKS:g}", *options,
        stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.DEVNULL,
    )  # fmt: skip
    try:
        addresses = dict([await _address(process) for _ in clients])
        await asyncio.sleep(STARTING)
        yield FaceProcess(process.pid), addresses
    finally:
        with suppress(ProcessLookupError):
            process.terminate()
        await process.wait()


async def _address(process: asyncio.subprocess.Process) -> tuple[str, str]:
    """The next face and where it is reached, as `umo connect face` prints it. RuntimeError if it has ended."""
    assert process.stdout is not None
    if not (line := (await process.stdout.readline()).decode()):
        raise RuntimeError(f"umo connect face has ended with status {await process.wait()}")
    name, _, rest = line.partition(": ")
    return name, rest.split()[0]


async def connect(clients: Sequence[FaceClient], addresses: Addresses, count: int) -> None:
    """All of them get values from now on."""
    paths = [f"zones.{number}" for number in range(count)]
    await asyncio.gather(*(each.connect(addresses[each.face], Many.__name__, paths) for each in clients))
    await asyncio.gather(*(each.ready() for each in clients))
    await asyncio.sleep(SETTLING)
