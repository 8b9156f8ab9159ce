"""What umo 0.2 has left: a recording, a file of kept values and a wiring are read as they are."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import Result

from helpers import recorded_old
from helpers.tapes import OVEN, recorded
from umo import BinaryActuator, Compound, DigitalActuator, DigitalSensor, Number
from umo.process import kept_file, kept_values
from umo.process.frames.run_reader import NumberedEvent
from umo.process.job import Job, Plan
from umo.recording.recording import Recording
from umo.states import OnOff
from umo.wiring import resolve

Umo = Callable[..., Result]


HEATING = """
from umo.control import next_period
async def main(m):
    for number in range(60):
        m.heater.write(number / 10)
        await next_period()
"""


def test_a_recording_of_0_2_is_read_and_replayed(umo: Umo, tmp_path: Path) -> None:
    """A run in virtual time was one chunk for each second of wall-clock time; the file was whole after each."""
    station = tmp_path / "oven"
    station.mkdir()
    (station / "objects.py").write_text(OVEN)
    (station / "application.py").write_text(HEATING)
    tape = recorded(str(station))
    tape.layout.about["job"] = dict(tape.job)
    events = [NumberedEvent(number, event) for number, event in enumerate(tape.events)]
    blocks = [*tape.recorded[:-1], replace(tape.recorded[-1], events=events)]
    path = tmp_path / "old.mcap"
    recorded_old.write(path, tape.layout, blocks)
    with Recording(path) as recording:
        assert recording.about_file["version"] == "1" and "checksum" not in recording.about_file
        assert recording.complete and not recording.damage
        for name in ("raws", "values", "time", "quality"):
            assert recording.frames()[name].tobytes() == np.ascontiguousarray(tape.frames[name]).tobytes()
    replayed = umo("recording", "replay", str(path), str(station))
    assert replayed.exit_code == 0 and replayed.stdout.startswith("identical"), replayed.output
    assert "whole" in umo("recording", "info", str(path)).stdout
    content = path.read_bytes()
    assert umo("recording", "repair", str(path)).exit_code == 0 and path.read_bytes() == content


KEPT = (
    '{"checksum": "310b254f66d07c9bcfe68c702d7d2a11bc3e58e8dbd3d4802a8eb4c20e35a4c7", "content": {"versio'
    'n": 1, "station": "conveyor", "wiring": "simulated", "place": "/srv/stations/conveyor", "pid": 15068'
    ', "started": 1795827431.6540074, "period": 1435, "utc": 1795827434.522213, "sections": {"numbers": {'
    '"sorter.in_bin": {"value": 17, "unit": "", "type": "int"}, "sorter.unit.produced": {"value": 30, "un'
    'it": "", "type": "int"}, "sorter.unit.rejected": {"value": 17, "unit": "", "type": "int"}}, "alarms"'
    ': {}, "states": {"sorter.unit": "execute"}}}}'
    "\n"
)
"""As `umo.process.kept_file` of 0.2 has written it."""


def test_values_that_0_2_has_kept_are_taken_over(tmp_path: Path) -> None:
    plan = Plan(Job("conveyor", options={"realtime": True}))
    path = kept_values.file_of(plan)
    assert path is not None and path.name == "conveyor-dfeb5bc9be4f4c7f.json"  # its name then
    os.close(kept_file.lock_file(path))  # it makes the folder
    kept_file.write(path, KEPT.encode())
    said: list[str] = []
    try:
        found = kept_values.take_over(plan, said.append)
    finally:
        path.unlink()
    assert found["numbers"]["sorter.in_bin"] == {"value": 17, "unit": "", "type": "int"}
    assert found["states"] == {"sorter.unit": "execute"}
    assert all("lost" not in text for text in said)


WIRING = """
fault_seed = 3
faults = ["pressure stuck at 5 s"]

[drivers.io]
type = "modbus"
host = "192.0.2.7"
port = 1502
unit = 3
timeout = "40 ms"
watchdog = "500 ms"
watchdog_register = 90

[drivers.slow]
type = "modbus"
host = "192.0.2.8"
off_cycle = true
period = "200 ms"
max_age = "2 s"

[wire]
timer = { driver = "timerfd", period = "10 ms" }
pressure = { driver = "io", channel = "input:0:int16", resolution = 0.01, zero_offset = -1.0, invalid_raws = [-32768] }
heater = { driver = "io", channel = "holding:4", maximum = 8.0 }
"lamps.*" = { driver = "io", channel = "coil:{}", start = 8 }
level = { driver = "slow", channel = "input:2:float32:0.001" }

[parameters]
pressure_limit = 4.5

[process]
priority = 20

[record]
rotate = "30 min"
keep = "2 GB"
"""


class Boiler(Compound):
    pressure: DigitalSensor
    level: DigitalSensor
    heater: DigitalActuator
    lamps: tuple[BinaryActuator, ...]
    timer: DigitalSensor
    pressure_limit: float = 3.0
    NUMBERS = {"pressure_limit": Number("bar", minimum=0.0, maximum=9.0)}


def boiler() -> Boiler:
    return Boiler(
        pressure=DigitalSensor("bar", minimum=-1.0, maximum=10.0, resolution=0.01),
        level=DigitalSensor("m", minimum=0.0, maximum=2.0, resolution=0.001, synchronous=False),
        heater=DigitalActuator("kW", default=0.0, minimum=0.0, maximum=10.0, resolution=0.01),
        lamps=tuple(BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF) for _ in range(2)),
        timer=DigitalSensor("sampling_period", minimum=0, maximum=99_999, resolution=1, synchronous=False),
    )


def test_a_wiring_of_0_2_is_read_with_all_that_it_says(tmp_path: Path) -> None:
    pytest.importorskip("pymodbus")
    file = tmp_path / "boiler.toml"
    file.write_text(WIRING)
    wired = resolve(boiler(), file)
    assert wired.period == 0.01 and wired.watchdogs == {"io": 0.5}
    assert {wire.item.path: wire.channel.text for wire in wired.wires} == {
        "pressure": "input:0:int16", "level": "input:2:float32:0.001", "heater": "holding:4", "lamps.0": "coil:8",
        "lamps.1": "coil:9", "timer": "tick",
    }  # fmt: skip
    assert [(each.number.path, each.value) for each in wired.parameters] == [("pressure_limit", 4.5)]
    assert wired.injection is not None and wired.record == {"rotate": "30 min", "keep": "2 GB"}
