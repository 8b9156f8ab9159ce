"""The conversion of one value of a recipe, from a file or a client, to the declared type."""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum
from math import inf
from typing import Annotated, Any, get_args, get_origin

from umo.errors import DeclarationError, RangeError, StateError
from umo.objects.range import Range
from umo.objects.units import number_with_unit
from umo.text import did_you_mean

ANY = Range("", -inf, inf)
SEQUENCES = (list, tuple, Sequence)
_PLAIN = {float, int, bool, str}


def value_for(hint: Any, given: Any, *, units: bool = True) -> Any:
    """Return the value, converted to the type in `hint`. Raises RangeError, StateError or DeclarationError if it is not
    valid. `units`: whether a number may be a string with a unit. The first use of a unit takes 1 ms."""
    return _value(*parts_of(hint), given, units)


def _value(kind: Any, limits: Range | None, given: Any, units: bool) -> Any:
    if kind is float or kind is int:
        return _number(kind, limits or ANY, given, units)
    if (origin := get_origin(kind)) in SEQUENCES:
        return _items(kind, origin, limits, given, units)
    if isinstance(kind, type) and issubclass(kind, Enum):
        return _member(kind, given)
    if kind in (bool, str):
        if type(given) is not kind:
            raise StateError(f"must be {'true or false' if kind is bool else 'a string'}, not {given!r}")
        return given
    raise DeclarationError(f"a recipe cannot have values of the type {kind!r}")


def parts_of(hint: Any) -> tuple[Any, Range | None]:
    """Return type and range of an annotation."""
    if get_origin(hint) is not Annotated:
        return hint, None
    return get_args(hint)[0], next((each for each in get_args(hint)[1:] if isinstance(each, Range)), None)


def range_of(hint: Any) -> Range | None:
    """Return the range of a value, or of the values of a sequence; None if there is no range."""
    kind, limits = parts_of(hint)
    if limits is None and get_origin(kind) in SEQUENCES:
        return range_of(get_args(kind)[0])
    return limits


def unit_of(hint: Any) -> str:
    """Return the unit of a value, or of the values of a sequence; "" if there is no unit."""
    limits = range_of(hint)
    return limits.unit if limits else ""


def plain(value: Any) -> Any:
    """Return a value in the form for JSON: an Enum as the name of its member, a tuple as a list."""
    if isinstance(value, Enum):
        return value.name
    if isinstance(value, tuple | list):
        return [each if type(each) in _PLAIN else plain(each) for each in value]
    return value


def _items(kind: Any, origin: Any, limits: Range | None, given: Any, units: bool) -> Any:
    if not isinstance(given, list | tuple):
        raise StateError(f"must be a list, not {given!r}")
    parts = [(of, own or limits) for of, own in map(parts_of, get_args(kind)) if of is not Ellipsis]
    if origin is not tuple or get_args(kind)[-1] is Ellipsis:
        of, range_ = parts[0]
        if of is float and (range_ or ANY).admits(given):  # a client may send hundreds
            return list(map(float, given)) if origin is list else tuple(map(float, given))
        parts = parts[:1] * len(given)
    if len(parts) != len(given):
        raise StateError(f"must be a list of {len(parts)}, not of {len(given)}")
    values = [_value(*part, one, units) for part, one in zip(parts, given, strict=True)]
    return values if origin is list else tuple(values)


def _member(kind: type[Enum], given: Any) -> Enum:
    """Return the member with this name, or with this text as its value."""
    for each in kind:
        if isinstance(given, str) and given in (each.name, each.name.lower(), each.value):
            return each
    known = [each.name for each in kind]
    near = did_you_mean(given, known) if isinstance(given, str) else ""
    raise StateError(f"{given!r} is not one of {', '.join(known)}{near}")


def _number(kind: type, limits: Range, given: Any, units: bool) -> float | int:
    if isinstance(given, str) and not units:
        unit = f" in {limits.unit}" if limits.unit else ""
        raise RangeError(f"{given[:60]!r} is not a number{unit}; a value that is sent must have no unit")
    number = number_with_unit(limits.unit, given) if isinstance(given, str) else given
    try:
        return limits.check_whole("", number) if kind is int else limits.check("", number)
    except RangeError as error:
        raise RangeError(str(error).removeprefix(": ")) from None
