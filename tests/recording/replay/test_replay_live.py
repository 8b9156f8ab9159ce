"""Replays of runs in real time, over Modbus: missed periods, stops, clients, a control process that was killed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import umo
from helpers.live import plant, record_live, stopped_and_continued
from umo.cycle.journal import Kind
from umo.process.start import Started
from umo.recording.recording import Recording
from umo.recording.replay.code_given import NOTHING_GIVEN, CodeGiven
from umo.recording.replay.program import Program
from umo.recording.replay.replaying import replay
from umo.recording.replay.result import Replayed
from umo.system.processes import name_of

pytestmark = [pytest.mark.full, pytest.mark.skipif(not sys.platform.startswith("linux"), reason="processes")]


@pytest.fixture(scope="module")
def box(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    with plant("conveyor", tmp_path_factory.mktemp("box")) as wiring:
        yield wiring


def replayed(file: Path, given: CodeGiven = NOTHING_GIVEN) -> tuple[Replayed, SimpleNamespace]:
    """The replay, and what the recording says of itself."""
    with Recording(file) as recording:
        result = replay(recording, Program.of(recording, given))
        told = {name: getattr(recording, name) for name in ("complete", "ended", "events")}
    return result, SimpleNamespace(**told)


def test_a_run_over_modbus_that_was_stopped_and_continued_is_identical(box: Path, tmp_path: Path) -> None:
    stops: list[int] = []

    def act(started: Started, frames: int) -> None:
        if len(stops) < 3 and frames > 200 * (len(stops) + 1) and started.pid is not None:
            stops.append(frames)
            stopped_and_continued(started.pid, 0.1)

    record_live("conveyor", box, tmp_path / "run.mcap", act, parts=2)
    result, recording = replayed(tmp_path / "run.mcap")
    assert result.identical and result.periods > 600, str(result)
    assert recording.complete
    with Recording(tmp_path / "run.mcap") as again:
        assert sum(int(block.frames["missed"].sum()) for block in again.blocks()) > 30


def test_a_run_whose_control_process_was_killed_is_identical_to_its_last_period(box: Path, tmp_path: Path) -> None:
    def act(started: Started, frames: int) -> None:
        if frames > 200 and started.pid is not None and started.outcome is None:
            os.kill(started.pid, signal.SIGKILL)

    outcome = record_live("conveyor", box, tmp_path / "run.mcap", act, acknowledge=True, parts=2)
    assert outcome.failure is not None and outcome.failure.name == "ControlLost"
    result, recording = replayed(tmp_path / "run.mcap")
    assert result.identical and result.periods > 200, str(result)
    assert result.ended == "" and not recording.ended


def test_a_run_that_a_client_stopped_is_identical(box: Path, tmp_path: Path) -> None:
    asked: list[Any] = []

    def act(started: Started, frames: int) -> None:
        if frames > 200 and not asked:
            asked.append(umo.attach("conveyor").stop())

    record_live("conveyor", box, tmp_path / "run.mcap", act, acknowledge=True, parts=2)
    result, _ = replayed(tmp_path / "run.mcap")
    assert result.identical, str(result)
    assert result.ended.startswith("stopped by")


HAND = """
import sys, time, umo
station = umo.attach("ztheta")
with station.lease("commissioning"):
    station.home()
    station.z.move_to(100_000)
    station.z.servo.gain = 0.004
    station.gripper.vacuum.write("ON")
    time.sleep(0.3)
    station.gripper.vacuum.release()
    try:
        station.z.move_to(10**9)
    except umo.UmoError as error:
        print(error)
    station.theta.jog(10.0)
    time.sleep(0.3)
    if sys.argv[1] == "die":
        import os, signal
        os.kill(os.getpid(), signal.SIGKILL)
    station.theta.jog.release()
    station.theta.move_to(200.0)
station.stop()
"""


@pytest.mark.parametrize("how", ["leave", "die"])
def test_a_run_by_hand_is_identical_also_if_the_operator_dies(how: str, tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    hands: list[subprocess.Popen[bytes]] = []
    ends: list[float] = []

    def act(started: Started, frames: int) -> None:
        if frames > 100 and not hands:
            hands.append(subprocess.Popen([sys.executable, "-c", HAND, how]))
        if hands and hands[0].poll() is not None and how == "die":
            ends.append(time.monotonic())
            if ends[-1] - ends[0] > 3.0 and started.outcome is None:
                started.ask_to_stop()

    record_live("ztheta", None, tmp_path / "run.mcap", act, manual=True, realtime=True)
    result, recording = replayed(tmp_path / "run.mcap")
    assert result.identical, str(result)
    texts = [event.text for _, event in recording.events]
    commands = [event for _, event in recording.events if event.command]
    assert len(commands) > 10 and result.periods > 3000
    if how == "die":
        assert any("dead-man" in text or "not renewed" in text for text in texts), texts


SLOW = {
    "objects.py": """
from umo import BinaryActuator, Compound, DigitalActuator, DigitalSensor
from umo.states import OnOff
class Oven(Compound):
    timer: DigitalSensor
    motor: DigitalActuator
    heater: DigitalActuator
    temperature: DigitalSensor
    filtered: DigitalSensor
    probe: DigitalSensor
    valve: BinaryActuator[OnOff]
    def control(self):
        age = min(self.now - self.temperature.time, 1.0)
        self.heater.write(self.temperature.read() / 20.0 + age)
        self.motor.write(self.heater.read() / 2.0 + self.filtered.read() / 100.0 + age)
        number = round(self.now / 0.005)
        if number % 40 == 0:
            self.valve.write(OnOff.ON if number % 80 else OnOff.OFF)
        if number % 30 == 0:
            self.heater.write(self.probe.read() / 20.0)
        if number % 100 == 0:
            self.heater.reset()
def machine():
    def sensor(**changes):
        return DigitalSensor("degC", minimum=0, maximum=100, resolution=0.01, on_error="hold", max_age="60 s",
                             **changes)
    def actuator():
        return DigitalActuator("V", default=0, minimum=0, maximum=10, resolution=0.001, limits="clamp",
                               on_error="retry", max_age="60 s")
    return Oven(
        timer=DigitalSensor("sampling_period", minimum=0, maximum=99_999, resolution=1, synchronous=False),
        motor=actuator(), heater=actuator(),
        temperature=sensor(), filtered=sensor(filter="30 ms"), probe=sensor(synchronous=False),
        valve=BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF, synchronous=False, on_error="retry",
                             max_age="60 s"),
    )
""",
    "application.py": """
from umo.control import next_period
async def main(m):
    while True:
        await next_period()
""",
    "box.py": """
import random, time
from umo.errors import ChannelsFailed, DeviceTimeout, DriverError
from umo.testing import Scripted
class Box(Scripted):
    away, quiet = 0, 20
    def _call(self, segment, channels=(), raws=()):
        time.sleep(0.004)
        self.quiet -= 1
        if self.away or (self.quiet < 0 and random.random() < 0.01):
            self.away = max(self.away - 1, 0) if self.away else random.choice([0, 0, 8])
            raise random.choice([DriverError("dead"), DeviceTimeout("slow")])
        if self.quiet < 0 and segment == "read_many" and random.random() < 0.1:
            raise ChannelsFailed({channels[0].text: "cut"})
        return super()._call(segment, channels, raws)
    def _reading(self, channel, replaced):
        return random.randrange(10_000)
""",
    "wiring.toml": """
[drivers.box]
type = ".box:Box"
off_cycle = true
period = "20 ms"
max_age = "1 s"
[wire]
"timer" = { driver = "timerfd", period = "5 ms" }
"motor" = { driver = "simulated" }
"heater" = { driver = "box" }
"temperature" = { driver = "box" }
"filtered" = { driver = "box" }
"probe" = { driver = "box" }
"valve" = { driver = "box" }
[process]
hang_timeout = "5 s"
""",
}
"""A station whose circuit is slow, fails and is away now and then."""


@pytest.mark.parametrize("killed", [False, True], ids=["fails", "worker killed"])
def test_a_run_with_a_worker_process_is_identical(killed: bool, tmp_path: Path) -> None:
    station = tmp_path / "slow_oven"
    station.mkdir()
    for name, text in SLOW.items():
        (station / name).write_text(text)
    done: list[int] = []

    def act(started: Started, frames: int) -> None:
        if killed and frames > 300 and not done:
            children = Path(f"/proc/{started.guardian}/task/{started.guardian}/children").read_text().split()
            done.extend(int(pid) for pid in children if name_of(int(pid)) == "umo worker")
            os.kill(done[0], signal.SIGKILL)
        if frames > 1500 and started.outcome is None:
            started.ask_to_stop()

    record_live(str(station), station / "wiring.toml", tmp_path / "run.mcap", act)
    result, _ = replayed(tmp_path / "run.mcap", CodeGiven(str(station), str(station / "wiring.toml")))
    assert result.identical and result.periods > 1400, str(result)
    with Recording(tmp_path / "run.mcap") as recording:
        entries = [kind for block in recording.blocks() for kind in block.entries["kind"].tolist()]
    assert {Kind.ARRIVED, Kind.CONFIRMED} <= set(entries) and len(entries) > 100
    assert not killed or Kind.RENEWED in entries
