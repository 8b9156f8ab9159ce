"""The attributes that the functions of a class assign to their object, such as `self.started = self.now`. For a type
checker such attributes are declared. They are read from the compiled code."""

from __future__ import annotations

import dis
from collections.abc import Collection, Iterable, Iterator
from functools import cached_property
from opcode import opmap
from types import CodeType, FunctionType
from typing import Any, NamedTuple

from umo.errors import DeclarationError
from umo.text import CodePlace, shown_place

MAKING = frozenset(("__init__", "__post_init__", "setup"))
"""The functions of an object that create its attributes."""
SHORTEST = 4
"""Least length of a name for which a misspelling can be distinguished from another word."""
_STORE, _EXTENDED = opmap["STORE_ATTR"], opmap["EXTENDED_ARG"]


class Store(NamedTuple):
    """An assignment to an attribute of the object itself."""

    name: str
    function: str
    place: CodePlace


def stores_in(cls: type) -> Iterator[Store]:
    """Return the stores of the functions in the body of a class."""
    for name, value in vars(cls).items():
        for function in functions_of(value):
            code = function.__code__
            if code.co_argcount:
                yield from (Store(found, name, place) for found, place in _stores(code, code.co_varnames[0]))


def functions_of(value: Any) -> Iterator[FunctionType]:
    """Return the functions of a value in a class, including those of a property and of a decorated function."""
    if isinstance(value, property):
        inner = [value.fget, value.fset, value.fdel]
    elif isinstance(value, cached_property):
        inner = [value.func]
    elif isinstance(value, staticmethod | classmethod):
        inner = [value.__func__]
    elif isinstance(value, FunctionType):
        yield value
        inner = [cell.cell_contents for cell in value.__closure__ or () if _is_function(cell)]
    else:
        inner = []
    for each in inner:
        if isinstance(each, FunctionType):
            yield from functions_of(each) if each is not value else ()


def _is_function(cell: Any) -> bool:
    try:
        return isinstance(cell.cell_contents, FunctionType)
    except ValueError:  # it is empty
        return False


def _stores(code: CodeType, own: str) -> Iterator[tuple[str, CodePlace]]:
    raw = code.co_code[::2]
    if raw.find(_STORE) >= 0:
        before: Any = None
        for each in dis.get_instructions(code):
            if each.opcode == _STORE and before is not None and _loads(before, own):
                yield each.argval, CodePlace(code.co_filename, _line_of(each, code), code.co_name)
            before = before if each.opcode == _EXTENDED else each
    for inner in code.co_consts:
        if isinstance(inner, CodeType) and own in inner.co_freevars:
            yield from _stores(inner, own)


def _loads(instruction: Any, own: str) -> bool:
    """Return True if this instruction leaves the object itself as the last value. In some versions of Python an
    instruction loads two values at once."""
    given = instruction.argval
    return "LOAD_" in instruction.opname and own == (given[-1] if isinstance(given, tuple) else given)


def _line_of(instruction: Any, code: CodeType) -> int:
    positions = instruction.positions
    return (positions and positions.lineno) or code.co_firstlineno


def refuse_slips(cls: type, stores: Iterable[Store], known: Collection[str]) -> None:
    """Raise DeclarationError for an assignment outside `setup` to a name that is a misspelling of a known name and that
    no function of the class reads: the assignment would have no effect."""
    for name, _, place in stores:
        meant = next((each for each in known if name not in known and is_slip(name, each)), None)
        if meant is not None and not _is_read(cls, name):
            raise DeclarationError(
                f"{cls.__name__}.{name} is assigned and never read (did you mean {meant!r}?); if {name} is a new "
                f"attribute, give it its first value in the class or in `setup` ({shown_place(place)})"
            )


def is_slip(name: str, meant: str) -> bool:
    """Return True if two neighbouring letters are swapped, or if a letter within the name is missing or added."""
    if min(len(name), len(meant)) < SHORTEST or name[0] != meant[0]:
        return False
    short, long = sorted((name, meant), key=len)
    at = next((n for n, (a, b) in enumerate(zip(short, long, strict=False)) if a != b), len(short))
    if len(short) == len(long):
        return short[at + 1 : at + 2] + short[at : at + 1] + short[at + 2 :] == long[at:] and short != long
    return len(long) == len(short) + 1 and at < len(short) and short[at:] == long[at + 1 :] and long[at].isalpha()


def _is_read(cls: type, name: str) -> bool:
    each_code = (
        code
        for each in cls.__mro__
        for value in vars(each).values()
        for function in functions_of(value)
        for code in _codes(function.__code__)
    )
    using = (each for code in each_code if name in code.co_names for each in dis.get_instructions(code))
    return any(each.argval == name and "LOAD" in each.opname for each in using)


def _codes(code: CodeType) -> Iterator[CodeType]:
    yield code
    for inner in code.co_consts:
        if isinstance(inner, CodeType):
            yield from _codes(inner)
