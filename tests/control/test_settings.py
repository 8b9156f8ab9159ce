"""Settings of laws and tunable numbers: refused where they are declared, wired or tuned, and an int stays an int."""

from __future__ import annotations

from math import inf, nan
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pytest

from helpers.machines import actuator, relay, sensor, timer
from umo import (
    BinaryActuator,
    Compound,
    DigitalActuator,
    DigitalSensor,
    Interlock,
    Number,
    Range,
    Vector,
    action,
    connect,
)
from umo.control import PID, Hysteresis, Servo, VectorPID, VectorServo
from umo.errors import DeclarationError, RangeError
from umo.objects import actions_of, atoms, numbers_of
from umo.states import OnOff
from umo.system.packages import SHIPPED
from umo.testing import periods, put
from umo_command.values import number as typed

NOT_SETTINGS: list[tuple[str, Any]] = [
    ("gain", nan), ("gain", inf), ("gain", "2"), ("gain", True), ("integral_time", 0.0), ("integral_time", -1.0),
    ("integral_time", nan), ("derivative_time", -0.1), ("derivative_time", inf), ("filter_time", -0.001),
]  # fmt: skip


class Oven(
    Compound,
    numbers={
        "servo.integral_time": Number("s", 0.0, 10.0, tunable=True),
        "servo.filter_time": Number("s", -1.0, 10.0, tunable=True),
        "hysteresis.low": Number("mm", 0.0, 100.0, tunable=True),
        "count": Number("", 0.0, 10.0, tunable=True),
    },
):
    timer: DigitalSensor
    temperature: DigitalSensor
    heater: DigitalActuator
    drive: DigitalActuator
    valve: BinaryActuator[OnOff]
    retries: Annotated[int, Number("", 0.0, inf, tunable=True)] = 3
    speed: Annotated[float, Number("mm/s", 0.0, 10.0, tunable=True)] = 5
    limit: float = 50.0

    def setup(self) -> None:
        self.servo = Servo(self.temperature, self.heater, gain=1.0, integral_time=2.0, filter_time=0.1)
        self.hysteresis = Hysteresis(self.temperature, self.valve, OnOff.ON, low=10.0, high=20.0)
        self.count = 2

    def interlocks(self) -> Any:
        yield Interlock(lambda: self.temperature.read() > self.limit, [self.valve], "too hot")

    @action(number=Range("", -inf, inf), force=Range("N", 0.0, inf))
    def take(self, number: int = 0, force: float = 0.0) -> int:
        """It."""
        return number


def oven() -> Oven:
    drive = DigitalActuator("mA", default=4.0, minimum=4.0, maximum=20.0, resolution=0.01)
    return Oven(timer=timer(), temperature=sensor(), heater=actuator(), drive=drive, valve=relay())


@pytest.mark.parametrize(("name", "value"), NOT_SETTINGS)
def test_a_setting_that_no_law_can_have_is_refused_where_it_is_declared(name: str, value: Any) -> None:
    m = oven()
    settings: dict[str, Any] = {"gain": 1.0} | {name: value}
    for make in (
        lambda: PID(**settings),
        lambda: Servo(m.temperature, m.heater, **settings),
        lambda: VectorPID(**settings),
        lambda: VectorPID(**settings | {name: np.array([1.0, value], object if isinstance(value, str) else None)}),
    )[: 3 if value is True else 4]:
        with pytest.raises(DeclarationError, match=rf"\.{name} must be "):
            make()


def test_an_array_is_a_setting_of_many_alone_and_has_a_number_for_each() -> None:
    m = oven()
    with pytest.raises(DeclarationError, match=r"PID\.gain must be a finite number"):
        PID(gain=np.ones(1))  # type: ignore[arg-type]
    with pytest.raises(DeclarationError, match=r"VectorPID.gain must be a finite number, not \[1.0\]"):
        VectorPID(gain=[1.0])  # type: ignore[arg-type]
    sensors, actuators = Vector([m.temperature]), Vector([m.heater])
    VectorServo(sensors, actuators, gain=np.ones(1))
    with pytest.raises(DeclarationError, match=r"VectorServo\.integral_time must be a number, or an array of 1"):
        VectorServo(sensors, actuators, gain=1.0, integral_time=np.ones(2))


def test_bounds_of_a_hysteresis_in_the_wrong_order_or_of_another_state_are_refused() -> None:
    m = oven()
    with pytest.raises(DeclarationError, match="low 30 is above high 20"):
        Hysteresis(m.temperature, m.valve, OnOff.ON, low=30.0, high=20.0)
    with pytest.raises(DeclarationError, match="is not a state of OnOff"):
        Hysteresis(m.temperature, m.valve, True, low=1.0, high=2.0)  # type: ignore[type-var]


@pytest.mark.parametrize(
    ("path", "value", "said"),
    [
        ("servo.integral_time", 0, r"Servo\.integral_time must be above 0, not 0"),
        ("servo.filter_time", -0.001, r"Servo\.filter_time must be finite and not below 0"),
        ("hysteresis.low", 30.0, "low 30 is above high 20"),
    ],
)
def test_what_a_law_refuses_is_refused_when_it_is_wired_or_tuned(path: str, value: float, said: str) -> None:
    m = oven()
    wire = {item.path: {"driver": "simulated"} for item in atoms(m)}
    wire["timer"]["period"] = "1 ms"
    with (
        pytest.raises(DeclarationError, match=f"the wiring's parameter {path}: .*{said}"),
        connect(m, {"wire": wire, "parameters": {path: value}}),
    ):
        pass
    tunable = numbers_of(m)[path]
    before = tunable.read()
    with pytest.raises(RangeError, match=f"{path}: .*{said}"):
        tunable.set(value)
    assert tunable.read() == before


def test_settings_of_a_law_that_depend_on_one_another_are_checked_when_all_are_set() -> None:
    m = oven()
    wire = {item.path: {"driver": "simulated"} for item in atoms(m)}
    wire["timer"]["period"] = "1 ms"
    both = {"hysteresis.low": 60.0, "hysteresis.high": 70.0}
    with connect(m, {"wire": wire, "parameters": both}):
        assert (m.hysteresis.low, m.hysteresis.high) == (60.0, 70.0)
    assert (m.hysteresis.low, m.hysteresis.high) == (10.0, 20.0)


def test_a_tunable_integer_stays_one() -> None:
    m = oven()
    tunables = numbers_of(m)
    for path, value in (("retries", 5), ("retries", 6.0), ("retries", 2**60 + 1), ("count", 3.0)):
        tunables[path].set(value)
        now = getattr(m, path)
        assert (now, type(now)) == (value, int)
    with pytest.raises(RangeError, match=r"retries: 2\.5 is not a whole number"):
        tunables["retries"].set(2.5)
    tunables["speed"].set(2.5)  # an int is written for a float
    assert m.speed == 2.5


def test_integers_of_any_size_arrive_as_they_are_or_are_refused() -> None:
    take = actions_of(oven())["take"]
    for number in (2**53 + 1, -(2**60) - 1, 10**300 + 7, 3.0, 1e16):
        assert take.converted({"number": number}) == {"number": number}
        assert type(take.converted({"number": number})["number"]) is int
    for name in ("number", "force"):
        for bad in (10**400, -(10**400), nan, inf, True, "1"):
            with pytest.raises(RangeError, match=f"take: {name}: .* is not a number"):
                take.converted({name: bad})
    with pytest.raises(RangeError, match="is not a whole number"):
        take.converted({"number": 2.5})
    assert (
        typed("number", "9007199254740993", "mm") == 2**53 + 1
    )  # as `umo tune number` and `umo do STATION call` read it
    assert typed("number", "9007199254740993 mm", "mm") == 2**53 + 1
    with pytest.raises(RangeError, match="too large"):
        typed("number", "9" * 400, "mm")


def test_a_hysteresis_returns_what_the_actuator_has_accepted() -> None:
    with connect(oven()) as m:
        put(m.temperature, 5.0)
        periods(m)
        assert m.hysteresis.control() is OnOff.ON
        m.limit = -1.0
        periods(m)
        assert m.valve.inhibited == "too hot"
        assert m.hysteresis.control() is OnOff.OFF is m.valve.pending


@pytest.mark.parametrize(("limit", "least", "most"), [(inf, 4.0, 20.0), (100.0, 4.0, 20.0), (3.0, 4.0, 7.0)])
def test_the_limit_of_a_servo_counts_from_the_default_of_its_actuator(limit: float, least: float, most: float) -> None:
    """4 to 20 mA do not contain 0."""
    with connect(oven()) as m:
        put(m.temperature, 50.0)
        periods(m)
        law = Servo(m.temperature, m.drive, gain=100.0, limit=limit)
        for setpoint, output in ((0.0, least), (100.0, most)):
            law.control(setpoint, dt=0.001)
            assert m.drive.pending == output


@pytest.mark.parametrize(
    ("path", "said"),
    [
        ("z.servo.integral_time", "z.servo.integral_time: 0 s is outside 0.01 to 1"),
        ("z.integral_time", "integral_time must be above 0, not 0.0"),
    ],
)
def test_check_finds_a_wired_setting_that_no_law_can_have(umo: Any, tmp_path: Path, path: str, said: str) -> None:
    simulated = (SHIPPED / "ztheta" / "wiring" / "simulated.toml").read_text(encoding="utf-8")
    head, _, rest = simulated.partition("[parameters]")
    file = tmp_path / "wrong.toml"
    file.write_text(f'{head}[parameters]\n"{path}" = 0.0\n{rest}', encoding="utf-8")
    result = umo("check", "ztheta", "-w", str(file))
    assert result.exit_code == 2
    assert said in result.stderr
    assert len(result.stderr.splitlines()) <= 2
