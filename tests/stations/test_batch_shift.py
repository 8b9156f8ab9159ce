"""A shift of the batch plant: lost answers and boxes that are away cost nothing that the integrator has allowed."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pytest

import umo
from helpers.batch_plant import boxes
from umo import BinaryActuator, DigitalActuator, DigitalSensor
from umo.cycle.events import Event
from umo.cycle.showing import frame_of
from umo.objects import path_of
from umo.process.frames import Reader, blackbox
from umo.states import OpenClosed
from umo.stations.batch.application import main
from umo.stations.batch.control import BatchPlant, ChargingLine, Reactor

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="frames are published on Linux only")

SHIFT = 8 * 3600
ABSENCES = [(f"box_{number % 2}", 1500 + 2700 * number) for number in range(10)]
"""The box that is away for 2 s, and when, s."""
KEPT = {"max_age": "5 s"}


def tolerant() -> BatchPlant:
    """Everything on the boxes may be lost for 5 s."""

    def valve() -> BinaryActuator[OpenClosed]:
        return BinaryActuator(OpenClosed, one=OpenClosed.OPEN, default=OpenClosed.CLOSED, on_error="retry", **KEPT)

    def drive(units: str, maximum: float, **more: Any) -> DigitalActuator:
        limits = {"minimum": 0.0, "maximum": maximum, "resolution": 0.1}
        return DigitalActuator(units, default=0.0, on_error="retry", **limits, **KEPT, **more)

    def sensor(units: str, minimum: float, maximum: float, resolution: float) -> DigitalSensor:
        limits = {"minimum": minimum, "maximum": maximum, "resolution": resolution}
        return DigitalSensor(units, on_error="hold", **limits, **KEPT)

    def reactor() -> Reactor:
        return Reactor(
            feed=valve(),
            drain=valve(),
            stirrer=drive("rpm", 150.0, slew_rate=50.0),
            heater=drive("percent", 100.0),
            temperature=sensor("degC", -10.0, 150.0, 0.01),
            level=sensor("l", -2.0, 200.0, 0.1),
        )

    scale = sensor("kg", -2.0, 120.0, 0.01)
    line = ChargingLine(inlets=[valve(), valve()], outlets=[valve(), valve()], waste=valve(), scale=scale)
    timer = DigitalSensor("sampling_period", minimum=0.0, maximum=99_999.9, resolution=1.0, synchronous=False)
    return BatchPlant(reactors=[reactor(), reactor()], line=line, timer=timer)


class Shift:
    """One run that is published; what its frames and a black box told."""

    def __init__(self, batches: int, fault: list[str], kept: Path) -> None:
        self.machine = tolerant()
        self.told: list[Event] = []
        """Every event of the machine."""
        self.read: list[Event] = []
        """Every event that a reader of the frames has seen."""
        self.faults: set[str] = set()
        connection = umo.connect(self.machine, boxes(), fault=fault)
        with connection as m, umo.published(connection, "shift") as ring, Reader(ring.path) as self._reader:
            self._events, self._number, self._next = connection.machine.events, 0, 0
            connection.machine.observers.append(self._observe)
            self.result = umo.drive(m, main, batches=batches, recipe=["glue", "soap"])
            self._observe(frame_of(connection.machine))
            self.time = m.now
            blackbox.save(self._reader, kept, "the end of the shift")
            self.report = connection.driver("plant").report()
        with Reader(kept) as box:
            self.boxed = [each.event for each in box.events()]

    def _observe(self, frame: umo.Frame) -> None:
        new, self._number = self._events.number - self._number, self._events.number
        self.told += list(self._events)[-new:] if new else []
        self.faults |= {path_of(each) for each in (*self.machine.reactors, self.machine.line) if each.cycle.fault}
        if self._reader.now().next_event != self._next:
            found = self._reader.events(self._next)
            self._next = found[-1].number + 1
            self.read += [each.event for each in found]


def faults(until: float) -> list[str]:
    """1 % of all transfers of each box fail, and each absence within the time, s."""
    away = [f"{box} disconnect at {at} s for 2 s" for box, at in ABSENCES if at < until]
    return [*away, *(f"{box} drop-out 1 % for {until} s" for box in ("box_0", "box_1", "box_line"))]


@pytest.mark.parametrize(
    ("batches", "seconds"),
    [
        pytest.param(8, 1800, marks=pytest.mark.full, id="half an hour"),
        pytest.param(115, SHIFT, marks=pytest.mark.full, id="eight hours"),
    ],
)
def test_a_shift_with_lost_answers_and_absences_loses_no_batch_and_tells_every_event(
    batches: int, seconds: float, tmp_path: Path
) -> None:
    shift = Shift(batches, faults(seconds), tmp_path / "kept.box")
    assert shift.time > seconds
    assert shift.faults == set()
    assert (shift.result["batches_made"], shift.result["batches_dumped"]) == (2 * batches, 0)
    assert shift.report["batches_good"] == 2 * batches
    away = [event for event in shift.told if "is away" in event.text]
    back = [event for event in shift.told if "is back" in event.text]
    assert len(away) == len(back)
    again = [(event.path, event.time) for event in back if "initialised again" in event.text]
    due = [(box, at) for box, at in ABSENCES if at < shift.time - 60.0]
    assert due
    assert all(any(path == f"driver {box}" and 2.0 <= time - at < 8.0 for path, time in again) for box, at in due)
    assert shift.read == shift.told[: len(shift.read)]
    assert len(shift.told) - len(shift.read) <= 1  # of the last period
    assert shift.boxed == shift.told[-len(shift.boxed) :]
