"""How values and runs look: digits from the resolution, units, durations, facts; the page's texts are the same."""

from __future__ import annotations

import json
import math
import shutil
import struct
import subprocess
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from random import Random
from typing import Any

import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

import umo
from helpers.machines import bench, stations, wired
from umo import DigitalSensor, connect
from umo.cycle.trace import Trace, lines
from umo.digits import digits_of, number_text, scale_texts, setting_text, with_short_numbers
from umo.duration import duration, lasting
from umo.objects import Digital, Quality, atoms
from umo.objects.description import converted, described
from umo.objects.presentation.described import Described
from umo.objects.presentation.rows import TableRow, value_of
from umo.objects.presentation.run_facts import facts_of
from umo.objects.presentation.value_text import SIGNS, WHY, WORDS, measure, shown_unit, span
from umo.objects.scaling import to_raw, to_value
from umo.objects.units import check_unit, same_unit
from umo.testing import Scripted, VirtualTimer, periods

MODULE = Path(umo.__file__).parent / "clients/page/static/presentation.js"

bits = st.integers(1, 24)
resolutions = st.one_of(
    st.floats(1e-12, 1e6),
    st.builds(lambda span, bits: span / (2**bits - 1), st.floats(0.01, 1e4), bits),
    st.builds(lambda digit, power: digit * 10.0**power, st.integers(1, 999), st.integers(-12, 4)),
    st.builds(lambda power: 2.0**power, st.integers(-30, 12)),
).flatmap(lambda size: st.sampled_from([size, -size]))
shares = st.one_of(
    st.integers(-1000, 1000).map(float), st.floats(-1e6, 1e6), st.sampled_from([0.5, -273.15 * 16, 0.49])
)
raws = st.one_of(st.integers(-(2**31), 2**31), st.integers(-20, 20))


# The digits of an object ---------------------------------------------------------------------------------


@given(resolutions, shares, raws)
@example(1.0, 0.5, 2)
@example(0.1, 0.5, 3)
@example(1.0, 0.49, 7)
@example(10 / 4095, 0.0, 4095)
def test_the_text_of_a_value_stands_for_one_raw_integer(resolution: float, share: float, raw: int) -> None:
    zero_offset = share * resolution
    digits = digits_of(resolution, zero_offset)
    value = to_value(raw, resolution, zero_offset)
    text = number_text(value, digits)
    assert to_raw(float(text), resolution, zero_offset) == raw
    assert text != number_text(to_value(raw + 1, resolution, zero_offset), digits)
    assert "e" not in text
    assert Described({"resolution": resolution, "zero_offset": zero_offset}).file_form.format(value) == text


@given(st.integers(1, 9999), st.integers(0, 9), st.integers(-9999, 9999))
@example(1, 0, 0)
@example(5, 3, 0)
def test_no_text_has_a_digit_too_many(steps: int, power: int, zero: int) -> None:
    """With one less, two adjacent raw integers would look the same, or the resolution would be rounded."""
    resolution, zero_offset = steps / 10**power, zero / 10**power
    digits = digits_of(resolution, zero_offset)
    assume(digits > 0)
    unit = 10.0 ** (1 - digits)
    count = math.ceil(2 / (1 - resolution / unit)) + 2 if resolution < unit else 20
    texts = [number_text(to_value(raw, resolution, zero_offset), digits - 1) for raw in range(count)]
    exact = [Fraction(number_text(resolution, each)) == Fraction(steps, 10**power) for each in (digits - 1, digits)]
    assert any(one == other for one, other in pairwise(texts)) or exact == [False, True]


@pytest.mark.parametrize(
    ("resolution", "value", "text"),
    [
        (0.005, 9.983e-5, "0.000"),
        (0.005, -9.983e-5, "0.000"),
        (0.005, 1.235, "1.235"),
        (10 / 4095, 9.98, "9.980"),
        (50.0, 150.0, "150"),
        (0.25, 0.25, "0.25"),
        (2.5, 7.5, "7.5"),
        (10 / 4096, 10 / 4096, "0.002"),
        (1.0, 12345678.0, "12345678"),
        (1e-9, 3e-9, "0.000000003"),
        (-0.1, 12.3, "12.3"),
        (0.5, math.nan, "-"),
    ],
)
def test_digits_follow_from_the_resolution(resolution: float, value: float, text: str) -> None:
    assert number_text(value, digits_of(resolution)) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"), (-0.0, "0"), (12345.678, "12345.7"), (1234567.8, "1234568"), (0.000123456789, "0.000123457"),
        (1.5e-5, "1.5e-5"), (1e9, "1e9"), (-2.5e12, "-2.5e12"), (999999.96, "1000000"), (math.inf, "-"), (3, "3"),
    ],
)  # fmt: skip
def test_what_has_no_resolution_has_six_significant_digits(value: float, text: str) -> None:
    assert number_text(value) == text


def test_a_setting_has_all_digits_that_it_surely_has() -> None:
    assert [setting_text(each) for each in (0.1, 30.123456789000002, 2**53 + 1, 25.0)] == [
        "0.1", "30.123456789", "9007199254740993", "25",
    ]  # fmt: skip


def test_an_object_has_the_digits_of_its_wiring_and_none_through_a_linearization() -> None:
    m = bench()
    entries = {"encoder": {"resolution": 0.125}}
    with connect(m, wired(m, Scripted({"encoder": [7]}), clock=VirtualTimer(), entries=entries)):
        periods(m)
        assert described(m.encoder).text(m.encoder.read()) == "0.875 mm"
        assert repr(m.encoder).startswith("<DigitalSensor encoder = 0.875 mm ● good;")
    curve = umo.Polynomial([0.0, 1.0, 0.0, 0.001])
    about = described(DigitalSensor("mm", minimum=0.0, maximum=10.0, resolution=0.001, linearization=curve))
    assert about.text(1.23456789) == "1.23457 mm"


def test_another_unit_has_the_digits_of_the_resolution_in_it() -> None:
    about = {"path": "x", "unit": "mm", "resolution": 0.5, "zero_offset": 0.0}
    assert [shown(about, unit) for unit in (None, "cm", "um", "m")] == [
        "12.5 mm", "1.25 cm", "12500 µm", "0.0125 m",
    ]  # fmt: skip
    oven = {"path": "t", "unit": "degC", "resolution": 0.1, "zero_offset": 0.0}
    assert shown(oven, "kelvin") == "285.65 kelvin"
    power = {"path": "p", "unit": "mW", "resolution": 1.0, "zero_offset": 0.0}
    assert shown(power, "dBm") == "10.9691 dBm"


def shown(about: dict[str, Any], unit: str | None) -> str:
    return value_of([converted(TableRow(Described(about), 12.5), unit)])


# Files ---------------------------------------------------------------------------------------------------


@given(st.floats(allow_nan=False))
def test_a_file_has_all_digits_of_what_has_no_resolution(value: float) -> None:
    assert float(Described({"unit": "V"}).file_form.format(value)) == value


@given(st.lists(st.integers(0, 200), min_size=1, max_size=20))
def test_from_a_trace_every_raw_integer_comes_back(read: list[int]) -> None:
    m = bench()
    trace, raws = Trace(), []
    with (connection := connect(m, wired(m, Scripted({"encoder": read}), clock=VirtualTimer()))):
        connection.machine.observers += [trace, lambda frame: raws.append(m.encoder.raw)]
        periods(m, len(read))
    head, *rows = (line.strip().split(",") for line in lines(trace))
    texts = [row[head.index("encoder[mm]")] for row in rows]
    assert [to_raw(float(text), 0.5, 0.0) for text in texts] == raws


# Units, durations, facts -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("unit", "text"),
    [
        ("mm/s**2", "mm/s²"), ("m*s^-1", "m·s⁻¹"), ("percent", "%"), ("degC", "°C"), ("um", "µm"), ("deg/s", "°/s"),
        ("uV/degC", "µV/°C"), ("kohm", "kΩ"), ("rpm", "rpm"), ("m/s**0.5", "m/s**0.5"), ("sampling_period", ""),
        ("um/sampling_period", "µm/sampling_period"),
    ],
)  # fmt: skip
def test_units_look_as_in_print(unit: str, text: str) -> None:
    assert shown_unit(check_unit(unit)) == text


def test_a_message_names_what_is_no_number() -> None:
    assert [measure(value, "V") for value in (math.nan, math.inf, 2.0)] == ["nan V", "inf V", "2 V"]


def test_the_unit_that_is_shown_is_one_that_can_be_typed() -> None:
    units = {item.units for machine in stations().values() for item in atoms(machine()) if isinstance(item, Digital)}
    units |= {"mm/s**2", "percent", "degC", "degF", "um", "uV", "ohm", "deg/s", "N*m", "kg*m^2/s**-1", "delta_degC/min"}
    for unit in units - {"sampling_period"}:
        assert same_unit(check_unit(shown_unit(unit)), unit)


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.0, "0 s"), (1e-5, "10 µs"), (0.0025, "2.5 ms"), (1.0, "1 s"), (90.0, "90 s"), (3600.5, "3600.5 s")],
)
def test_a_duration_has_the_unit_of_its_size(seconds: float, text: str) -> None:
    assert duration(seconds) == text


@pytest.mark.parametrize(
    ("low", "high", "text"), [(0, 1, "0 to 1 V"), (0, None, "0 V or more"), (None, 5, "up to 5 V"), (None, None, "V")]
)
def test_a_range_without_a_bound_is_shown(low: float | None, high: float | None, text: str) -> None:
    assert span(low, high, "V") == text


def test_every_quality_has_a_sign_words_and_a_reason() -> None:
    assert len(SIGNS) == len(WORDS) == len(WHY) == len(Quality)
    assert [word.replace(" ", "_").upper() for word in WORDS] == [str(quality) for quality in Quality]


def test_facts_of_a_run_come_from_elsewhere_and_do_not_command_the_terminal() -> None:
    progress, faults = ("pla\x07cing", 1, 3), {f"zones.{i}": "\x1b[2Jhot" for i in range(5)}
    facts = facts_of("running", "manual", "\x1b[2Jann", progress, time=1.0, missed=1234, period=0.001, faults=faults)
    assert facts == {
        "state": "running", "mode": "manual", "lease": "?[2Jann", "driven": "", "progress": "pla?cing, 1 of 3",
        "time": "1.000 s", "period": "1 ms", "missed": "1,234",
        "in fault": "zones.0: ?[2Jhot; zones.1: ?[2Jhot; zones.2: ?[2Jhot; and 2 more",
    }  # fmt: skip
    assert facts_of("running", "manual")["lease"] == "free"


# Numbers in texts ---------------------------------------------------------------------------------------

TEXTS = [
    ("0.30000000000000004", "0.3"),
    ("[120.30000000000001, 1.5, -0.1]", "[120.3, 1.5, -0.1]"),
    ('{"mean": 3.3333333333333335e-05, "n": 12345678901234567890}', '{"mean": 3.33333e-5, "n": 12345678901234567890}'),
    ("version 1.2.3 of a1.30000000000000004b", "version 1.2.3 of a1.30000000000000004b"),
    ("12.34567 mm, 0.000000000000123456 s", "12.34567 mm, 0.000000000000123456 s"),
]
"""Texts, and how they are shown."""


@pytest.mark.parametrize(("text", "shown"), TEXTS)
def test_a_float_to_the_last_bit_is_shown_as_people_read_it(text: str, shown: str) -> None:
    assert with_short_numbers(text) == shown
    assert with_short_numbers(shown) == shown


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_a_float_in_a_text_is_at_most_fifteen_digits_long_and_near_to_what_it_was(value: float) -> None:
    shown = with_short_numbers(f"x = {value!r}, or so")
    number = shown.removeprefix("x = ").removesuffix(", or so")
    assert float(number) == pytest.approx(value, rel=1e-5)
    if "." in number:
        assert len(number.partition("e")[0].replace(".", "").strip("-0")) <= 15


# The page --------------------------------------------------------------------------------------------------

DRIVER = """
import { duration, lasting, numberText, scaleTexts, valueText, withShortNumbers } from "%s";
import { readFileSync } from "node:fs";
const { numbers, scales, values, seconds, texts } = JSON.parse(readFileSync(0, "utf8"));
console.log(JSON.stringify({
  numbers: numbers.map(([value, digits]) => numberText(value, digits)),
  scales: scales.map(scaleTexts),
  values: values.map(([about, found]) => valueText(about, ...found)),
  durations: seconds.map(duration),
  lasting: seconds.map(lasting),
  texts: texts.map(withShortNumbers),
}));
"""


def numbers_of_any_size() -> list[tuple[float, int | None]]:
    """Floats of all sizes, halves that are rounded to the even digit, powers of ten and their neighbours."""
    random = Random(20)
    any_bits = [struct.unpack("<d", random.randbytes(8))[0] for _ in range(2000)]
    halves = [(2 * random.randrange(10**7) + 1) / 2**power for power in range(1, 9) for _ in range(50)]
    halves += [(random.randrange(10**6, 10**7) * 10 + 5) * 10.0**power for power in range(-1, 16) for _ in range(30)]
    powers = [10.0**power for power in range(-20, 25)]
    near = [math.nextafter(each, to) for each in powers for to in (0.0, math.inf)]
    usual = [random.uniform(-1, 1) * 10 ** random.randint(-8, 12) for _ in range(3000)]
    found = (
        [each for each in any_bits if math.isfinite(each)] + halves + powers + near + usual + [0.0, -0.0, 0.5, 1.5, 2.5]
    )
    found += [-each for each in found]
    return [(each, random.choice([None, *range(13)])) for each in found] + [(each, None) for each in found]


def scales_of_any_size() -> list[list[float]]:
    """Multiples of round steps, near 0 and far from it."""
    random = Random(21)
    steps = [random.choice((1, 2, 2.5, 5)) * 10.0 ** random.randint(-9, 9) for _ in range(300)]
    firsts = [random.choice((0, -3, 17, 40_000, 123_456_789)) for _ in steps]
    return [[(first + i) * step for i in range(5)] for first, step in zip(firsts, steps, strict=True)] + [[], [3.5]]


@given(st.integers(-(10**9), 10**9), st.sampled_from((1, 2, 5)), st.integers(-9, 6))
def test_the_numbers_beside_a_scale_are_those_of_its_levels(first: int, digit: int, power: int) -> None:
    step = Fraction(digit) * Fraction(10) ** power
    levels = [(first + i) * step for i in range(4)]
    texts = scale_texts([float(level) for level in levels])
    assert [abs(Fraction(text) - level) < step / 1000 for text, level in zip(texts, levels, strict=True)] == [True] * 4


def test_the_page_shows_what_python_shows() -> None:
    node = shutil.which("node")
    if node is None:
        pytest.skip("the page's JavaScript needs node 20 or newer")
    numbers = numbers_of_any_size()
    abouts = [described(item).shown for machine in stations().values() for item in atoms(machine())][:200]
    families = ([0.0], [1.0], [0.1234567, 12.5], [0.0, 1.0, 1.0], [math.nan], [], [math.nan, 3.0005])
    values = [(about, list(found)) for about in abouts for found in families]
    seconds = [value for value, _ in numbers[:3000] if abs(value) < 1e9]
    scales = scales_of_any_size()
    given = {
        "numbers": numbers,
        "scales": scales,
        "values": [(about, plain(found)) for about, found in values],
        "seconds": seconds,
        "texts": (texts := [text for text, _ in TEXTS] + [f"x: {value!r}" for value in seconds[:1000]]),
    }
    done = subprocess.run(
        [node, "--input-type=module", "-e", DRIVER % MODULE.as_uri()],
        input=json.dumps(given), capture_output=True, text=True, timeout=50,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    page = json.loads(done.stdout)
    assert page["texts"] == list(map(with_short_numbers, texts))
    different = [
        (value, digits, mine, its)
        for (value, digits), its in zip(numbers, page["numbers"], strict=True)
        if (mine := number_text(value, digits)) != its
    ]
    assert different[:5] == []
    assert page["scales"] == list(map(scale_texts, scales))
    assert page["values"] == [Described(about).text(*found) for about, found in values]
    assert page["durations"] == list(map(duration, seconds))
    assert page["lasting"] == list(map(lasting, seconds))


def plain(numbers: list[float]) -> list[float | None]:
    return [each if math.isfinite(each) else None for each in numbers]


@given(st.floats(allow_nan=False, allow_infinity=False, width=32), st.integers(0, 9))
def test_a_text_is_the_nearest_of_its_digits(value: float, digits: int) -> None:
    assume(abs(value) < 1e15)
    off = abs(Fraction(number_text(value, digits)) - Fraction(value))
    assert off <= Fraction(1, 2 * 10**digits)
