"""Functions that read the inputs of control laws. They return the value of an object or raise BadInput, so that the
caller has no flag to check. GOOD and STALE are accepted. An object is STALE only within its `max_age`, for which the
integrator has declared that the last value is held. BAD, OUT_OF_RANGE and UNREFERENCED are refused, unless the call
accepts them explicitly.
"""

from __future__ import annotations

from collections.abc import Container
from typing import Any, TypeAlias, TypeVar, overload

import numpy as np

from umo.errors import BadInput
from umo.objects import Atomic, BinarySensor, DigitalSensor, Quality, Sensor, Vector
from umo.objects.scaling import BoolArray, FloatArray
from umo.states import TwoState
from umo.text import cut_repr

S = TypeVar("S", bound=TwoState)

Accept: TypeAlias = Quality | Container[Quality]
"""The qualities (one or several) that a call accepts in addition to GOOD and STALE."""

HOMING = frozenset({Quality.UNREFERENCED, Quality.OUT_OF_RANGE})
"""The qualities that homing accepts: the counter works, but its reference position is not known yet."""


@overload
def value_of(sensor: DigitalSensor, accept: Accept = ()) -> float: ...
@overload
def value_of(sensor: Vector[Any], accept: Accept = (), *, where: BoolArray | None = None) -> FloatArray: ...
def value_of(
    sensor: DigitalSensor | Vector[Any], accept: Accept = (), *, where: BoolArray | None = None
) -> float | FloatArray:
    """Return the sensor's value in its units, or the values of a Vector, as its `read` returns them.

    Raises BadInput if the quality is not accepted. For a Vector the error names the first object whose quality is not
    accepted, and the number of such objects. Objects of a Vector for which the array `where` is False are not checked.
    """
    if isinstance(sensor, Vector):
        values = sensor.read()
        _check_all(sensor, accept, where)
        return values
    try:
        value = sensor.read()
    except AttributeError:
        _refuse_other("value_of", sensor)
        raise
    if sensor._image.quality[sensor._slot]:  # not GOOD; the property would make an enum of it at each reading
        _check(sensor, accept)
    return value


def state_of(sensor: BinarySensor[S], accept: Accept = ()) -> S:
    """Return the sensor's state. Raises BadInput if its quality is not accepted."""
    try:
        state = sensor.read()
    except AttributeError:
        _refuse_other("state_of", sensor)
        raise
    if sensor._image.quality[sensor._slot]:
        _check(sensor, accept)
    return state


def _check(sensor: Sensor, accept: Accept) -> None:
    quality = sensor.quality
    if not _accepts(accept, quality):
        raise BadInput(sensor.path, quality)


def _check_all(vector: Vector[Any], accept: Accept, where: BoolArray | None) -> None:
    chosen = None if where is None else vector.mask(where)
    if vector.all_good:
        return
    qualities = vector.quality if chosen is None else np.where(chosen, vector.quality, Quality.GOOD)
    accepted = [quality for quality in Quality if _accepts(accept, quality)]
    refused = np.flatnonzero(~np.isin(qualities, accepted))
    if len(refused):
        raise BadInput(vector[refused[0]].path, Quality(qualities[refused[0]]), len(refused) - 1)


def _accepts(accept: Accept, quality: Quality) -> bool:
    if quality is Quality.GOOD or quality is Quality.STALE:
        return True
    return quality is accept if isinstance(accept, Quality) else quality in accept


def _refuse_other(function: str, given: object) -> None:
    """Raise TypeError for an object that is not a sensor."""
    if not isinstance(given, Atomic):
        raise TypeError(f"{function}() takes a sensor, not {cut_repr(given)}") from None
