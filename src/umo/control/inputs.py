"""How control laws read: an object's value, or BadInput. Nothing rests on the caller looking at a bool."""

from __future__ import annotations

from collections.abc import Container
from typing import TypeVar

from umo.errors import BadInput
from umo.objects import BinarySensor, DigitalSensor, Quality, TwoState

S = TypeVar("S", bound=TwoState)

UNREFERENCED = frozenset({Quality.UNREFERENCED, Quality.OUT_OF_RANGE})
"""What homing accepts: the count moves, but nobody knows yet what it means."""


def value_of(sensor: DigitalSensor, accept: Container[Quality] = ()) -> float:
    """The sensor's value in its units; BadInput unless its quality is GOOD or accepted."""
    value = sensor.read()
    _check(sensor, accept)
    return value


def state_of(sensor: BinarySensor[S], accept: Container[Quality] = ()) -> S:
    """The sensor's state; BadInput unless its quality is GOOD or accepted."""
    state = sensor.read()
    _check(sensor, accept)
    return state


def _check(sensor: DigitalSensor | BinarySensor[S], accept: Container[Quality]) -> None:
    quality = sensor.quality
    if quality is not Quality.GOOD and quality not in accept:
        raise BadInput(sensor.path, quality)
