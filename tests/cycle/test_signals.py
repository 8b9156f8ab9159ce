"""Signals: numbers of the control code beside the objects, in frames, trace and on the screen."""

from __future__ import annotations

import csv
import math
from enum import Enum, IntEnum
from pathlib import Path
from typing import Any

import pytest

from helpers.machines import actuator, sensor, timer, wired
from umo import Compound, DigitalActuator, DigitalSensor, Number, connect, published
from umo.control import PID, Servo
from umo.cycle.frame import signals_of
from umo.cycle.trace import Trace
from umo.errors import DeclarationError
from umo.objects import numbers_of
from umo.process.frames import Reader
from umo.testing import Scripted, periods, put
from umo_command.show.values_live import WatchScreen

pytestmark = pytest.mark.usefixtures("each_way")


class Axis(Compound, numbers={"load": Number("N", shown=True), "share": Number(shown=True)}):
    motor: DigitalActuator
    encoder: DigitalSensor

    def setup(self) -> None:
        self.servo = Servo(self.encoder, self.motor, gain=0.1)
        self.inner = PID(gain=1.0)
        self.load: Any = 1.5
        self._hidden = PID(gain=1.0)

    @property
    def share(self) -> float:
        return 1.0 / (self.load - 2.0)

    def control(self) -> None:
        self.servo.control(20.0, dt=self.dt)


class Press(Compound):
    timer: DigitalSensor
    axes: list[Axis]


def press() -> Press:
    return Press(timer=timer(), axes=[Axis(motor=actuator(), encoder=sensor())])


PATHS = ["load", "share", "servo.setpoint", "servo.error", "inner.setpoint", "inner.error"]
UNITS = ["N", "", "mm", "mm", "", ""]


def test_a_machine_has_the_signals_of_its_compounds_and_of_their_laws() -> None:
    found = signals_of(numbers_of(press()))
    assert [signal.path for signal in found] == [f"axes.0.{path}" for path in PATHS]
    assert [signal.unit for signal in found] == UNITS


def test_frames_and_trace_hold_the_signals_of_each_period(tmp_path: Path) -> None:
    m, trace = press(), Trace()
    connection = connect(m, wired(m, Scripted()))
    with connection, published(connection, "press") as ring, Reader(ring.path) as reader:
        connection.machine.observers.append(trace)
        put(m.axes[0].encoder, 5.0)
        periods(m)
        assert reader.signals == [f"axes.0.{path}" for path in PATHS]
        frame = reader.latest()
        assert frame is not None
        values = dict(zip(PATHS, frame["signals"].tolist(), strict=True))
        assert (values["load"], values["share"]) == (1.5, -2.0)
        assert (values["servo.setpoint"], values["servo.error"]) == (20.0, 15.0)
        assert math.isnan(values["inner.setpoint"])
        m.axes[0].load = 2.0  # its share cannot be computed now
        periods(m)
        frame = reader.latest()
        assert frame is not None
        assert frame["signals"][0] == 2.0
        assert math.isnan(frame["signals"][1])
        assert frame["number"] == 2
        assert reader.values(frame).keys() == {"timer", "axes.0.motor", "axes.0.encoder"}
    trace.save(tmp_path / "trace.csv")
    with (tmp_path / "trace.csv").open() as file:
        header, first, _ = list(csv.reader(file))
    row = dict(zip(header, first, strict=True))
    assert row["axes.0.servo.error[mm]"] == "15.0"
    assert row["axes.0.load[N]"] == "1.5"
    assert trace.rows[:, trace.place(trace.signals[0])].tolist() == [1.5, 2.0]


def test_the_laws_in_lists_tuples_and_dicts_are_found_once_each() -> None:
    class Cascade(Axis):
        def setup(self) -> None:
            super().setup()
            self.all = [self.inner, PID(gain=1.0)]
            self.pair = (PID(gain=1.0),)
            self.named = {"outer": PID(gain=1.0), "note": "text"}
            self._spare = [PID(gain=1.0)]

    m = Press(timer=timer(), axes=[Cascade(motor=actuator(), encoder=sensor())])
    laws = [signal.path.removeprefix("axes.0.") for signal in signals_of(numbers_of(m)) if signal.name == "error"]
    assert laws == ["servo.error", "inner.error", "all.1.error", "pair.0.error", "named.outer.error"]


def test_the_screen_shows_the_signals_below_the_objects() -> None:
    m = press()
    connection = connect(m, wired(m, Scripted()))
    with connection, published(connection, "press") as ring, Reader(ring.path) as reader:
        put(m.axes[0].encoder, 5.0)
        picture = WatchScreen(reader, list(range(len(reader.paths) + len(reader.signals))))
        periods(m, 3)
        picture.update()
        table = picture.whole().renderables[1]
        shown = dict(zip(table.columns[0]._cells, map(str, table.columns[1]._cells), strict=True))
        assert shown["axes.0.servo.error"] == "15 mm"
        assert shown["axes.0.inner.setpoint"] == "-"
        assert shown["axes.0.encoder"] == "5.0 mm"


def test_a_signal_that_is_not_there_is_refused_on_connect() -> None:
    class Odd(Axis, numbers={"weight": Number("N", shown=True)}):
        pass

    m = Press(timer=timer(), axes=[Odd(motor=actuator(), encoder=sensor())])
    message = "number axes.0.weight: Odd has no attribute 'weight'"
    with pytest.raises(DeclarationError, match=message), connect(m, wired(m, Scripted())):
        pass


# Named values -------------------------------------------------------------------------------------------


class Phase(Enum):
    WAITING = "waits"
    TOP_DOWN = "goes down"


class Level(IntEnum):
    LOW = 10
    HIGH = 20


class Mill(Compound, numbers={"phase": Number(shown=True), "level": Number(shown=True)}):
    timer: DigitalSensor

    def setup(self) -> None:
        self.phase = Phase.WAITING

    @property
    def level(self) -> Level:
        return Level.HIGH if self.phase is Phase.TOP_DOWN else Level.LOW


def test_a_shown_enum_is_a_named_value_in_frames_and_in_words() -> None:
    machine = Mill(timer=timer())
    connection = connect(machine, wired(machine, Scripted()))
    with connection as m, published(connection, "mill") as ring, Reader(ring.path) as reader:
        periods(m)
        m.phase = Phase.TOP_DOWN
        periods(m)
        about = {each.path: each for each in reader.layout.described.signals}
        assert about["phase"].plain["states"] == {"0": "waiting", "1": "top down"}
        assert about["level"].plain["states"] == {"10": "low", "20": "high"}
        assert [frame["signals"].tolist() for frame in reader.read()] == [[0.0, 10.0], [1.0, 20.0]]
        assert about["phase"].text(1.0) == "top down"
        assert about["phase"].text(0.0, 1.0, 1.0) == "waiting, top down"
        assert about["level"].text(15.0) == "15"
        assert "top down" in reader.html(["phase"])


def test_an_enum_whose_value_is_another_thing_has_no_value() -> None:
    machine = Mill(timer=timer())
    connection = connect(machine, wired(machine, Scripted()))
    with connection as m, published(connection, "mill") as ring, Reader(ring.path) as reader:
        m.phase = "somewhere"
        periods(m)
        assert math.isnan(reader.latest()["signals"][0])
