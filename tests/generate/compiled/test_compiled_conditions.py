"""The conditions of interlocks, compiled with the laws of a machine."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest

from helpers.compiling import CompiledRun
from helpers.generating import needs_a_compiler, set_inputs
from helpers.machines import timer
from umo import BinaryActuator, Compound, DigitalSensor, Interlock
from umo.control import value_of
from umo.generate import compiled_laws
from umo.states import OnOff

pytestmark = needs_a_compiler


class Boiler(Compound):
    timer: DigitalSensor
    pressure: DigitalSensor
    burner: BinaryActuator[OnOff]
    most: float = 50.0
    asked = 0

    def condition(self) -> Any:
        return value_of(self.pressure) > self.most

    def interlocks(self) -> Iterator[Interlock]:
        yield Interlock(self.condition, [self.burner], "too high", latched=True)

    def control(self) -> None:
        self.burner.write(OnOff.ON)


class Counting(Boiler):
    def condition(self) -> Any:
        self.asked += 1
        return value_of(self.pressure) > self.most


class Text(Boiler):
    def condition(self) -> Any:
        return value_of(self.pressure) > float(f"{self.most:g}")


class Writing(Boiler):
    def condition(self) -> Any:
        return value_of(self.pressure) > self.most and self.burner.write(OnOff.OFF)


class Sharing(Boiler):
    """Its condition and its law call the same function, which writes."""

    def closed(self) -> bool:
        return self.burner.write(OnOff.OFF)

    def condition(self) -> Any:
        return value_of(self.pressure) > self.most and self.closed()

    def control(self) -> None:
        if value_of(self.pressure) > 90.0:
            self.closed()


class Limit:
    def __init__(self) -> None:
        self.most = 50.0


class Foreign(Boiler):
    """Its condition refers to an object that is no part of the machine, made where the condition is."""

    def interlocks(self) -> Iterator[Interlock]:
        self.other = other = Limit()
        yield Interlock(lambda: value_of(self.pressure) > other.most, [self.burner], "too high")


class Running(CompiledRun):
    def __init__(self, kind: type[Boiler]) -> None:
        pressure = DigitalSensor("bar", minimum=0.0, maximum=100.0, resolution=1.0, on_error="mark")
        burner = BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF)
        super().__init__(kind(timer=timer(), pressure=pressure, burner=burner))
        self.inhibition = self.connection.machine.claims.inhibitions[0]

    @property
    def is_compiled(self) -> bool:
        return self.inhibition.condition != self.inhibition.interlock.condition


def test_a_compiled_condition_inhibits_latches_and_frees_as_pythons() -> None:
    with Running(Boiler) as run:
        assert run.laws.state == "compiled" and run.is_compiled
        run.box.set("pressure", 51)
        run.step()
        assert run.m.burner.inhibited == "too high" and run.m.burner.read() is OnOff.OFF
        run.m.most = 60.0
        run.step()
        assert "latched" in run.m.burner.inhibited
        run.m.acknowledge()
        run.step()
        assert run.m.burner.inhibited is None and run.m.burner.read() is OnOff.ON


def test_a_condition_that_cannot_be_evaluated_has_the_text_of_python() -> None:
    with Running(Boiler) as run:
        assert run.is_compiled
        set_inputs(run.box, ["pressure"], [0], [True])
        run.step()
        assert "cannot be evaluated: pressure is BAD" in run.m.burner.inhibited


@pytest.mark.parametrize(
    ("kind", "why"),
    [
        (Counting, "one changes an attribute"),
        (Text, "float(f"),
        (Writing, "one writes"),
        (Sharing, "one writes"),
    ],
)
def test_what_is_not_plain_stays_in_python_and_is_told(kind: type[Boiler], why: str) -> None:
    with Running(kind) as run:
        assert run.laws.state == "compiled" and not run.is_compiled
        assert "the conditions of interlocks run in Python: " in run.events and why in run.events
        run.box.set("pressure", 51)
        run.step()
        assert run.m.burner.inhibited == "too high"


def test_a_condition_follows_an_object_that_is_no_part_of_the_machine() -> None:
    with Running(Foreign) as run:
        assert run.laws.state == "compiled" and run.is_compiled
        run.box.set("pressure", 51)
        run.step()
        assert run.m.burner.inhibited == "too high"
        run.m.other.most = 60.0
        run.step()
        assert run.m.burner.inhibited is None
        assert run.is_compiled


def test_a_difference_leaves_the_conditions_to_python(monkeypatch: pytest.MonkeyPatch) -> None:
    source: Callable[..., str] = compiled_laws.source_of_laws
    monkeypatch.setattr(compiled_laws, "source_of_laws", lambda *given: source(*given).replace(" > ", " < "))
    with Running(Boiler) as run:
        assert run.laws.state == "compiled" and not run.is_compiled
        assert "the condition 'too high' is not the same in C" in run.events


def test_given_back_to_python_the_conditions_are_pythons_again() -> None:
    with Running(Boiler) as run:
        run.m.most = None
        assert run.laws.state == "python" and not run.is_compiled


def test_without_the_extension_conditions_are_called_by_ctypes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("umo.generate.compiled_laws.extension", None)
    monkeypatch.setattr("umo.generate.compiled_conditions.extension", None)
    with Running(Boiler) as run:
        assert run.is_compiled
        run.box.set("pressure", 51)
        run.step()
        assert run.m.burner.inhibited == "too high"
