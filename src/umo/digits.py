"""The digits with which a number is shown. `presentation.js` of the page has the same rules; a test compares the two.

A value with a resolution has as many digits after the point as are necessary to distinguish its raw values, or up to
two more if they make the resolution exact (0.25). It never has an exponent. A value without a resolution has six
significant digits.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import lru_cache
from math import floor, inf, isfinite, log10

NO_VALUE = "-"
SIGNIFICANT_DIGITS = 6
SURE_DIGITS = 15
"""The number of significant digits that every float can represent. More digits appear only if the float is written
exactly."""
MAX_DIGITS = 99
"""The largest number of digits after the point. A browser can show 100 digits, and the code examines one digit more
than it shows."""
FEW_STEPS = 1e4
"""The number of steps of a scale from 0 that six significant digits can distinguish."""
MIN_POWER, MAX_POWER = -4, 9
"""The least and the greatest power of ten at which six significant digits are shown without an exponent."""
MAX_FIXED = 1e21
"""The magnitude from which on no digits after the point are shown, as in a browser."""
DRIFT_SHARE = 1e-12
"""A difference, as a share of the resolution, that is so small that it does not add up to one step within 2**32
steps."""
CLEAR_SHARE = 1e-5
"""The share of the resolution by which a digit must be smaller than the resolution, so that no rounding error of a
float decides which raw value is nearest."""
MORE_DIGITS = 2
"""Largest number of digits beyond those needed, so that a short resolution is not rounded."""
OFFSET_SHARE = 0.49
"""The share of a digit by which the value of raw 0 may differ from a multiple of the digit. For a larger difference it
is uncertain whether it is rounded up or down."""


@lru_cache(maxsize=4096)
def digits_of(resolution: float, zero_offset: float = 0.0) -> int:
    """Return the number of digits after the point, up to 99, that distinguish the values of two adjacent raw integers,
    so that each text stands for one raw integer. `zero_offset`: the value of raw 0."""
    step = abs(resolution)
    digits = min(max(0, floor(-log10(step))), MAX_DIGITS)
    while digits < MAX_DIGITS and not _tells_apart(10.0**-digits, step, zero_offset):
        digits += 1
    return next((each for each in range(digits, digits + MORE_DIGITS + 1) if _is_exact(step, each)), digits)


def _tells_apart(digit: float, step: float, zero_offset: float) -> bool:
    if digit < step * (1 - CLEAR_SHARE):
        return True
    places = zero_offset / digit
    return abs(digit - step) <= step * DRIFT_SHARE and abs(places - round(places)) <= OFFSET_SHARE


def _is_exact(step: float, digits: int) -> bool:
    places = step * 10.0**digits
    return digits <= MAX_DIGITS and abs(places - round(places)) <= places * DRIFT_SHARE


def number_text(value: float, digits: int | None = None) -> str:
    """Return a number as text with this number of digits after the point; None means six significant digits. Return `-`
    if the number is not finite."""
    if not isfinite(value):
        return NO_VALUE
    if digits is not None and abs(value) < MAX_FIXED:
        return f"{value:z.{digits}f}"
    mantissa, _, power = f"{value:.{SIGNIFICANT_DIGITS - 1}e}".partition("e")
    exponent = int(power)
    if not MIN_POWER <= exponent < MAX_POWER:
        return f"{_without_zeros(mantissa)}e{exponent}"
    return _without_zeros(f"{value:z.{max(SIGNIFICANT_DIGITS - 1 - exponent, 0)}f}")


def scale_texts(levels: Sequence[float]) -> list[str]:
    """Return the texts of the numbers on a scale, evenly spaced. The texts have six significant digits, or as many
    digits as the step has."""
    step = float(f"{abs(levels[1] - levels[0]):.6g}") if len(levels) > 1 else inf
    few = all(abs(level) < FEW_STEPS * step for level in levels)
    digits = None if few else next(each for each in range(MAX_DIGITS + 1) if round(step, each) == step)
    return [number_text(level, digits) for level in levels]


def setting_text(value: float) -> str:
    """Return the text of a setting, with all digits that a float reliably has; for an integer, with all its digits."""
    return f"{value:.{SURE_DIGITS}g}" if isinstance(value, float) else str(value)


_WITH_POINT = re.compile(r"(?<![\w.])-?(\d+\.\d+)(?:e[-+]?\d+)?(?![\w.])")


def with_short_numbers(text: str) -> str:
    """Shorten the numbers in a text, such as a result in JSON: a number that has more digits than a float surely has
    (0.30000000000000004) gets the digits that are shown for a single number (0.3). For human readers; programs use the
    original text."""
    return _WITH_POINT.sub(lambda found: number_text(float(found[0])) if _is_long(found[1]) else found[0], text)


def _is_long(digits: str) -> bool:
    return len(digits.replace(".", "").lstrip("0")) > SURE_DIGITS


def _without_zeros(text: str) -> str:
    return text.rstrip("0").rstrip(".") if "." in text else text
