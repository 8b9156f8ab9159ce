"""An attribute that is one of several texts is a variable of compiled laws: who sets it from elsewhere is heard in the
same period, and a text or another thing that the laws do not know gives them back to Python."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from helpers.conversions import BUILT
from helpers.generating import needs_a_compiler
from helpers.machines import actuator, sensor, timer, wired
from umo import Compound, DigitalActuator, DigitalSensor, connect
from umo.generate.compiled_laws import COMPARED, CompiledLaws, prepare
from umo.testing import Scripted, VirtualTimer, periods
from umo.wiring import resolve

pytestmark = [needs_a_compiler, BUILT]
OUTPUTS = {"idle": 1.0, "heat": 2.0, "hold": 3.0}


class Phase(str):
    """A text of a class of its own."""


class Oven(Compound):
    timer: DigitalSensor
    heater: DigitalActuator
    temperature: DigitalSensor

    def setup(self) -> None:
        self.phase = "idle"
        self.count = 0

    def control(self) -> None:
        if self.phase == "hold":
            self.count += 1
            self.heater.write(3.0)
        elif self.phase in ("idle", "heat"):
            self.heater.write(OUTPUTS[self.phase])
        else:
            self.heater.write(4.0)
        if self.count > 2:
            self.phase, self.count = "heat", 0


@contextmanager
def compiled() -> Iterator[tuple[Oven, CompiledLaws]]:
    """An oven whose laws are compiled already, and they."""
    m = Oven(timer=timer(), heater=actuator(), temperature=sensor())
    found = resolve(m, wired(m, Scripted(), clock=VirtualTimer()))
    prepared = prepare(m, found)
    connection = connect(m, found)
    with connection:
        laws = connection.machine.attach(CompiledLaws(prepared))
        periods(m, COMPARED * 3)
        assert laws.state == "compiled"
        yield m, laws


def test_a_text_that_the_laws_know_is_seen_in_the_same_period() -> None:
    with compiled() as (m, laws):
        m.phase = "hold"
        periods(m, 1)
        assert (m.heater.pending, m.phase) == (3.0, "hold")
        periods(m, 3)
        assert (m.heater.pending, m.phase, m.count) == (2.0, "heat", 0)
        assert laws.state == "compiled"


@pytest.mark.parametrize("given", ["other", "", 0, None, Phase("hold")], ids=repr)
def test_what_they_do_not_know_gives_them_back_to_python(given: Any) -> None:
    with compiled() as (m, laws):
        m.phase = given
        periods(m, 1)
        assert m.phase is given
        assert m.heater.pending == (3.0 if isinstance(given, Phase) else 4.0)
        assert laws.state == "python"


def test_when_the_machine_ends_python_has_the_text() -> None:
    with compiled() as (m, _):
        m.phase = "hold"
        periods(m, 1)
    assert (m.phase, type(m.phase)) == ("hold", str)
