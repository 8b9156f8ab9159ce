"""Kept numbers: the values that a machine takes over from its last run, and the reason for each value that it does not
take over.

An entry is plain data as in `umo.process.kept_file`: `value` (a number, true or false, the name of an Enum's member or
of a named number, or None if there was no value), `unit` and `type`. Kept values are set after the wiring's parameters
and before the first period. If a value is no longer valid, the number has its default, or the value of the wiring.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from enum import EnumMeta
from functools import partial
from typing import Any

from umo.errors import RangeError, UmoError
from umo.objects import Compound, MachineNumber, numbers_of
from umo.objects.numbers import number_in
from umo.objects.presentation.value_text import shown_unit
from umo.text import did_you_mean
from umo.user_code import raise_as
from umo.wiring.wired import Parameter, apply_parameters

MAX_EXACT = 1 << 53
"""The largest number up to which all whole numbers are exact in frames. Frames contain floats."""
NAME = "name"
"""The type of a kept number with named values. These are kept by name, because the numbers of the names may have
changed since."""
Undo = Callable[[Callable[[], object]], object]


def kept_kind(number: MachineNumber) -> dict[str, Any]:
    """Return the type of a kept number as plain data; for an Enum and a named number, the names by their numbers."""
    if isinstance(number.kind, EnumMeta):
        members: list[Any] = list(number.kind)
        return {"type": "Enum", "members": {str(number_in(number.kind, member)): member.name for member in members}}
    if number.declared.names:
        return {"type": NAME, "members": {str(value): name for value, name in number.declared.names.items()}}
    if number.kind is None:
        return {"type": "int" if isinstance(number.value, int) else "float"}
    return {"type": number.kind.__name__}


def restore(root: Compound, parameters: Sequence[Parameter], kept: Mapping[str, Any], undo: Undo) -> dict[str, str]:
    """Set the wiring's parameters, then the kept values. Return the reason for each value that was not taken over, by
    path.

    `undo` is called, for each number, with a function that restores it. Raises DeclarationError for the wiring's
    parameters in the cases of `apply_parameters`.
    """
    refused: dict[str, str] = {}
    fields = _fields(root, kept, refused)
    fields = _apply(root, parameters, fields, undo, refused)
    known = {path: number for path, number in numbers_of(root).items() if number.declared.kept}
    done = {field.number.path for field in fields}
    for path, value in kept.items():
        if path in done or path in refused:
            continue
        if path not in known:
            refused[path] = f"there is no kept number with this name{did_you_mean(path, known)}"
            continue
        number, before = known[path], known[path].value
        try:
            number.set(_value_of(number, value))
        except RangeError as error:
            refused[path] = _cause(error, path)
        else:
            undo(partial(number.assign, before))
    return refused


def _fields(root: Compound, kept: Mapping[str, Any], refused: dict[str, str]) -> list[Parameter]:
    """Return the kept values of fields. They are set before `setup`, which may compute other values from them. Each
    value has the type of its field; the range is not checked here, because it may depend on other fields and on the
    wiring's parameters."""
    fields = []
    for path, number in numbers_of(root).items():
        if path in kept and number.declared.kept and number.is_field:
            try:
                fields.append(Parameter(number, number.converted(_value_of(number, kept[path]))))
            except RangeError as error:
                refused[path] = _cause(error, path)
    return fields


def _apply(
    root: Compound, parameters: Sequence[Parameter], fields: list[Parameter], undo: Undo, refused: dict[str, str]
) -> list[Parameter]:
    """Set the parameters and the kept fields. If the machine does not accept them together, set only the kept fields
    that are within the ranges of their declarations; if it does not accept these either, set none. Return the fields
    that were set."""
    error = _attempt(root, parameters, fields, undo)
    if error is not None and (outside := _outside(fields)):
        refused |= outside
        fields = [field for field in fields if field.number.path not in outside]
        error = _attempt(root, parameters, fields, undo)
    if error is None:
        return fields
    apply_parameters(root, parameters, undo)
    if not fields:
        raise error
    cause = str(error).removeprefix("the wiring's parameter ")
    refused |= {field.number.path: f"the machine does not accept the kept values: {cause}" for field in fields}
    return []


def _attempt(
    root: Compound, parameters: Sequence[Parameter], fields: Sequence[Parameter], undo: Undo
) -> UmoError | None:
    """Set the parameters and the kept fields. If this fails, undo everything and return the error."""
    taken: list[Callable[[], object]] = []
    try:
        with raise_as(UmoError, "`setup` failed"):
            apply_parameters(root, [*parameters, *fields], taken.append)
            numbers_of(root)  # the range of one may depend on another
    except UmoError as error:
        for each in reversed(taken):
            each()
        return error
    for each in taken:
        undo(each)
    return None


def _outside(fields: Sequence[Parameter]) -> dict[str, str]:
    """Return why values are not within the range of the declaration, by path."""
    found = {}
    for number, value in fields:
        try:
            number.checked(value)
        except RangeError as error:
            found[number.path] = _cause(error, number.path)
    return found


def _value_of(number: MachineNumber, entry: Mapping[str, Any]) -> Any:
    """Return the kept value. Raises RangeError if there is no value, or if it was kept in another unit."""
    if entry["value"] is None:
        raise RangeError("it had no value that can be kept")
    if entry["unit"] != number.declared.unit and not isinstance(number.kind, EnumMeta):
        units = [shown_unit(unit) or "no unit" for unit in (entry["unit"], number.declared.unit)]
        raise RangeError(f"it was kept in {units[0]}, and is declared in {units[1]}")
    by_name = entry["type"] == NAME and number.declared.names
    return _number_of(number, str(entry["value"])) if by_name else entry["value"]


def _number_of(number: MachineNumber, name: str) -> int:
    """Return the value that has this name. Raises RangeError if no value has this name any more."""
    known = {each: value for value, each in number.declared.names.items()}
    if name not in known:
        raise RangeError(f"{name!r} is not one of {', '.join(known)}{did_you_mean(name, known)}")
    return known[name]


def _cause(error: RangeError, path: str) -> str:
    return str(error).removeprefix(f"{path}: ")
