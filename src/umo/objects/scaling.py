"""The only place where raw integers and values are converted into each other.

    value = raw * resolution + zero_offset
    raw   = round((value - zero_offset) / resolution), half to even

The paper's `resolution` is the change of the value for one bit, `zero_offset` the value of raw 0 (section 4.5). The
code divides and never multiplies by a reciprocal, because the two results can differ for values midway between two raw
integers. The scalar and the vectorised forms, and the C of blocks and controllers (`umo_scaling.h`), do the same IEEE
operations in the same order; tests prove them equal. An inverted binary channel is resolution -1, zero offset 1.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

BOUND_TOLERANCE = 1e-6
"""Tolerance of the bounds of a range, in raw integers, for rounding errors of the division."""

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
ByteArray = npt.NDArray[np.uint8]
BoolArray = npt.NDArray[np.bool_]


def to_value(raw: int, resolution: float, zero_offset: float) -> float:
    return raw * resolution + zero_offset


def to_raw(value: float, resolution: float, zero_offset: float) -> int:
    return round((value - zero_offset) / resolution)


def raw_bounds(minimum: float, maximum: float, resolution: float, zero_offset: float) -> tuple[int, int]:
    """Return the least and the greatest raw integer whose value lies within the range; if there is none, the returned
    least integer is above the greatest. A value that differs from a bound only by a rounding error of the division
    counts as equal to it."""
    ends = sorted((bound - zero_offset) / resolution for bound in (minimum, maximum))
    return math.ceil(ends[0] - BOUND_TOLERANCE), math.floor(ends[1] + BOUND_TOLERANCE)


def to_values(
    raws: FloatArray | IntArray, resolution: FloatArray, zero_offset: FloatArray | None, out: FloatArray | None = None
) -> FloatArray:
    """Convert raw integers to values. `zero_offset`: None if all are 0. `out`: the array to fill, which may be `raws`;
    None means a new one."""
    values = np.multiply(raws, resolution, out)
    return values if zero_offset is None else np.add(values, zero_offset, values)


def to_steps(
    values: FloatArray, resolution: FloatArray, zero_offset: FloatArray | None, out: FloatArray | None = None
) -> FloatArray:
    """Convert values to raw integers that are not rounded yet. The arguments are those of `to_values`."""
    shifted = values if zero_offset is None else np.subtract(values, zero_offset, out)
    return np.divide(shifted, resolution, out)


def to_raws(
    values: FloatArray,
    resolution: FloatArray,
    zero_offset: FloatArray,
    least: FloatArray | float = -(2.0**63),
    greatest: FloatArray | float = 2.0**63 - 1024.0,
) -> IntArray:
    """Convert values to raw integers. Values are clipped before they become integers, because the bounds are valid raw
    integers."""
    scaled = to_steps(values, resolution, zero_offset)
    np.rint(scaled, out=scaled)
    np.maximum(scaled, least, out=scaled)
    np.minimum(scaled, greatest, out=scaled)
    return scaled.astype(np.int64)
