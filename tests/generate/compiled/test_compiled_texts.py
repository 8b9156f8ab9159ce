"""Texts of compiled laws are made by Python, of the attributes and variables of C: what an error says, and what is
assigned to an attribute that only tells."""

from __future__ import annotations

import logging
from enum import Enum
from typing import NamedTuple

import numpy as np
import pytest

from helpers.compiling import CompiledRun
from helpers.generating import needs_a_compiler
from helpers.machines import actuator, sensor, timer
from umo import Compound, DigitalActuator, DigitalSensor, Quality

pytestmark = needs_a_compiler


LOG = logging.getLogger("tank")


class Side(Enum):
    LEFT = "left"
    RIGHT = "right"


class Place(NamedTuple):
    x: float
    n: int


class TooFull(Exception):
    """The tank is full."""


class Tank(Compound):
    timer: DigitalSensor
    motor: DigitalActuator
    level: DigitalSensor
    wanted: str = ""
    """Which error the laws raise."""

    def setup(self) -> None:
        self.limit, self.count, self.side, self.found = 2.5, 3, Side.LEFT, None
        self.numbers, self.row = np.array([1.0, 2.0]), [1, 2]
        self.fails, self.note, self.status = 0, "", ""
        self.found: float | None = None

    def named(self, numbers: object) -> str:
        places = np.flatnonzero(numbers)
        return f"zone{'s' * (len(places) > 1)} {', '.join(map(str, places[:3]))}" if len(places) else "none"

    @property
    def title(self) -> str:
        return self.side.name.lower() if self.side is Side.LEFT else "other"

    def control(self) -> None:
        share, number, yes = self.limit / 4.0, self.count + 1, self.limit > 2.0
        place, double, hot = Place(share, number), self.numbers * 2.0, self.numbers > 1.0
        self.status = f"{share:.2f} of {self.title}"
        self.note = "idle"
        LOG.info("%s of %d", f"{share:.2f}", number)
        if self.fails == 1:
            raise TooFull(f"{share:.1f} mm, {number}, {yes}, {self.side}, {self.count:03d}")
        if self.fails == 2:
            raise TooFull(f"{place}, {double}, {self.row}, {self.found}, {self.named(hot)}")
        if self.fails == 3:
            raise TooFull(f"full at {self.limit!r}", number, self.side)
        if self.fails == 4:
            raise ValueError(self.title + ": " + self.note)
        if self.fails == 5:
            try:
                raise TooFull(f"first, {share}")
            except TooFull:
                self.count += 1
            raise TooFull(f"second, {self.count}")


def tank() -> Tank:
    return Tank(timer=timer(), motor=actuator(), level=sensor())


@pytest.mark.parametrize("case", range(1, 6))
def test_an_error_says_what_it_says_in_python(case: int) -> None:
    told = []
    for state in ("compiled", "python"):
        with CompiledRun(tank()) as run:
            if state == "python":
                run.laws.give_up("for the test")
            run.m.fails = case
            with pytest.raises((TooFull, ValueError)) as caught:
                run.step()
            told.append((type(caught.value), caught.value.args, caught.traceback[-1].lineno))
    assert told[0] == told[1]


def test_a_text_that_is_assigned_is_made_each_time() -> None:
    with CompiledRun(tank()) as run:
        run.m.limit, run.m.side = 3.0, Side.RIGHT
        run.step()
        assert (run.m.status, run.m.note) == ("0.75 of other", "idle")
        run.m.note = "set by somebody"
        run.step()
        assert run.m.note == "idle"
        assert run.laws.state == "compiled" and "left out" not in run.events


def test_what_only_tells_is_called_in_each_period(caplog: pytest.LogCaptureFixture) -> None:
    with CompiledRun(tank()) as run:
        caplog.clear()
        with caplog.at_level("INFO", "tank"):
            run.m.limit = 3.0
            run.step(2)
        assert [each.getMessage() for each in caplog.records] == ["0.75 of 4"] * 2
        assert run.laws.state == "compiled"


def test_an_error_in_a_text_is_raised() -> None:
    class Odd(Tank):
        def control(self) -> None:
            if self.fails:
                raise TooFull(f"{self.level.path}: {self.note}")

    class Shown(str):
        def __format__(self, spec: str) -> str:
            raise OSError("not shown")

    with CompiledRun(Odd(timer=timer(), motor=actuator(), level=sensor())) as run:
        run.m.note = Shown("x")
        run.m.fails = 1
        with pytest.raises(OSError, match="not shown"):
            run.step()
        assert run.m.level.quality is not Quality.BAD
