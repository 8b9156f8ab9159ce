"""`umo check` finds numbers whose unit is not the one in which laws and objects use them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from helpers.checked_code import own_modules, told
from umo.objects.units import is_quotient
from umo.process.station import find
from umo_command.check.code_units import wrong_settings

OBJECTS = """
from typing import Annotated

from umo import BinaryActuator, Compound, DigitalActuator, DigitalSensor, Number, Vector
from umo.control import Cascade, Hysteresis, Servo, VectorServo, value_of
from umo.states import OnOff


class Oven(Compound, numbers=NUMBERS):
    heater: DigitalActuator
    jacket: DigitalSensor
    vessel: DigitalSensor
    fan: BinaryActuator[OnOff]
    timer: DigitalSensor
    target: Annotated[float, Number("degC", 0.0, 300.0)] = 20.0
    same: Annotated[float, Number("kelvin", 0.0, 600.0)] = 300.0
    power: Annotated[float, Number("kW", 0.0, 2.0)] = 0.0
    plain: float = 300.0

    def setup(self) -> None:
        self.servo = Servo(self.jacket, self.heater, gain=1.0)
        self.cascade = Cascade(self.vessel, self.servo, low=280.0, high=400.0, gain=1.0)
        self.many = VectorServo(Vector([self.jacket]), Vector([self.heater]), gain=1.0)
        self.regulator = Hysteresis(self.jacket, self.fan, OnOff.ON, low=300.0, high=310.0)

    def control(self) -> None:
        CODE


def machine() -> Oven:
    return Oven(
        heater=DigitalActuator("percent", default=0.0, minimum=0.0, maximum=100.0, resolution=0.1),
        jacket=DigitalSensor("K", minimum=250.0, maximum=600.0, resolution=0.1),
        vessel=DigitalSensor("degC", minimum=-20.0, maximum=300.0, resolution=0.1),
        fan=BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF),
        timer=DigitalSensor("sampling_period", minimum=0, maximum=99_999, resolution=1, synchronous=False),
    )
"""


@pytest.fixture(autouse=True)
def alone() -> Iterator[None]:
    with own_modules():
        yield


def oven(folder: Path, code: str = "pass", numbers: str = "") -> Path:
    text = OBJECTS.replace("CODE", code).replace("NUMBERS", f"{{{numbers}}}")
    (folder / "oven").mkdir()
    (folder / "oven" / "objects.py").write_text(text)
    (folder / "oven" / "application.py").write_text(
        "from .objects import Oven\n\n\nasync def main(m: Oven):\n    pass\n"
    )
    return folder / "oven"


TAKES = "`self.target` is in degC, but `self.{}.control` takes a number in K"
COMPARED = "`{}` is in K, but is compared with a number in degC"


@pytest.mark.parametrize(
    ("code", "text"),
    [
        ("self.servo.control(self.target, dt=self.dt)", TAKES.format("servo")),
        ("self.servo.control(setpoint=self.target, dt=self.dt)", TAKES.format("servo")),
        ("self.many.control(self.target, dt=self.dt)", TAKES.format("many")),
        ("self.heater.write(self.power)", "`self.power` is in kW, but `self.heater.write` takes a number in percent"),
        (
            "self.servo.control(self.vessel.read(), dt=self.dt)",
            "`self.vessel.read()` is in degC, but `self.servo.control` takes a number in K",
        ),
        ("return self.jacket.read() > self.target", COMPARED.format("self.jacket.read()")),
        ("return 0.0 < self.jacket.read() < self.vessel.read()", COMPARED.format("self.jacket.read()")),
    ],
)
def test_a_number_in_another_unit_is_an_error_with_its_line(tmp_path: Path, code: str, text: str) -> None:
    line = 1 + OBJECTS[: OBJECTS.index("CODE")].count("\n")
    assert told(find(oven(tmp_path, code))) == [f"objects.py:{line}: {text}"]


@pytest.mark.parametrize(
    "code",
    [
        "self.cascade.control(self.target, dt=self.dt)",
        "self.servo.control(self.same, dt=self.dt)",  # K by another name
        "self.servo.control(self.plain, dt=self.dt)",
        "self.servo.control(self.target + 273.15, dt=self.dt)",
        "self.servo.control(self.vessel.read_in('K'), dt=self.dt)",
        "return self.jacket.read_in('degC') > self.target",
        "return abs(self.cascade.error) > self.target",
        "return self.cascade.error > self.same",  # the law shows this difference in degC
    ],
)
def test_the_same_unit_and_one_that_is_not_known_are_no_errors(tmp_path: Path, code: str) -> None:
    assert told(find(oven(tmp_path, code))) == []


@pytest.mark.parametrize(
    ("number", "unit", "text"),
    [
        ("servo.gain", "V/mm", "the gain of this law is in percent for each K of its measurement, not V/mm"),
        ("servo.gain", "1/K", "the gain of this law is in percent for each K of its measurement, not 1/K"),
        ("many.gain", "percent", "the gain of this law is in percent for each K of its measurement, not percent"),
        ("cascade.gain", "percent/K", "the gain of this law is in K for each degC of its measurement, not percent/K"),
        ("cascade.high", "degC", "the law uses this number in K, not degC"),
        ("regulator.low", "degC", "the law uses this number in K, not degC"),
        ("servo.friction", "V", "the law uses this number in percent, not V"),
        ("servo.integral_time", "min", "the law uses this number in s, not min"),
        ("many.filter_time", "ms", "the law uses this number in s, not ms"),
    ],
)
def test_a_setting_of_a_law_in_another_unit_is_an_error(tmp_path: Path, number: str, unit: str, text: str) -> None:
    station = find(oven(tmp_path, numbers=f'"{number}": Number("{unit}", tunable=True)'))
    assert list(map(str, wrong_settings(station.machine(), "oven"))) == [f"oven: {number}: {text}"]


@pytest.mark.parametrize(
    ("number", "unit"),
    [
        ("servo.gain", "percent/K"),
        ("servo.gain", "percent/degC"),
        ("servo.gain", ""),
        ("cascade.gain", "K/K"),
        ("servo.integral_time", "second"),
        ("cascade.low", "kelvin"),
    ],
)
def test_a_setting_in_the_unit_of_its_law_or_without_one_is_no_error(tmp_path: Path, number: str, unit: str) -> None:
    station = find(oven(tmp_path, numbers=f'"{number}": Number("{unit}", tunable=True)'))
    assert wrong_settings(station.machine(), "oven") == []


@pytest.mark.parametrize(
    ("unit", "dividend", "divisor", "is_one"),
    [
        ("V/mm", "V", "mm", True),
        ("mV/um", "V", "mm", True),
        ("V/um", "V", "mm", False),
        ("percent/K", "percent", "degC", True),
        ("percent*s/mm", "percent", "mm/s", True),
        ("V", "V", "mm", False),
        ("dBm", "V", "mm", False),
        ("V/dBm", "V", "dBm", None),
    ],
)
def test_a_unit_is_the_quotient_of_two_others(unit: str, dividend: str, divisor: str, is_one: bool | None) -> None:
    assert is_quotient(unit, dividend, divisor) is is_one


def test_umo_check_says_so_and_fails(tmp_path: Path, umo) -> None:
    oven(tmp_path, "self.servo.control(self.target, dt=self.dt)", '"servo.gain": Number("V/mm", tunable=True)')
    result = umo("check", "oven")
    assert result.exit_code == 2
    assert "oven: servo.gain: the gain of this law is in percent for each K of its measurement" in result.stderr
    assert TAKES.format("servo") in result.stderr
    assert "umo: 2 errors in the code" in result.stderr
