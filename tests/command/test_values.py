"""Numbers that a user types with a unit."""

from __future__ import annotations

import pytest

from umo.errors import RangeError
from umo_command.values import difference, number


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("194 degF", "degC", 90.0),
        ("32 degF", "degC", 0.0),
        ("32.18 degF", "degC", 0.1),
        ("37 degC", "degF", 98.6),
        ("3.0123456789 cm", "mm", 30.123456789),
        ("1e-300 mm", "km", 1e-306),
        ("0 mm", "km", 0.0),
    ],
)
def test_a_converted_number_has_no_digits_that_come_from_rounding_errors(text: str, unit: str, value: float) -> None:
    assert str(number("x", text, unit)) == str(value)


@pytest.mark.parametrize("text", ["80.12345678901235", "80.12345678901235 mm"])
def test_a_number_in_its_own_unit_keeps_all_digits(text: str) -> None:
    assert number("x", text, "mm") == 80.12345678901235


def test_a_difference_of_temperatures_is_converted_without_the_offset_of_the_units() -> None:
    assert difference("x", "9 degF", "degC") == 5.0
    assert difference("x", "10 degF", "degC") == 5.55555555556
    assert difference("x", "10 K", "degC") == 10.0


def test_a_difference_of_a_logarithmic_unit_is_refused() -> None:
    with pytest.raises(RangeError, match="cannot be expressed in dBm"):
        difference("x", "10 mW", "dBm")
