from __future__ import annotations

import contextlib
import math
import subprocess
import sys
from itertools import product

import pytest
from hypothesis import given
from hypothesis import strategies as st

from helpers.machines import sensor
from umo import Compound, DigitalSensor, connect
from umo.drivers.faults.fault_syntax import InjectedFault
from umo.drivers.gpio.channel import checked
from umo.drivers.option_checks import duration
from umo.duration import seconds
from umo.errors import DeclarationError, RangeError, WiringError
from umo.objects import units
from umo.objects.units import check_unit, convert
from umo.testing import put
from umo.wiring.off_cycle_table import driver_table
from umo.wiring.source import WiringSource


@pytest.mark.parametrize("unit", ["V", "um", "deg", "count", "sampling_period", "mm/s", "degC", "percent"])
def test_units_are_pints_and_the_sampling_period(unit):
    assert check_unit(unit) == unit


def test_what_is_made_of_the_usual_units_is_accepted_without_pint_and_known_to_it(monkeypatch):
    usual = sorted(units._USUAL)
    beside = ("m", "s", "degC", "dBm", "%")  # one and another, with an offset, with a logarithm, not a word
    pairs = {*product(usual, beside), *product(beside, usual)}
    made = [*usual, *(f"{one}{sign}{other}" for one, other in sorted(pairs) for sign in "*/")]
    parse = units.registry().parse_units
    monkeypatch.setattr(units, "registry", lambda: pytest.fail("pint was asked"))
    for unit in made:
        assert parse(units._checked_unit.__wrapped__(unit)) is not None


@pytest.mark.parametrize("unit", ["parsnip", "m s)", "V(", "furlong per"])
def test_an_unknown_unit_is_an_error_at_declaration(unit):
    with pytest.raises(DeclarationError, match="is not a unit that pint knows"):
        DigitalSensor(unit, minimum=0.0, maximum=1.0, resolution=0.1)


@pytest.mark.parametrize(
    ("value", "source", "target", "expected"),
    [
        (80_000.0, "um", "mm", 80.0),
        (180.0, "deg", "rad", math.pi),
        (20.0, "degC", "kelvin", 293.15),
        (1.0, "V", "mV", 1e3),
    ],
)
def test_conversion(value, source, target, expected):
    assert convert(value, source, target) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("value", "source", "target", "expected"),
    [
        (30.0, "dBm", "mW", 1000.0),
        (-10.0, "dBm", "mW", 0.1),
        (1.0, "W", "dBm", 30.0),
        (3.0, "dBm", "dBW", -27.0),
        (20.0, "dB", "dimensionless", 100.0),
    ],
)
def test_logarithmic_units_are_converted_value_by_value(value, source, target, expected):
    assert convert(value, source, target) == pytest.approx(expected, rel=1e-12)


def test_a_value_that_a_logarithmic_unit_cannot_express_is_a_range_error():
    for value in (0.0, -1.0):
        with pytest.raises(RangeError, match="mW cannot be expressed in dBm"):
            convert(value, "mW", "dBm")


def test_read_in_converts_logarithmic_units():
    class Receiver(Compound):
        power: DigitalSensor

    receiver = Receiver(power=DigitalSensor("dBm", minimum=-100.0, maximum=50.0, resolution=0.1))
    with connect(receiver):
        put(receiver.power, 10.0)
        receiver.sample()
        assert receiver.power.read_in("mW") == pytest.approx(10.0)


@pytest.mark.parametrize("unit", ["kg*m/s**2", "W/(m*K)", "m per s", "m/s²", "1/min", "V/Hz**0.5", "°C", "ft_H2O", "%"])
def test_products_quotients_and_small_powers_are_units(unit):
    assert check_unit(unit) == unit


@pytest.mark.parametrize(
    "unit", ["9**9**9*mm", "mm**9**9", "mm**999", "2*mm", "mm+mm", "mm⁹⁹⁹", "mm**(9**9)", "m" * 200, "m*" * 1000 + "m"]
)
def test_an_expression_is_not_a_unit_and_is_never_calculated(unit, monkeypatch):
    check_unit("mm")
    monkeypatch.setattr(units, "registry", lambda: pytest.fail("pint was asked"))
    with pytest.raises(DeclarationError, match="is not a unit that pint knows"):
        convert(1.0, unit, "mm")
    with pytest.raises(DeclarationError, match="is not a unit that pint knows"):
        convert(1.0, "mm", unit)


def test_no_conversion_to_another_dimension():
    with pytest.raises(DeclarationError, match="cannot be converted"):
        convert(1.0, "um", "deg")


@pytest.mark.parametrize(("source", "target"), [("Hz", "rpm"), ("1/s", "rad/s"), ("deg", "percent")])
def test_a_frequency_is_no_angular_speed(source, target):
    """50 Hz would be 477 rpm: pint takes them for 50 rad/s."""
    for one, other in ((source, target), (target, source)):
        with pytest.raises(DeclarationError, match="only one of them contains an angle"):
            convert(50.0, one, other)


def test_read_in_converts_at_the_edge_alone():
    class Arm(Compound):
        z: DigitalSensor

    with connect(Arm(z=sensor())) as arm:
        put(arm.z, 25.0)
        arm.sample()
        assert arm.z.read() == 25.0
        assert arm.z.read_in("cm") == pytest.approx(2.5)
        with pytest.raises(DeclarationError, match="cannot be converted"):
            arm.z.read_in("V")


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("20 ms", 0.02),
        ("20ms", 0.02),
        (" 1.5 s ", 1.5),
        ("1e3 us", 1e-3),
        ("2 min", 120.0),
        (0.25, 0.25),
        (3, 3.0),
        ("0 s", 0),
    ],
)
def test_a_duration_is_a_number_of_seconds_or_a_text(text, value):
    assert seconds(text) == pytest.approx(value)


@pytest.mark.parametrize(
    "wrong",
    ["", "20", "ms", "20 V", "20 mss", "nan s", "-1 ms", "1e400 s", "1 ms + 2 ms", "9**9**9 s", "1.2.3 s", math.nan,
     math.inf, -1.0, 10**400, None, [1]],
)  # fmt: skip
def test_what_is_no_duration_is_an_error(wrong):
    with pytest.raises(DeclarationError, match="is not a duration"):
        seconds(wrong)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        *((text, 0.2) for text in ("0.2 seconds", "200 ms", "200ms", " 2e-1 s ", "200000 µs", "+0.2 s", ".2 s")),
        *((text, None) for text in ("200_000 us", "0.2 sec onds", "0,2 s", "5 parsec", "0.2", "-0.2 s", "0.2 Seconds")),
    ],
)
def test_every_place_that_takes_a_duration_has_the_same_grammar(text, value):
    takers = [
        seconds,
        lambda text: driver_table(WiringSource(""), "card", {"timeout": text}).timeout,
        lambda text: duration("recovery", text),
        lambda text: checked("disabled", "push-pull", False, text).debounce / 1e6,
        lambda text: (
            DigitalSensor("mm", minimum=0.0, maximum=1.0, resolution=1.0, on_error="hold", max_age=text)._max_age
        ),
        lambda text: InjectedFault("z", "stuck", at=text).at,
    ]
    for taker in takers:
        try:
            found = taker(text)
        except (DeclarationError, WiringError):
            found = None
        assert found == value, taker


@given(st.text(max_size=12))
def test_no_text_makes_anything_but_a_duration_or_an_error(text):
    with contextlib.suppress(DeclarationError):
        assert seconds(text) >= 0


def test_pint_is_not_imported_with_umo():
    code = "import sys, umo; sys.exit('pint' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@given(st.text(alphabet="mskg19*/^( )²·°%.-+_", max_size=40))
def test_no_text_makes_anything_but_a_unit_or_an_error(text):
    with contextlib.suppress(DeclarationError):
        assert check_unit(text) == text
