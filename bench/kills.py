"""From a kill to the last output at its default, seen at an independent Modbus server."""

from __future__ import annotations

import json
import mmap
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bench.box_server import COILS, OUTPUTS
from umo import BinaryActuator, Compound, DigitalActuator, DigitalSensor, OnOff
from umo.cycle.sequences import next_period
from umo.process import guardian
from umo.process.job import Job
from umo.process.messages import MessageSocket

PERIOD = 0.0025
LATEST = 0.05
"""s after it is running at which the kill comes at the latest."""


class Machine(Compound):
    """As many channels as the z-theta manipulator has on its box."""

    timer: DigitalSensor
    motor: DigitalActuator
    valves: list[BinaryActuator[OnOff]]
    counts: list[DigitalSensor]

    def control(self) -> None:
        self.motor.write(5.0)
        for valve in self.valves:
            valve.write(OnOff.ON)


def machine() -> Machine:
    return Machine(
        timer=DigitalSensor("sampling_period", minimum=0.0, maximum=99_999.9, resolution=1.0, synchronous=False),
        motor=DigitalActuator("V", default=0.0, minimum=-10.0, maximum=10.0, resolution=0.01),
        valves=[BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF) for _ in range(COILS)],
        counts=[DigitalSensor("count", minimum=0.0, maximum=65_535.0, resolution=1.0) for _ in range(4)],
    )


async def run(m: Machine) -> None:
    while True:
        await next_period()


def wiring(port: int) -> dict[str, Any]:
    wire: dict[str, Any] = {"timer": {"driver": "timerfd", "period": PERIOD}}
    wire["motor"] = {"driver": "box", "channel": "holding:0:int16"}
    wire |= {f"valves.{i}": {"driver": "box", "channel": f"coil:{i}"} for i in range(COILS)}
    wire |= {f"counts.{i}": {"driver": "box", "channel": f"input:{i}"} for i in range(4)}
    box = {"type": "modbus", "port": port, "timeout": "1 s"}
    return {"drivers": {"box": box}, "wire": wire}


@dataclass
class Kills:
    """Times in ms, of those after which every output was at its default."""

    what: str
    times: list[float]
    unsafe: int
    memory_mb: float
    """Resident memory of the control process, the largest seen."""

    def text(self) -> str:
        middle, late, worst = np.percentile(self.times, [50, 99, 100])
        return f"median {middle:.1f}, p99 {late:.1f}, worst {worst:.1f} ms of {len(self.times)}; unsafe {self.unsafe}"


def measure(kills: int) -> list[Kills]:
    """Each of the three ways to die, `kills` times at random moments."""
    with _served() as (port, cells), tempfile.TemporaryDirectory() as folder:
        os.environ |= {"UMO_STATE": folder, "UMO_FRAMES": folder}
        ways = [
            ("SIGKILL of the control process", "control", signal.SIGKILL),
            ("SIGSTOP of it, hang_timeout 100 ms", "control", signal.SIGSTOP),
            ("SIGKILL of the guardian", "guardian", signal.SIGKILL),
        ]
        moments = random.Random(1998)
        return [_measure(what, whom, number, kills, port, cells, moments) for what, whom, number in ways]


def _measure(what: str, whom: str, number: int, kills: int, port: int, cells: Any, moments: random.Random) -> Kills:
    found = Kills(what, [], 0, 0.0)
    for _ in range(kills):
        guard, channel = _start(port)
        message = channel.receive(30)
        if message is None or message["kind"] != "running":
            raise RuntimeError(f"the machine did not start: {message}")
        for file in message["files"]:
            os.close(file)
        time.sleep(moments.uniform(0.005, LATEST))
        found.memory_mb = max(found.memory_mb, _resident(message["pid"]))
        struck = time.monotonic_ns()
        os.kill(guard if whom == "guardian" else message["pid"], number)
        while not channel.ended:
            channel.receive(60)
        os.waitpid(guard, 0)
        channel.close()
        since = [cells[2 * i + 1] for i in range(OUTPUTS)]
        if all(since):
            found.times.append((max(since) - struck) * 1e-6)
        else:
            found.unsafe += 1
    return found


def _start(port: int) -> tuple[int, MessageSocket]:
    """A guardian forked from this process, which has imported what one imports."""
    channel, there = MessageSocket.pair()
    job = Job(machine="bench.kills:machine", application="bench.kills:run", wiring=wiring(port), acknowledge=True)
    channel.send("job", job=job.dump().decode())
    guard = os.fork()
    if guard == 0:
        channel.close()
        os._exit(guardian.main(there.detach()))
    there.close()
    return guard, channel


@contextmanager
def _served() -> Iterator[tuple[int, Any]]:
    with tempfile.NamedTemporaryFile() as file:
        command = [sys.executable, "-m", "bench.box_server", file.name]
        server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        try:
            assert server.stdout is not None
            port = int(server.stdout.readline())
            with open(file.name, "r+b") as opened:
                yield port, memoryview(mmap.mmap(opened.fileno(), 16 * OUTPUTS)).cast("q")
        finally:
            server.kill()
            server.communicate()


def _resident(pid: int) -> float:
    return int(Path(f"/proc/{pid}/status").read_text().partition("VmRSS:")[2].split()[0]) / 1024


def in_a_fresh_process(kills: int) -> list[Kills]:
    """The same, with guardians forked from a process that has imported no more than they need."""
    command = [sys.executable, "-m", "bench.kills", str(kills)]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
    return [Kills(**found) for found in json.loads(done.stdout)]


if __name__ == "__main__":
    print(json.dumps([asdict(found) for found in measure(int(sys.argv[1]))]))
