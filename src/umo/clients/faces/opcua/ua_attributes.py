"""Reads the attributes of all nodes for one session (OPC 10000-4, 5.11.2)."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

from asyncua import ua
from asyncua.common.utils import ServiceError
from asyncua.server.address_space import AddressSpace

from umo.clients.faces.opcua.ua_limits import MAX_RESPONSE

_C = ua.StatusCodes
_A = ua.AttributeIds
CURRENT_WRITE = 2
"""The bit CurrentWrite of AccessLevel."""
RANGE = re.compile(r"\d+(:\d+)?(,\d+(:\d+)?)*", re.ASCII)
"""Pattern of a NumericRange (OPC 10000-4, 7.27)."""
SOURCE, SERVER, BOTH, NEITHER = range(4)
"""Values of TimestampsToReturn."""
ENCODINGS = ("Default XML", "Default JSON")
"""Encodings of the standard that this server does not have."""


@dataclass(frozen=True)
class Rights:
    """The rights of the sessions of this server, and the times of the server's values."""

    write: Callable[[Any, ua.NodeId], bool]
    """Function that returns True if a session may write the value of a node."""
    call: Callable[[Any, ua.NodeId], bool]
    """Function that returns True if a session may call a method."""
    true_at: Callable[[ua.NodeId], datetime | None]
    """Function that returns the time at which the value of a node was last known to be true. None means now."""


def missing(node: ua.NodeId) -> ua.StatusCode:
    """Return the StatusCode for a node that does not exist."""
    return ua.StatusCode(_C.BadNodeIdInvalid if node.is_null() else _C.BadNodeIdUnknown)


class ResponseSpace:
    """The estimated number of bytes that still fit in a response. It bounds every response."""

    def __init__(self) -> None:
        self._left = MAX_RESPONSE

    def take(self, weight: int) -> None:
        """Reserve bytes. Raises ServiceError if the response has no space left."""
        self._left -= weight
        if self._left < 0:
            raise ServiceError(_C.BadResponseTooLarge)


def weight(value: Any) -> int:
    """Return the approximate size in bytes of a DataValue, a variant or the content of one."""
    content = getattr(value, "Value", value)
    if isinstance(content, ua.Variant):
        content = content.Value
    if isinstance(content, str | bytes):
        return 20 + len(content)
    return 20 + (sum(map(weight, content)) if isinstance(content, list | tuple) else 20)


class Attributes:
    """Reads attributes. Attributes that depend on the user are computed for each session."""

    def __init__(self, space: AddressSpace, rights: Rights) -> None:
        self.space, self._rights = space, rights

    def read(self, session: Any, max_age: float, timestamps: int, asked: list[ua.ReadValueId]) -> list[ua.DataValue]:
        """Carry out the service Read. Values are at most one look of the face old, whatever `max_age` asks for."""
        if not max_age >= 0:
            raise ServiceError(_C.BadMaxAgeInvalid)
        check_timestamps(timestamps)
        room = ResponseSpace()
        return [self._read(session, each, timestamps, room) for each in asked]

    def _read(self, session: Any, asked: ua.ReadValueId, timestamps: int, room: ResponseSpace) -> ua.DataValue:
        value = self.value(session, asked)
        room.take(weight(value))
        if value.ServerTimestamp is None or asked.AttributeId == _A.Value:
            now = self._rights.true_at(asked.NodeId) or datetime.now(UTC)
            value = stamped(value, max(now, value.ServerTimestamp or now))
        return with_timestamps(value, timestamps, asked.AttributeId)

    def value(self, session: Any, asked: ua.ReadValueId) -> ua.DataValue:
        """Return the value of one attribute, or of a part of it."""
        value = self.whole(session, asked.NodeId, asked.AttributeId)
        code = self.refusal(asked, value)
        return ua.DataValue(StatusCode=ua.StatusCode(code)) if code else ranged(value, asked.IndexRange)

    def refusal(self, asked: ua.ReadValueId, value: ua.DataValue) -> int:
        """Return the status code for an attribute that cannot be read, or 0 for one that can. `value`: the value of the
        whole attribute."""
        if asked.IndexRange and bounds(asked.IndexRange) is None:
            return _C.BadIndexRangeInvalid
        encoding = asked.DataEncoding
        if encoding is None or not encoding.Name or (value.StatusCode and value.StatusCode.is_bad()):
            return 0
        content = value.Value.Value if value.Value is not None else None
        first = content[0] if isinstance(content, list) and content else content
        is_structure = value.Value is not None and value.Value.VariantType == ua.VariantType.ExtensionObject
        if asked.AttributeId != _A.Value or not is_structure or encoding.NamespaceIndex != 0 or first is None:
            return _C.BadDataEncodingInvalid
        if encoding.Name in ENCODINGS:
            return _C.BadDataEncodingUnsupported
        return 0 if encoding.Name == "Default Binary" else _C.BadDataEncodingInvalid

    def whole(self, session: Any, node: ua.NodeId, attribute: int) -> ua.DataValue:
        """Return the whole value of an attribute, for a session."""
        if node not in self.space:
            return ua.DataValue(StatusCode=missing(node))
        value = self.space.read_attribute_value(node, attribute)
        if value.StatusCode is not None and value.StatusCode.is_bad():
            return value
        if attribute == _A.UserAccessLevel and not self._rights.write(session, node):
            return ua.DataValue(ua.Variant(value.Value.Value & ~CURRENT_WRITE, ua.VariantType.Byte))
        if attribute == _A.UserExecutable or (attribute == _A.Executable and value.Value.Value):
            who = session if attribute == _A.UserExecutable else None
            return ua.DataValue(ua.Variant(self._rights.call(who, node), ua.VariantType.Boolean))
        return value


def check_timestamps(timestamps: int) -> None:
    """Raise ServiceError if the number is not a value of TimestampsToReturn."""
    if timestamps not in (SOURCE, SERVER, BOTH, NEITHER):
        raise ServiceError(_C.BadTimestampsToReturnInvalid)


def stamped(value: ua.DataValue, server: datetime) -> ua.DataValue:
    """Return the value with another ServerTimestamp."""
    return ua.DataValue(value.Value, value.StatusCode, value.SourceTimestamp, server)


def with_timestamps(value: ua.DataValue, timestamps: int, attribute: int) -> ua.DataValue:
    """Return the value with the timestamps that a client requests. Only a Value has a SourceTimestamp."""
    if timestamps == BOTH and attribute == _A.Value:
        return value
    source = value.SourceTimestamp if attribute == _A.Value and timestamps in (SOURCE, BOTH) else None
    server = value.ServerTimestamp if timestamps in (SERVER, BOTH) else None
    return ua.DataValue(value.Value, value.StatusCode, source, server)


# Ranges of indices -----------------------------------------------------------------------------------------


def bounds(text: str) -> list[slice] | None:
    """Return a NumericRange as slices, or None if the string is not a NumericRange."""
    if not RANGE.fullmatch(text):
        return None
    found = []
    for each in text.split(","):
        low, _, high = each.partition(":")
        if len(each) > 21 or (high and int(high) <= int(low)):
            return None
        found.append(slice(int(low), int(high or low) + 1))
    return found


def ranged(value: ua.DataValue, text: str | None) -> ua.DataValue:
    """Return the part of an array or string that a range of indices selects."""
    if not text or (value.StatusCode is not None and value.StatusCode.is_bad()):
        return value
    slices, variant = bounds(text), value.Value
    if slices is None:
        return ua.DataValue(StatusCode=ua.StatusCode(_C.BadIndexRangeInvalid))
    part = None
    if variant is not None and isinstance(variant.Value, list | str | bytes):
        part = _part(variant.Value, slices)
    if not part:
        return ua.DataValue(None, ua.StatusCode(_C.BadIndexRangeNoData), value.SourceTimestamp, value.ServerTimestamp)
    cut = ua.Variant(part, variant.VariantType, is_array=isinstance(part, list))
    return ua.DataValue(cut, value.StatusCode, value.SourceTimestamp, value.ServerTimestamp)


def _part(content: Any, slices: list[slice]) -> Any:
    """Return a part of a value, or None if there is nothing."""
    first, *more = slices
    cut = content[first]
    if not more:
        return cut
    if not isinstance(content, list) or not all(isinstance(each, list | str | bytes) for each in cut):
        return None
    parts = [_part(each, more) for each in cut]
    return parts if all(parts) else None
