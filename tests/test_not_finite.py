"""NaN and infinities never move anything: every law, profile, axis and shipped action raises before it writes."""

from __future__ import annotations

import copy
from collections.abc import Callable
from math import inf, nan
from typing import Any

import numpy as np
import pytest

from helpers.machines import timer
from umo import (
    BadInput,
    BinaryActuator,
    Compound,
    DeclarationError,
    DigitalActuator,
    DigitalSensor,
    EnableDisable,
    OnOff,
    OpenClosed,
    RangeError,
    Rotation,
    UpDown,
    Vector,
    connect,
)
from umo.control import (
    PID,
    EndStop,
    HomeSwitch,
    Hysteresis,
    IndexPulse,
    Profile,
    Servo,
    ServoAxis,
    StepperAxis,
    Stepping,
    VectorPID,
    VectorServo,
)
from umo.objects import actions_of
from umo.stations.conveyor.objects import machine as conveyor
from umo.stations.furnace.objects import machine as furnace
from umo.stations.ztheta.objects import machine as ztheta
from umo.testing import periods, put

BAD = pytest.mark.parametrize("bad", [nan, inf, -inf])
REFUSED = (RangeError, DeclarationError, BadInput)


class Rig(Compound):
    """The defaults of its actuators are not what NaN could be taken for."""

    timer: DigitalSensor
    encoder: DigitalSensor
    motor: DigitalActuator
    drive: DigitalActuator
    step: BinaryActuator[UpDown]
    direction: BinaryActuator[Rotation]
    valve: BinaryActuator[OnOff]


def rig() -> Rig:
    return Rig(
        timer=timer(),
        encoder=DigitalSensor("mm", minimum=0.0, maximum=100.0, resolution=0.01),
        motor=DigitalActuator("V", default=0.0, minimum=-10.0, maximum=10.0, resolution=0.01, limits="clamp"),
        drive=DigitalActuator("mA", default=12.0, minimum=4.0, maximum=20.0, resolution=0.01, limits="clamp"),
        step=BinaryActuator(UpDown, one=UpDown.UP, default=UpDown.DOWN),
        direction=BinaryActuator(Rotation, one=Rotation.CW, default=Rotation.CW),
        valve=BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF),
    )


def pending(m: Compound) -> list[Any]:
    return [each.pending for each in m.atoms() if isinstance(each, BinaryActuator | DigitalActuator)]


def servo(m: Rig) -> Callable[..., object]:
    law = Servo(m.encoder, m.motor, gain=1.0, integral_time=1.0, derivative_time=0.1, feed_forward=0.1, inertia=0.1)
    return lambda setpoint=1.0, velocity=0.0, acceleration=0.0, dt=0.001: law.control(
        setpoint, velocity, acceleration, dt=dt
    )


def vector_servo(m: Rig) -> Callable[..., object]:
    law = VectorServo(Vector([m.encoder]), Vector([m.motor]), gain=1.0, integral_time=1.0, derivative_time=0.1)
    return lambda setpoint=1.0, dt=0.001: law.control(np.array([setpoint]), dt=dt)


def stepping(m: Rig) -> Callable[..., object]:
    law = Stepping(m.step, m.direction)
    return lambda position=5.0: law.control(position)


@BAD
@pytest.mark.parametrize(
    ("make", "name"),
    [
        *((servo, name) for name in ("setpoint", "velocity", "acceleration", "dt")),
        *((vector_servo, name) for name in ("setpoint", "dt")),
        (stepping, "position"),
    ],
)
def test_a_law_refuses_an_input_that_is_not_finite_and_writes_nothing(
    make: Callable[[Rig], Callable[..., object]], name: str, bad: float
) -> None:
    with connect(rig()) as m:
        put(m.encoder, 20.0)
        periods(m)
        control = make(m)
        for _ in range(7):  # also in the middle of a step
            control()
            m.update()
            before = pending(m)
            with pytest.raises(REFUSED), np.errstate(invalid="ignore"):
                control(**{name: bad})
            assert pending(m) == before


@BAD
def test_a_setting_that_becomes_infinite_in_the_loop_moves_nothing(bad: float) -> None:
    with connect(rig()) as m:
        put(m.encoder, 20.0)
        periods(m)
        one = Servo(m.encoder, m.motor, gain=1.0)
        many = VectorServo(Vector([m.encoder]), Vector([m.motor]), gain=np.ones(1), integral_time=np.ones(1))
        for settings in ({"gain": bad}, {"integral_time": 0.0}):
            for law in (one, many):
                for name, value in settings.items():
                    setattr(law, name, value if law is one else np.array([value]))
                with pytest.raises(RangeError), np.errstate(all="ignore"):
                    law.control(1.0, dt=0.001)
                assert m.motor.pending == 0.0
        one.integral_time, one.gain, one.filter_time = 1.0, 1.0, -0.001
        with pytest.raises(RangeError, match="no output with these settings"):
            one.control(1.0, dt=0.001)


@BAD
def test_a_value_that_is_not_finite_switches_nothing(bad: float, monkeypatch: pytest.MonkeyPatch) -> None:
    with connect(rig()) as m:
        periods(m)
        law = Hysteresis(m.encoder, m.valve, OnOff.ON, low=10.0, high=20.0)
        law.control()
        before = m.valve.pending
        m.encoder._image.values[m.encoder._slot] = bad  # as a linearization of the user's may give
        with pytest.raises(RangeError, match="no value to regulate by"):
            law.control()
        assert m.valve.pending is before


@BAD
@pytest.mark.parametrize("name", ["to", "to at a velocity", "to in a time", "at", "hold", "hold at", "shift", "step"])
def test_a_profile_refuses_what_is_not_finite_and_goes_on(name: str, bad: float) -> None:
    profile, untouched = (Profile(velocity=100.0, acceleration=1e3, jerk=1e5) for _ in range(2))
    for each in (profile, untouched):
        each.to(10.0)
        each.step(0.05)
    calls: dict[str, Callable[[], object]] = {
        "to": lambda: profile.to(bad),
        "to at a velocity": lambda: profile.to(1.0, velocity=bad),
        "to in a time": lambda: profile.to(1.0, duration=bad),
        "at": lambda: profile.at(bad),
        "hold": lambda: profile.hold(bad),
        "hold at": lambda: profile.hold(0.0, bad),
        "shift": lambda: profile.shift(bad),
        "step": lambda: profile.step(bad),
    }
    if (name, bad) in (("to at a velocity", inf), ("at", inf), ("at", -inf)):
        calls[name]()  # the largest speed
        profile.step(0.05)
        assert abs(profile.setpoint.velocity) <= 100.0
        return
    with pytest.raises(RangeError):
        calls[name]()
    if name != "step":
        assert profile.step(0.01) == untouched.step(0.01)


@BAD
def test_a_pid_refuses_a_shift_and_a_take_over(bad: float) -> None:
    law, untouched = PID(gain=1.0, derivative_time=0.1), PID(gain=1.0, derivative_time=0.1)
    for each in (law, untouched):
        each.step(1.0, 0.0, 0.1)
    for call in (lambda: law.shift(bad), lambda: law.take_over(bad, 0.0, 0.0)):
        with pytest.raises(RangeError):
            call()
    assert law.step(1.0, 0.5, 0.1) == untouched.step(1.0, 0.5, 0.1)


@BAD
def test_a_homing_strategy_that_is_not_finite_is_refused_where_it_is_declared(bad: float) -> None:
    enable = BinaryActuator(EnableDisable, one=EnableDisable.ENABLE, default=EnableDisable.DISABLE)
    switch = conveyor().emergency_stop
    good: dict[Any, dict[str, Any]] = {
        IndexPulse: {"enable": enable, **dict.fromkeys(("index", "stop", "jump", "tolerance", "clearance"), 1.0)},
        HomeSwitch: {"switch": switch, "active": OpenClosed.OPEN, "position": 1.0, "creep_speed": 1.0},
        EndStop: {"position": 1.0, "clearance": 1.0},
    }
    for kind, arguments in good.items():
        kind(**arguments)
        for name, value in arguments.items():
            if isinstance(value, float):
                with pytest.raises(DeclarationError, match=f"{kind.__name__}.{name} must be a finite number"):
                    kind(**arguments | {name: bad})


AXES: dict[str, Callable[[], Any]] = {
    "servo": lambda: ServoAxis(
        motor=DigitalActuator("V", default=0.0, minimum=-10.0, maximum=10.0, resolution=0.01, limits="clamp"),
        encoder=DigitalSensor("mm", minimum=0.0, maximum=100.0, resolution=0.01, incremental=True),
        gain=1.0, velocity=10.0, acceleration=100.0, jerk=1e4, window=0.1, following_error=5.0,
    ),
    "stepper": lambda: StepperAxis(
        step=BinaryActuator(UpDown, one=UpDown.UP, default=UpDown.DOWN),
        direction=BinaryActuator(Rotation, one=Rotation.CW, default=Rotation.CW),
        encoder=DigitalSensor("mm", minimum=0.0, maximum=100.0, resolution=0.01, incremental=True),
        step_size=0.05, velocity=10.0, acceleration=100.0, jerk=1e4, window=0.1, following_error=5.0,
    ),
}  # fmt: skip


class Portal(Compound):
    x: Any
    timer: DigitalSensor


@BAD
@pytest.mark.parametrize("kind", AXES)
@pytest.mark.parametrize("name", ["position", "speed", "duration", "velocity"])
def test_an_axis_refuses_what_is_not_finite_and_stays_without_power(kind: str, name: str, bad: float) -> None:
    with connect(Portal(x=AXES[kind](), timer=timer())) as m:
        m.x.encoder.referenced(at=50.0)
        before = pending(m)
        given = {"position": 51.0} | {name: bad}
        if (name, bad) == ("speed", inf):
            return  # the largest speed

        async def work() -> None:
            if name == "velocity":
                m.x.jog(bad)
            else:
                await m.x.move_to(**given)

        m.start(work())
        with pytest.raises(RangeError):
            periods(m, 3)
        assert not m.x.enabled
        assert m.x.claim.holder is None
        assert pending(m) == before


@pytest.mark.parametrize("make", [ztheta, conveyor, furnace])
def test_no_action_that_ships_takes_a_number_that_is_not_finite(make: Callable[[], Compound]) -> None:
    tried = 0
    with connect(make()) as m:
        if isinstance(m, type(conveyor())):
            put(m.find("emergency_stop"), OpenClosed.CLOSED)  # type: ignore[arg-type]
        for node in m.walk():
            if isinstance(node, DigitalSensor) and node.incremental:
                node.referenced(True)
        periods(m)
        before = pending(m)
        for offered in actions_of(m).values():
            numbers = [each for each in offered.arguments if each.kind in ("number", "integer")]
            for number in numbers:
                good = {each.name: each.range.maximum for each in numbers if each.range and each.required}
                for bad in (nan, inf, -inf):
                    given = copy.copy(good) | {number.name: bad}
                    with pytest.raises(RangeError):
                        offered.converted(given)  # from outside
                    tried += 1
                    if number.name == "speed" and bad == inf and not number.required:
                        continue  # the largest
                    with pytest.raises(REFUSED):  # and from the program
                        result = offered.call(**given)
                        m.start(result)
                        periods(m)
                    m._machine.sequences.cancel()  # type: ignore[attr-defined]
                    assert pending(m) == before, (offered.path, given)
    assert tried


def test_many_pids_do_not_keep_the_callers_array() -> None:
    law, alone = (VectorPID(gain=1.0, derivative_time=0.5, filter_time=0.1) for _ in range(2))
    buffer = np.zeros(3)
    for value in (1.0, 2.0, 4.0):
        buffer[:] = value
        assert list(law.step(0.0, buffer, 0.1)) == list(alone.step(0.0, np.full(3, value), 0.1))
