"""The station in real time over Modbus TCP: the plant is a process of its own, the control code is unchanged."""

from __future__ import annotations

import contextlib
import json
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

import umo
from helpers.tiers import first
from umo.process.station import find

pytest.importorskip("mujoco")
pymodbus = pytest.importorskip("pymodbus.client")

pytestmark = pytest.mark.slow
DEFAULTS = ([False, True, False, False, False, False, False], 0)
"""Coils 0 to 6 (theta.direction is CW by default) and the DAC's register."""

CONTROL = """
import os, sys, umo
from umo.stations.ztheta.application import main
from umo.stations.ztheta.objects import machine

wiring, at, number = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])

def strike(frame):
    if frame.number >= at:
        os.kill(os.getpid(), number)

m = machine()
connection = umo.connect(m, wiring)
with connection:
    connection.machine.observers.append(strike)
    umo.drive(m, main)
print("left", connection.stop.signal, flush=True)
"""


class Box:
    """`umo device plant ztheta` on a free port, and a wiring that names it."""

    def __init__(self, folder: Path, *options: str, watchdog: str = "10 s") -> None:
        self.report = folder / "report.json"
        command = [
            sys.executable,
            "-c",
            "from umo_command import main; main()",
            "device",
            "plant",
            "ztheta",
            "--port",
            "0",
        ]
        command += ["--out", str(self.report), *options]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        self.port = int(self.process.stdout.readline().rpartition(":")[2])
        self.wiring = folder / "box.toml"
        text = find("ztheta").wirings["modbus"].read_text()
        text = text.replace("port = 5020", f"port = {self.port}")
        # what a busy machine does to a call is not what is tested here
        text = text.replace('timeout = "100 ms"', 'timeout = "2 s"').replace(
            'watchdog = "200 ms"', f'watchdog = "{watchdog}"'
        )
        text = text.replace('hang_timeout = "250 ms"', 'hang_timeout = "5 s"')
        self.wiring.write_text(text)

    def levels(self) -> tuple[list[bool], int]:
        """What another project's client reads from the box."""
        client = pymodbus.ModbusTcpClient("127.0.0.1", port=self.port)
        try:
            assert client.connect()
            coils = client.read_coils(0, count=7).bits[:7]
            return coils, client.read_holding_registers(0, count=1).registers[0]
        finally:
            client.close()

    def end(self) -> dict[str, object]:
        """The plant's truth, after it has ended."""
        self.process.send_signal(signal.SIGTERM)
        self.process.communicate(timeout=30)
        found: dict[str, object] = json.loads(self.report.read_text())
        return found


@contextlib.contextmanager
def box(folder: Path, *options: str, watchdog: str = "10 s") -> Iterator[Box]:
    served = Box(folder, *options, watchdog=watchdog)
    try:
        yield served
    finally:
        served.process.kill()
        served.process.communicate()


def struck(served: Box, period: int, number: signal.Signals) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", CONTROL, str(served.wiring), str(period), str(int(number))]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)


PERIODS = [150, *sorted(random.Random(5020).sample(range(1, 1200), 4))]
"""In the first of them both axes are being homed."""


@pytest.mark.parametrize(
    ("period", "number"), first(1, [(p, (signal.SIGINT, signal.SIGTERM)[i % 2]) for i, p in enumerate(PERIODS)])
)
def test_a_signal_at_any_period_leaves_the_box_at_its_defaults(
    tmp_path: Path, period: int, number: signal.Signals
) -> None:
    with box(tmp_path, "--watchdog", "0", "--seed", str(period)) as served:
        ended = struck(served, period, number)
        assert ended.stdout == f"left {int(number)}\n", ended.stderr
        assert served.levels() == DEFAULTS


@pytest.mark.parametrize("period", first(1, [150, 3, 700]))
@pytest.mark.full
def test_killed_outright_the_box_drops_its_outputs_by_its_own_watchdog(tmp_path: Path, period: int) -> None:
    with box(tmp_path, "--seed", "0", watchdog="200 ms") as served:
        assert struck(served, period, signal.SIGKILL).returncode == -signal.SIGKILL
        with pytest.raises(subprocess.TimeoutExpired):  # the plant lives on, and nobody asks it anything
            served.process.wait(timeout=0.6)
        assert served.levels() == DEFAULTS
        drops = served.end()["watchdog_drops"]
        assert isinstance(drops, int)
        assert drops >= 1


TOLERANT = """10_000.0
"z.window" = 150.0
"z.settling_time" = 5.0
"theta.settling_time" = 5.0
[process]
cpu = {core}
"""
"""Of the axes: at the longer period, with late ones among them, z comes to rest more slowly. And not the core on which
the control processes of other tests hang under SCHED_FIFO."""


@pytest.mark.full
def test_the_unchanged_control_code_places_a_part_over_the_wire(tmp_path: Path) -> None:
    with box(tmp_path, "--seed", "3", "--parts", "1") as served:
        text = served.wiring.read_text()  # a longer period: what a busy computer does to a short one is not tested here
        tolerant = TOLERANT.format(core=min(os.sched_getaffinity(0)))
        text = text.replace('"2.5 ms"', '"5 ms"').replace('following_error" = 2000.0', f'following_error" = {tolerant}')
        served.wiring.write_text(text.replace('timeout = "100 ms"', 'timeout = "1 s"'))
        with contextlib.suppress(PermissionError):  # the box is hardware: other tests do not slow it down
            os.setpriority(os.PRIO_PROCESS, served.process.pid, -15)
        command = [sys.executable, "-c", "from umo_command import main; main()", "run", "ztheta", "--parts", "1"]
        command += ["-w", str(served.wiring), "--summary", str(tmp_path / "sum.json")]
        ended = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=300, check=False)
        assert ended.returncode == 0, ended.stderr
        summary = json.loads((tmp_path / "sum.json").read_text())
        assert (summary["progress"], summary["reports"]) == ({"text": "done", "done": 1, "total": 1}, {})
        assert served.levels() == DEFAULTS
        truth = served.end()
        assert truth["parts_placed"] == 1, truth


Z_UM = 4.64357
"""One count of the z encoder."""


@pytest.mark.full
@pytest.mark.parametrize("period", [60, 462, 1260])
def test_killed_at_random_the_guardian_stops_the_station_and_z_stays(tmp_path: Path, period: int) -> None:
    """The box has no watchdog of its own here."""
    with box(tmp_path, "--watchdog", "0", "--seed", str(period)) as served:
        with umo.start("ztheta", served.wiring, parts=1) as station:
            while station.outcome is None and (station.frames is None or station.frames.head < period):
                station.poll(0.01)
            assert station.outcome is None, station.outcome
            assert station.pid is not None
            os.kill(station.pid, signal.SIGKILL)
            with pytest.raises(umo.RunFailed, match="the guardian reset every actuator"):
                station.wait(60)
        assert served.levels() == DEFAULTS
        client = pymodbus.ModbusTcpClient("127.0.0.1", port=served.port)
        assert client.connect()
        try:
            first = count = client.read_input_registers(0, count=1).registers[0]
            until = time.monotonic() + 1.0
            while time.monotonic() < until:  # the plant lives in real time
                count = client.read_input_registers(0, count=1).registers[0]
                assert abs(count - first) * Z_UM < 1000.0
        finally:
            client.close()
