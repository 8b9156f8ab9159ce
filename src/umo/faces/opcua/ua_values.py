"""Values, qualities, times and units of umo as those of OPC UA (OPC 10000-4, 7.11; OPC 10000-8)."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime
from math import isnan
from typing import Any

from asyncua import ua

from umo.errors import CommandRefused, FramesError, LeaseHeld, PathError, RangeError, StateError, UmoError
from umo.faces.face import Changes
from umo.faces.face_declaration import FaceItem, ItemKind
from umo.faces.opcua import unece_codes as unece
from umo.objects import Quality

_C = ua.StatusCodes
STATUS: Mapping[Quality, ua.StatusCode] = {
    Quality.GOOD: ua.StatusCode(_C.Good),
    Quality.OUT_OF_RANGE: ua.StatusCode(_C.UncertainEngineeringUnitsExceeded),
    Quality.UNREFERENCED: ua.StatusCode(_C.UncertainInitialValue),
    Quality.STALE: ua.StatusCode(_C.UncertainLastUsableValue),
    Quality.BAD: ua.StatusCode(_C.BadDeviceFailure),
}
NO_VALUE = ua.StatusCode(_C.BadNoData)
"""Of a signal, or a state, that has no value."""
NOT_YET = ua.StatusCode(_C.BadWaitingForInitialData)
GONE = ua.StatusCode(_C.UncertainNoCommunicationLastUsableValue)
"""After the end of the run: the last value is still there."""
REFUSALS: tuple[tuple[type[UmoError], int], ...] = (
    (RangeError, _C.BadOutOfRange),
    (StateError, _C.BadInvalidArgument),
    (PathError, _C.BadNodeIdUnknown),
    (LeaseHeld, _C.BadResourceUnavailable),
    (CommandRefused, _C.BadRequestNotAllowed),
    (FramesError, _C.BadNoCommunication),
    (UmoError, _C.BadInvalidState),
)
"""StatusCodes of the machine's errors: the first that fits."""


class FixedValue(ua.DataValue):
    """A value that never changes. asyncua copies the values of monitored items deeply, which takes 0.3 ms for each."""

    __slots__ = ()

    def __deepcopy__(self, memo: object) -> FixedValue:
        return self


def status_of(error: UmoError) -> ua.StatusCode:
    return ua.StatusCode(next(code for kind, code in REFUSALS if isinstance(error, kind)))


def moment(utc: float) -> datetime | None:
    """A time in s since 1970; None for NaN."""
    return None if isnan(utc) else datetime.fromtimestamp(utc, UTC)


def is_switch(item: FaceItem) -> bool:
    """Whether it has two states, 0 and 1: a Boolean."""
    return set(item.states) == {0, 1}


def variant_of(item: FaceItem, value: float) -> ua.Variant:
    if not item.states:
        return ua.Variant(value, ua.VariantType.Double)
    if is_switch(item):
        return ua.Variant(value != 0.0, ua.VariantType.Boolean)
    return ua.Variant(int(value), ua.VariantType.Int32)


def data_value(item: FaceItem, changes: Changes) -> ua.DataValue:
    """The value of an item with its quality, and the time at which the device gave it."""
    place = item.number
    value, quality = float(changes.values[place]), changes.quality_of(place)
    status, time = STATUS[quality], moment(float(changes.times[place]))
    if isnan(value) or quality is Quality.BAD:
        bad = quality is Quality.BAD and item.kind in (ItemKind.SENSOR, ItemKind.ACTUATOR)
        return FixedValue(ua.Variant(), status if bad else NO_VALUE, time, moment(changes.utc))
    return FixedValue(variant_of(item, value), status, time, moment(changes.utc))


def state_text(item: FaceItem, value: ua.DataValue) -> ua.DataValue:
    """ValueAsText of a value."""
    number = None if value.Value is None else value.Value.Value
    text = ua.LocalizedText("" if number is None else item.states.get(number, str(number)))
    return FixedValue(ua.Variant(text), value.StatusCode, value.SourceTimestamp, value.ServerTimestamp)


def given(item: FaceItem, value: ua.Variant | None) -> Any:
    """What a client writes, as the machine's commands take it: a number, or the name of a state. StateError for another
    type."""
    plain = None if value is None or value.is_array else value.Value
    if not item.states:
        if isinstance(plain, int | float) and not isinstance(plain, bool):
            return float(plain)
        raise StateError(f"{item.path} is a number")
    if isinstance(plain, int) and plain in item.states:
        return item.states[int(plain)]
    raise StateError(f"{item.path} is one of {', '.join(f'{n} {name}' for n, name in item.states.items())}")


def result_of(value: Any) -> ua.Variant:
    """The result of an action: a list or a mapping as text."""
    if isinstance(value, bool):
        return ua.Variant(value, ua.VariantType.Boolean)
    if isinstance(value, int):
        return ua.Variant(value, ua.VariantType.Int64)
    if isinstance(value, float):
        return ua.Variant(value, ua.VariantType.Double)
    return ua.Variant() if value is None else ua.Variant(str(value), ua.VariantType.String)


def unit_of(item: FaceItem) -> ua.EUInformation:
    """Its unit, with the code of UN/ECE if it has one, else -1."""
    code = unece.code_of(item.unit)
    return ua.EUInformation(
        NamespaceUri=unece.NAMESPACE if code else "urn:umo:units",
        UnitId=unece.number_of(code) if code else -1,
        DisplayName=ua.LocalizedText(item.look),
        Description=ua.LocalizedText(item.unit),
    )
