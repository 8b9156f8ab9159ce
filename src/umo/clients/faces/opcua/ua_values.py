"""Converts values, qualities, times and units of umo to those of OPC UA (OPC 10000-4, 7.11; OPC 10000-8)."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime
from math import isnan
from typing import Any

from asyncua import ua

from umo.clients.faces.face import Changes
from umo.clients.faces.opcua import unece_codes as unece
from umo.errors import CommandRefused, FramesError, LeaseHeld, PathError, RangeError, StateError, UmoError
from umo.objects import Quality
from umo.process.frames.machine_items import ItemKind, MachineItem

_C = ua.StatusCodes
STATUS: Mapping[Quality, ua.StatusCode] = {
    Quality.GOOD: ua.StatusCode(_C.Good),
    Quality.OUT_OF_RANGE: ua.StatusCode(_C.UncertainEngineeringUnitsExceeded),
    Quality.UNREFERENCED: ua.StatusCode(_C.UncertainInitialValue),
    Quality.STALE: ua.StatusCode(_C.UncertainLastUsableValue),
    Quality.BAD: ua.StatusCode(_C.BadDeviceFailure),
}
NO_VALUE = ua.StatusCode(_C.BadNoData)
"""Status of a signal or a state without a value."""
NO_STATE = ua.StatusCode(_C.BadOutOfRange)
"""Status of a number that is not one of the named states, so that no client mistakes it for one."""
NOT_YET = ua.StatusCode(_C.BadWaitingForInitialData)
GONE = ua.StatusCode(_C.UncertainNoCommunicationLastUsableValue)
"""Status after the end of the run, when the last value is still shown."""
REFUSALS: tuple[tuple[type[UmoError], int], ...] = (
    (RangeError, _C.BadOutOfRange),
    (StateError, _C.BadOutOfRange),
    (PathError, _C.BadNodeIdUnknown),
    (LeaseHeld, _C.BadResourceUnavailable),
    (CommandRefused, _C.BadRequestNotAllowed),
    (FramesError, _C.BadNoCommunication),
    (UmoError, _C.BadInvalidState),
)
"""The StatusCodes for the machine's errors. The first one that fits is used."""


class UaRefusal(CommandRefused):
    """A refusal that has its own StatusCode."""

    def __init__(self, code: int, words: str) -> None:
        super().__init__(words)
        self.code = code


def status_of(error: UmoError) -> ua.StatusCode:
    if isinstance(error, UaRefusal):
        return ua.StatusCode(error.code)
    return ua.StatusCode(next(code for kind, code in REFUSALS if isinstance(error, kind)))


def moment(utc: float) -> datetime | None:
    """Return a time, given in s since 1970, as a datetime; None for NaN."""
    return None if isnan(utc) else datetime.fromtimestamp(utc, UTC)


def is_switch(item: MachineItem) -> bool:
    """True if an item has two states, 0 and 1, and becomes a Boolean."""
    return set(item.states) == {0, 1}


def type_of(item: MachineItem) -> Any:
    """Return the data type of an item's value. For named values it is a type that can hold all of them."""
    if not item.states:
        return ua.VariantType.Double
    if is_switch(item):
        return ua.VariantType.Boolean
    longest = max(each.bit_length() for each in item.states)
    kinds = {31: ua.VariantType.Int32, 63: ua.VariantType.Int64}
    return next((kind for bits, kind in kinds.items() if longest <= bits), ua.VariantType.Double)


def variant_of(item: MachineItem, value: float) -> ua.Variant:
    """Return a number, or one of the named states, as a variant."""
    kind = type_of(item)
    return ua.Variant((bool if kind == ua.VariantType.Boolean else int)(value) if item.states else value, kind)


def data_value(item: MachineItem, changes: Changes) -> ua.DataValue:
    """Return the value of an item with its quality and the time at which the device returned it."""
    place = item.number
    value, quality = float(changes.values[place]), changes.quality_of(place)
    status, time = STATUS[quality], moment(float(changes.times[place]))
    if isnan(value) or quality is Quality.BAD:
        bad = quality is Quality.BAD and item.kind in (ItemKind.SENSOR, ItemKind.ACTUATOR)
        return ua.DataValue(ua.Variant(), status if bad else NO_VALUE, time, moment(changes.utc))
    if item.states and item.state_of(value) is None:
        return ua.DataValue(ua.Variant(), NO_STATE, time, moment(changes.utc))
    return ua.DataValue(variant_of(item, value), status, time, moment(changes.utc))


def state_text(item: MachineItem, value: ua.DataValue) -> ua.DataValue:
    """Return the ValueAsText of a value."""
    number = None if value.Value is None else value.Value.Value
    text = ua.LocalizedText("" if number is None else item.states.get(number, str(number)))
    return ua.DataValue(ua.Variant(text), value.StatusCode, value.SourceTimestamp, value.ServerTimestamp)


def given(item: MachineItem, data: ua.DataValue) -> Any:
    """Return a written value in the form that the machine's commands accept: a number, or the name of a state. Raises
    UaRefusal for another type, or for more than one value."""
    if (data.StatusCode is not None and data.StatusCode.value) or data.SourceTimestamp or data.ServerTimestamp:
        words = f"{item.path}: write only the value: the machine sets status and times"
        raise UaRefusal(_C.BadWriteNotSupported, words)
    variant = data.Value or ua.Variant()
    kind, value = type_of(item), variant.Value
    what = f"one of {_states(item)}" if item.states else "a number"
    if variant.VariantType != kind or variant.is_array or value is None:
        raise UaRefusal(_C.BadTypeMismatch, f"{item.path} is {what}, of the type {kind.name}")
    if not item.states:
        return float(value)
    if value not in item.states:
        raise UaRefusal(_C.BadOutOfRange, f"{item.path} is {what}")
    return item.states[int(value)]


def _states(item: MachineItem) -> str:
    return ", ".join(f"{number} {name}" for number, name in item.states.items())


def result_of(value: Any) -> ua.Variant:
    """Return the result of an action as a variant. A list, a mapping, and a number that does not fit an Int64 become a
    string."""
    if isinstance(value, bool):
        return ua.Variant(value, ua.VariantType.Boolean)
    if isinstance(value, int) and value.bit_length() <= 63:
        return ua.Variant(value, ua.VariantType.Int64)
    if isinstance(value, float):
        return ua.Variant(value, ua.VariantType.Double)
    return ua.Variant() if value is None else ua.Variant(str(value), ua.VariantType.String)


def unit_of(item: MachineItem) -> ua.EUInformation:
    """Return the unit of an item, with its UN/ECE code, or -1 if there is none."""
    code = unece.code_of(item.unit)
    return ua.EUInformation(
        NamespaceUri=unece.NAMESPACE if code else "urn:umo:units",
        UnitId=unece.number_of(code) if code else -1,
        DisplayName=ua.LocalizedText(item.look),
        Description=ua.LocalizedText(item.unit),
    )
