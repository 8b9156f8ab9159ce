"""Selects the changes of a value that a monitored item reports (OPC 10000-4, 7.22.2; OPC 10000-8, 7.2)."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite
from typing import Any

from asyncua import ua
from asyncua.common.utils import ServiceError
from asyncua.server.address_space import AddressSpace

from umo.clients.faces.opcua.ua_types import NUMBER, below, is_structure

_C = ua.StatusCodes
STATUS, VALUE, TIMESTAMP = range(3)
"""Triggers. Each trigger includes the ones before it."""
NO_DEADBAND, ABSOLUTE, PERCENT = range(3)
"""Types of deadbands."""


@dataclass(frozen=True)
class DataFilter:
    """Selects the changes that are reported. A change of a number is reported if it is larger than `deadband`; 0 means
    every change."""

    trigger: int = VALUE
    deadband: float = 0.0

    def tells(self, before: ua.DataValue | None, after: ua.DataValue) -> bool:
        """True if a value must be reported after the previous one. A change of status is always reported."""
        if before is None or _status(before) != _status(after):
            return True
        if self.trigger == STATUS:
            return False
        if self._has_changed(_content(before), _content(after)):
            return True
        stamped = self.trigger == TIMESTAMP and not self.deadband
        return stamped and before.SourceTimestamp != after.SourceTimestamp

    def _has_changed(self, before: Any, after: Any) -> bool:
        if isinstance(before, list) and isinstance(after, list):
            return len(before) != len(after) or any(map(self._has_changed, before, after))
        if before != before and after != after:  # both are NaN
            return False
        if not (self.deadband and _is_number(before) and _is_number(after)):
            return bool(before != after)
        return before != after and not abs(after - before) <= self.deadband


EVERY_CHANGE = DataFilter()


def data_filter(space: AddressSpace, node: ua.NodeId, attribute: int, given: Any) -> DataFilter:
    """Return the filter that a client requests. Raises ServiceError, with the code of the standard, if the server does
    not support that filter."""
    if is_none(given):
        return EVERY_CHANGE
    if is_structure(given, ua.AggregateFilter):
        raise ServiceError(_C.BadMonitoredItemFilterUnsupported)
    if is_structure(given, ua.EventFilter):
        raise ServiceError(_C.BadFilterNotAllowed)
    if not is_structure(given, ua.DataChangeFilter):
        raise ServiceError(_C.BadMonitoredItemFilterInvalid)
    if attribute != ua.AttributeIds.Value:
        raise ServiceError(_C.BadFilterNotAllowed)
    trigger, kind, size = int(given.Trigger), given.DeadbandType, given.DeadbandValue
    if kind == NO_DEADBAND:
        return DataFilter(trigger)
    if not _has_numbers(space, node):
        raise ServiceError(_C.BadFilterNotAllowed)
    if kind not in (ABSOLUTE, PERCENT) or not isfinite(size) or size < 0 or (kind == PERCENT and size > 100):
        raise ServiceError(_C.BadDeadbandFilterInvalid)
    return DataFilter(trigger, size if kind == ABSOLUTE else size / 100 * _span(space, node))


def is_none(given: Any) -> bool:
    """True if the client requests no filter."""
    return given is None or (isinstance(given, ua.ExtensionObject) and given.TypeId.is_null())


def _has_numbers(space: AddressSpace, node: ua.NodeId) -> bool:
    kind = space.read_attribute_value(node, ua.AttributeIds.DataType).Value
    return kind is not None and isinstance(kind.Value, ua.NodeId) and below(space, kind.Value, NUMBER)


def _span(space: AddressSpace, node: ua.NodeId) -> float:
    """Return the width of a node's EURange. Raises ServiceError if there is no EURange, or if its width is not finite
    and positive."""
    for each in space[node].references:
        if each.IsForward and each.BrowseName.Name == "EURange":
            value = space.read_attribute_value(each.NodeId, ua.AttributeIds.Value).Value
            width = value.Value.High - value.Value.Low if value is not None and value.Value is not None else 0.0
            if isfinite(width) and width > 0:
                return float(width)
    raise ServiceError(_C.BadDeadbandFilterInvalid)


def _status(value: ua.DataValue) -> int:
    return value.StatusCode.value if value.StatusCode is not None else 0


def _content(value: ua.DataValue) -> Any:
    return None if value.Value is None else value.Value.Value


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
