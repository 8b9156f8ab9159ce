"""Limits the lengths in a message by the number of the message's bytes (OPC 10000-6, 5.2).

asyncua 2.1 trusts the lengths in a message. It would decode, for example: an array with two thousand million nulls,
which take no bytes; a string with a length of -4 bytes, which makes the decoder go back and read the string again;
dimensions of a million for an empty array. A hundred bytes, sent before any session, would cost minutes and gigabytes.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from math import prod
from typing import Any

from asyncua import ua
from asyncua.common.utils import ServiceError
from asyncua.ua import ua_binary as binary

from umo.clients.faces.opcua.ua_limits import MAX_DIMENSIONS, MAX_ELEMENTS

Decode = Callable[[Any], Any]
WRONG = ua.StatusCodes.BadDecodingError
_primitives, _shaped = binary._create_uatype_array_deserializer, binary._reshape


def bound() -> None:
    """Make asyncua decode with the functions of this module."""
    binary._Bytes.unpack = staticmethod(_bytes)
    binary._create_uatype_array_deserializer = _array
    binary._create_list_deserializer = _list
    binary._reshape = _reshaped
    for each in ("type", "uatype", "dataclass"):  # what was made before has asyncua's own inside
        getattr(binary, f"_create_{each}_deserializer").cache_clear()


def _bytes(data: Any) -> bytes | None:
    length = binary.Primitives.Int32.unpack(data)
    if length < -1:
        raise ServiceError(WRONG)
    return None if length == -1 else data.read(length)


@cache
def _array(kind: Any) -> Decode:
    if hasattr(binary.Primitives1, kind.name):
        return _primitives(kind)  # all of it is read in one piece
    element = binary._create_uatype_deserializer(kind)
    return lambda data: _elements(element, data)


@cache
def _list(kind: Any) -> Decode:
    def decode(data: Any) -> list[Any]:  # a structure may have lists of itself: it is looked up when one comes
        return _elements(binary._create_type_deserializer(kind, type(None)), data) or []

    return decode


class Count:
    """Counts the elements of the array that is being decoded, and of the arrays inside it."""

    depth = elements = 0


_count = Count()


def _elements(element: Decode, data: Any) -> list[Any] | None:
    """Decode the elements of an array. Raises ServiceError if the array has more elements than bytes are left, as each
    element takes at least one byte."""
    length = binary.Primitives.Int32.unpack(data)
    if length == -1:
        return None
    if not 0 <= length <= len(data):
        raise ServiceError(WRONG)
    _count.elements = length + (_count.elements if _count.depth else 0)
    if _count.elements > MAX_ELEMENTS:
        raise ServiceError(ua.StatusCodes.BadEncodingLimitsExceeded)
    _count.depth += 1
    try:
        return [_element(element, data) for _ in range(length)]
    finally:
        _count.depth -= 1


def _element(decode: Decode, data: Any) -> Any:
    before = len(data)
    found = decode(data)
    if len(data) >= before:
        raise ServiceError(WRONG)
    return found


def _reshaped(flat: list[Any], dimensions: list[int] | None) -> list[Any]:
    """Return the elements in the shape of an array. Raises ServiceError if the dimensions do not match the number of
    elements."""
    if not dimensions or len(dimensions) > MAX_DIMENSIONS or min(dimensions) < 0 or prod(dimensions) != len(flat):
        raise ServiceError(WRONG)
    return _shaped(flat, dimensions) if flat else flat
