"""NaN and infinity never move anything. Laws, strategies, axes and shipped actions are found by walking the package."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from dataclasses import MISSING, fields, is_dataclass
from functools import partial
from importlib import import_module
from math import inf, isnan, nan
from pkgutil import iter_modules
from typing import Any

import numpy as np
import pytest

import umo.control
from helpers.machines import stations, timer
from helpers.tiers import first
from umo import BinaryActuator, BinarySensor, Compound, DigitalActuator, DigitalSensor, Vector, connect
from umo.control import Axis, Hysteresis, Profile, Servo, VectorPID, move_together
from umo.control.axis import Motion
from umo.control.axis_state import AxisState
from umo.errors import BadInput, DeclarationError, RangeError
from umo.objects import actions_of, atoms, walk
from umo.states import OnOff, Rotation, UpDown
from umo.testing import periods, put

BAD = pytest.mark.parametrize("bad", first(2, [nan, -inf, inf]))
REFUSED = (RangeError, DeclarationError, BadInput)


class Rig(Compound):
    """The defaults of its actuators are not what NaN could be taken for."""

    timer: DigitalSensor
    encoder: DigitalSensor
    switch: BinarySensor[OnOff]
    motor: DigitalActuator
    drive: DigitalActuator
    step: BinaryActuator[UpDown]
    direction: BinaryActuator[Rotation]
    valve: BinaryActuator[OnOff]


def rig() -> Rig:
    return Rig(
        timer=timer(),
        encoder=encoder(),
        switch=BinarySensor(OnOff, one=OnOff.ON),
        motor=motor(),
        drive=DigitalActuator("mA", default=12.0, minimum=4.0, maximum=20.0, resolution=0.01, limits="clamp"),
        step=BinaryActuator(UpDown, one=UpDown.UP, default=UpDown.DOWN),
        direction=BinaryActuator(Rotation, one=Rotation.CW, default=Rotation.CW),
        valve=BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF),
    )


def encoder() -> DigitalSensor:
    return DigitalSensor("mm", minimum=0.0, maximum=100.0, resolution=0.01, incremental=True)


def motor() -> DigitalActuator:
    return DigitalActuator("V", default=0.0, minimum=-10.0, maximum=10.0, resolution=0.01, limits="clamp")


def pending(m: Compound) -> list[Any]:
    return [each.pending for each in atoms(m) if isinstance(each, BinaryActuator | DigitalActuator)]


# What there is ------------------------------------------------------------------------------------------


def classes() -> Iterator[type]:
    """Every public class of the package."""
    for module in iter_modules(umo.control.__path__, "umo.control."):
        for name, kind in vars(import_module(module.name)).items():
            if inspect.isclass(kind) and kind.__module__ == module.name and not name.startswith("_"):
                yield kind


AXES = [kind for kind in classes() if issubclass(kind, Axis) and kind is not Axis]
STRATEGIES = [kind for kind in classes() if is_dataclass(kind) and hasattr(kind, "find") and not issubclass(kind, Axis)]
OTHERS = Compound | Motion
LAWS = [kind for kind in classes() if is_dataclass(kind) and not (hasattr(kind, "find") or issubclass(kind, OTHERS))]
PARTS: dict[str, Callable[[Any], Any]] = {
    "DigitalSensor": lambda m: m.encoder,
    "DigitalActuator": lambda m: m.motor,
    "BinaryActuator[UpDown]": lambda m: m.step,
    "BinaryActuator[Rotation]": lambda m: m.direction,
    "BinaryActuator[S]": lambda m: m.valve,
    "BinaryActuator[Any]": lambda m: m.valve,
    "BinarySensor[Any]": lambda m: m.switch,
    "Vector[DigitalSensor]": lambda m: Vector([m.encoder]),
    "Vector[DigitalActuator]": lambda m: Vector([m.motor]),
    "S": lambda m: OnOff.ON,
    "TwoState": lambda m: OnOff.ON,
    "Servo": lambda m: Servo(m.encoder, m.motor, gain=1.0),
    "int": lambda m: 1,
}
"""What a law is made of, by its annotation."""
NUMBERS = {"low": 10.0, "high": 30.0, "dt": 0.001, "derivative_time": 0.1, "filter_time": 0.01, "velocity": 10.0} | {
    "acceleration": 100.0, "jerk": 1e4, "window": 0.1, "following_error": 5.0, "step_size": 0.05, "position": 51.0,
}  # fmt: skip
"""Good values by their names; all others are 1."""


def is_number(annotation: object) -> bool:
    return "float" in str(annotation) or "FloatArray" in str(annotation)


def number(name: str, annotation: object, value: float | None = None) -> Any:
    value = NUMBERS.get(name, 1.0) if value is None else value
    return np.array([value]) if "FloatArray" in str(annotation) else value


def make(kind: Any, m: Rig | None, **changes: Any) -> Any:
    given = {
        each.name: number(each.name, each.type) if is_number(each.type) else PARTS[str(each.type)](m)
        for each in fields(kind)
        if each.init and (is_number(each.type) or each.default is MISSING)
    }
    return kind(**given | changes)


def calls(kind: type, base: type = object) -> list[tuple[str, str]]:
    """The methods that take numbers, and these."""
    found = inspect.getmembers(kind, inspect.isfunction)
    methods = [(name, each) for name, each in found if not name.startswith("_") and not hasattr(base, name)]
    return [
        (name, each.name)
        for name, method in methods
        for each in inspect.signature(method).parameters.values()
        if is_number(each.annotation)
    ]


def call(law: Any, method: str, **changes: Any) -> Any:
    parameters = inspect.signature(getattr(law, method)).parameters.values()
    given = {each.name: number(each.name, each.annotation) for each in parameters if is_number(each.annotation)}
    return getattr(law, method)(**given | changes)


def state(law: Any) -> dict[str, str]:
    kept = {name: value for name, value in vars(law).items() if isinstance(value, float | int | tuple | np.ndarray)}
    return {name: repr(value) for name, value in kept.items()}


def strange(things: object) -> list[str]:
    """What is NaN or infinite."""
    return [word for word in str(things).replace("[", " ").split() if "nan" in word or "inf" in word]


def test_nothing_of_the_package_is_left_out() -> None:
    rest = {kind.__name__ for kind in classes()} - {kind.__name__ for kind in (*LAWS, *STRATEGIES, *AXES)}
    states = {"AxisState", "Interruption", "LeftMotion", "Motion"}
    experiments = {
        "ActuatorOutput",
        "Baseline",
        "ControlLoop",
        "ElementLoop",
        "LawLoop",
        "LoopExperiments",
        "RelaySwitching",
        "SetpointOutput",
        "StepChange",
    }
    others = {"Axis", "Homing", "SearchResult", "Segment", "Setpoint"}
    assert rest == others | states | experiments  # an experiment is given what its law has not refused


# Laws ---------------------------------------------------------------------------------------------------


@BAD
@pytest.mark.parametrize(("kind", "method", "name"), [(kind, *each) for kind in LAWS for each in calls(kind)])
def test_a_law_refuses_what_is_not_finite_and_goes_on_as_if_nothing_had_been(
    kind: Any, method: str, name: str, bad: float
) -> None:
    """An infinity may be a limit: then everything stays finite."""
    with connect(rig()) as m, connect(rig()) as other:
        law, untouched = make(kind, m), make(kind, other)
        for machine, each in ((m, law), (other, untouched)):
            machine.encoder.referenced(True)
            put(machine.encoder, 15.0)
            periods(machine)
            call(each, "to" if kind is Profile else method)
            call(each, "step" if hasattr(kind, "step") else method)
        before, annotation = pending(m), inspect.signature(getattr(law, method)).parameters[name].annotation
        try:
            with np.errstate(all="ignore"):
                result = call(law, method, **{name: number(name, annotation, bad)})
        except REFUSED:
            assert state(law) == state(untouched)
            assert pending(m) == before
            for again in ("step", method):
                if hasattr(kind, again):
                    assert repr(call(law, again)) == repr(call(untouched, again))
        else:
            assert not isnan(bad)
            assert strange((result, pending(m))) == []
            assert strange(state(law)) == strange(state(untouched))


def settings_of(kinds: list[type]) -> list[tuple[type, str]]:
    return [(kind, each.name) for kind in kinds for each in fields(kind) if each.init and is_number(each.type)]


@BAD
@pytest.mark.parametrize(("kind", "name"), settings_of(LAWS))
def test_a_setting_that_is_not_finite_is_refused_where_it_is_declared_and_moves_nothing_later(
    kind: Any, name: str, bad: float
) -> None:
    with connect(rig()) as m:
        m.encoder.referenced(True)
        put(m.encoder, 15.0)
        periods(m)
        before, refused = pending(m), 0
        for value in (bad, np.array([bad])) if "FloatArray" in str(kind.__annotations__.get(name)) else (bad,):
            if value is bad and bad != inf:
                with pytest.raises(DeclarationError, match=rf"\.{name} must be "):
                    make(kind, m, **{name: bad})
            law = make(kind, m)
            if hasattr(law, "step"):
                call(law, "to" if kind is Profile else "step")
            setattr(law, name, value)
            for method in filter(partial(hasattr, law), ("control", "step", "to", "at")):
                try:
                    with np.errstate(all="ignore"):
                        result = call(law, method)
                except REFUSED:
                    refused += 1
                    assert pending(m) == before
                else:
                    assert strange((result, pending(m))) == []
                    before = pending(m)
        assert refused or not isnan(bad)


@BAD
@pytest.mark.parametrize(("kind", "name"), settings_of(STRATEGIES))
def test_a_homing_strategy_that_is_not_finite_is_refused_where_it_is_declared(kind: Any, name: str, bad: float) -> None:
    with pytest.raises(DeclarationError, match=rf"{kind.__name__}.{name} must be a finite number"):
        make(kind, rig(), **{name: bad})


@BAD
def test_a_value_that_is_not_finite_switches_nothing(bad: float) -> None:
    with (connection := connect(rig())) as m:
        m.encoder.referenced(True)
        periods(m)
        law = Hysteresis(m.encoder, m.valve, OnOff.ON, low=10.0, high=20.0)
        law.control()
        before = m.valve.pending
        image = connection.image
        image.values[image.slot_of[id(m.encoder)]] = bad  # as a linearization of the user's may give
        with pytest.raises(RangeError, match="cannot be controlled"):
            law.control()
        assert m.valve.pending is before


@pytest.mark.parametrize("settings", [{"integral_time": 0.0}, {"filter_time": -0.001}])
def test_a_setting_that_becomes_impossible_in_the_loop_moves_nothing(settings: dict[str, float]) -> None:
    with connect(rig()) as m:
        m.encoder.referenced(True)
        periods(m)
        law = Servo(m.encoder, m.motor, gain=1.0, derivative_time=0.1)
        vars(law).update(settings)
        with pytest.raises(RangeError, match="the output cannot be computed with these settings"):
            law.control(1.0, dt=0.001)
        assert m.motor.pending == 0.0


def test_many_pids_do_not_keep_the_callers_array() -> None:
    law, alone = (VectorPID(gain=1.0, derivative_time=0.5, filter_time=0.1) for _ in range(2))
    buffer = np.zeros(3)
    for value in (1.0, 2.0, 4.0):
        buffer[:] = value
        assert list(law.step(0.0, buffer, 0.1)) == list(alone.step(0.0, np.full(3, value), 0.1))


# Axes ---------------------------------------------------------------------------------------------------


def axis(kind: Any, **changes: Any) -> Any:
    given: dict[str, Any] = {"encoder": encoder(), "motor": motor()} | {
        "step": BinaryActuator(UpDown, one=UpDown.UP, default=UpDown.DOWN),
        "direction": BinaryActuator(Rotation, one=Rotation.CW, default=Rotation.CW),
    }
    numbers = {name: NUMBERS.get(name, 1.0) for name in numbers_of(kind) if not hasattr(kind, name)}
    return kind(**{name: part for name, part in given.items() if name in annotated(kind)} | numbers | changes)


def annotated(kind: type) -> dict[str, str]:
    return {name: of for each in reversed(kind.__mro__) for name, of in inspect.get_annotations(each).items()}


def numbers_of(kind: type) -> list[str]:
    return [name for name, annotation in annotated(kind).items() if annotation == "float"]


class Portal(Compound):
    x: Any
    y: Any
    timer: DigitalSensor


@BAD
@pytest.mark.parametrize(("kind", "method", "name"), [(kind, *each) for kind in AXES for each in calls(kind, Compound)])
@pytest.mark.parametrize("enabled", [False, True])
def test_an_axis_refuses_what_is_not_finite_and_does_not_move(
    kind: Any, method: str, name: str, enabled: bool, bad: float
) -> None:
    with connect(Portal(x=axis(kind), y=axis(kind), timer=timer())) as m:
        m.x.encoder.referenced(at=50.0)
        if enabled:
            m.x.enable()
        before = pending(m)

        async def work() -> None:
            result = call(m.x, method, **{name: bad})
            if inspect.isawaitable(result):
                await result

        m.cycle.start(work())
        try:
            periods(m, 3)
        except REFUSED:
            assert m.x.enabled is enabled
            assert m.x.state in (AxisState.STANDSTILL, AxisState.DISABLED)
            assert pending(m) == before
        except umo.errors.AxisError:
            assert not enabled
        else:
            assert not isnan(bad)
            assert strange((pending(m), m.x.profile.setpoint)) == []


@pytest.mark.parametrize(("kind", "name"), [(kind, name) for kind in AXES for name in numbers_of(kind)])
def test_an_axis_with_a_number_that_is_nan_is_refused_where_it_is_declared(kind: Any, name: str) -> None:
    with pytest.raises(DeclarationError, match=rf"{name} must be "):
        Portal(x=axis(kind, **{name: nan}), y=axis(kind), timer=timer())


@BAD
@pytest.mark.parametrize("kind", AXES)
def test_an_axis_whose_encoder_has_no_value_does_not_go_on(kind: Any, bad: float) -> None:
    with (connection := connect(Portal(x=axis(kind), y=axis(kind), timer=timer()))) as m:
        m.x.encoder.referenced(at=50.0)
        m.x.jog(5.0)
        periods(m, 20)
        image = connection.image
        image.values[image.slot_of[id(m.x.encoder)]] = bad  # as a linearization may give
        with pytest.raises((RangeError, umo.errors.AxisError)):
            m.control()


@BAD
def test_axes_that_move_together_move_all_or_none(bad: float) -> None:
    with connect(Portal(x=axis(AXES[0]), y=axis(AXES[-1]), timer=timer())) as m:
        for each in (m.x, m.y):
            each.encoder.referenced(at=50.0)
        m.cycle.start(move_together((m.x, 60.0), (m.y, bad)))
        with pytest.raises(RangeError):
            periods(m)
        assert not m.x.enabled


# Shipped actions ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", stations())
def test_no_action_that_ships_takes_a_number_that_is_not_finite(name: str) -> None:
    with (connection := connect(stations()[name]())) as m:
        for node in walk(m):
            if isinstance(node, DigitalSensor) and node.incremental:
                node.referenced(True)
            if isinstance(node, BinarySensor) and node.path == "emergency_stop":
                put(node, node.one)
        periods(m)
        before, tried = pending(m), 0
        for offered in actions_of(m).values():
            numbers = [each for each in offered.arguments if each.kind in ("number", "integer")]
            for one in numbers:
                good = {each.name: each.range.maximum for each in numbers if each.range and each.required}
                for bad in (nan, inf, -inf):
                    tried += 1
                    given = good | {one.name: bad}
                    with pytest.raises(RangeError):
                        offered.converted(given)  # from outside
                    if bad == inf and not one.required:
                        continue  # the largest
                    with pytest.raises(REFUSED):  # and from the program
                        result = offered.call(**given)
                        m.cycle.start(result)
                        periods(m)
                    connection.machine.sequences.cancel()
                    assert pending(m) == before, (offered.path, given)
        takes_numbers = any(each.range for offered in actions_of(m).values() for each in offered.arguments)
        assert bool(tried) is takes_numbers
