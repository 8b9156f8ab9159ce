"""The numbers of a machine, which can be set by a wiring, tuned and shown: the fields of compounds and laws, and the
numbers that compounds and laws declare in `numbers`. If a wiring sets them, bools, strings and Enums also count as
numbers.
"""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable, Iterator, Mapping
from enum import Enum, EnumMeta
from functools import cache, partial
from math import isfinite, nan
from typing import Annotated, Any, NamedTuple, get_args, get_origin

from umo.errors import DeclarationError, RangeError, UmoError
from umo.objects.compound import Compound
from umo.objects.laws import PLAIN, laws_of
from umo.objects.paths import walk
from umo.objects.range import Number, Range
from umo.objects.units import number_with_unit
from umo.signature import evaluated, hints_of
from umo.text import did_you_mean
from umo.user_code import attempt, raise_as

_MISSING = object()


class MachineNumber(NamedTuple):
    """One number of a machine: an attribute of a compound or of one of its parts, such as a law."""

    path: str
    """Path of the number, such as `z.servo.gain`."""
    declared: Number
    owner: Any
    name: str
    kind: type | None
    """Type: bool, int, float, str or an Enum; None means a number without an annotation, which stays an int as long as
    it is whole."""
    is_field: bool
    """True if the number is a field of a compound. `setup` may compute other numbers from a field."""
    settable: bool
    """True if a wiring may set the number: if it is a field, or is declared in `numbers` and not only shown."""

    @property
    def value(self) -> Any:
        """The present value of the number; NaN if reading it fails."""
        value, error = attempt(getattr, self.owner, self.name)
        return nan if error is not None else value

    def read(self) -> float:
        """Return the present value of the number as a float; NaN if reading it fails, or if it has no value."""
        number, error = attempt(float, self.value)
        return nan if error is not None else number

    def checked(self, value: object) -> Any:
        """Return the value to set, with an Enum given by its name. Raises RangeError if the value has another type or
        is outside the range."""
        if self.kind in (bool, str):
            if type(value) is not self.kind:
                raise RangeError(
                    f"{self.path}: {value!r} is not {'true or false' if self.kind is bool else 'a string'}"
                )
            return value
        if isinstance(self.kind, EnumMeta):
            members: Mapping[str, Any] = self.kind.__members__
            name = getattr(value, "name", value)
            if not isinstance(name, str) or name not in members:
                near = did_you_mean(str(name), members)
                raise RangeError(f"{self.path}: {value!r} is not one of {', '.join(members)}{near}")
            return members[name]
        number = self.declared.checked(self.path, value)
        if self.kind is int:
            return self.declared.check_whole(self.path, value)
        if self.kind is None and isinstance(self.value, int) and number == int(number):
            return int(number)
        return float(number)

    def from_written(self, value: object) -> object:
        """Return a value as a file has it, where a number may be a string with a unit, such as "0.5 kg". Raises
        RangeError or DeclarationError for any other string in place of a number."""
        if isinstance(value, str) and self.kind in (None, int, float):
            return number_with_unit(self.declared.unit, value)
        return value

    def of_its_type(self, value: object) -> object:
        """Return the value unchanged. Raises RangeError if it does not have the type of the number; the range is not
        checked."""
        self.converted(value)
        return value

    def converted(self, value: object) -> Any:
        """Return the value in the form in which it is set. Raises RangeError if it does not have the type of the
        number; the range is not checked."""
        return self._replace(declared=Number(self.declared.unit)).checked(value)

    def assign(self, value: Any) -> None:
        """Set a value that was already checked."""
        setattr(self.owner, self.name, value)

    def set(self, value: object) -> None:
        """Tune the number. Raises RangeError if the value is not a number within the range, or if the owner of the
        number does not accept it; then the number is not changed."""
        number, before = self.checked(value), self.value
        _, error = attempt(self._set, number)
        if error is not None:
            attempt(self.assign, before)
            raise RangeError(f"{self.path}: {error.text}")

    def _set(self, number: Any) -> None:
        self.assign(number)
        check_settings(self.owner)

    @property
    def states(self) -> Mapping[int, str]:
        """The names of the values of an Enum by their numbers, or the declared names of values; empty for a plain
        number."""
        return states_of(self.kind) if isinstance(self.kind, EnumMeta) else self.declared.names

    def describe(self) -> dict[str, Any]:
        """Return the number as plain data."""
        return {"path": self.path, **self.declared.describe()}


@cache
def states_of(kind: EnumMeta) -> Mapping[int, str]:
    """Return the names of an Enum's members by number: by their values if all are whole numbers, otherwise by their
    positions, counted from 0."""
    members: list[Any] = list(kind.__members__.values())
    whole = all(type(each.value) is int for each in members)
    return {each.value if whole else place: each.name.lower().replace("_", " ") for place, each in enumerate(members)}


def number_in(kind: EnumMeta, member: Any) -> int:
    """Return the number of a member, as in `states_of`."""
    return int(member.value) if type(member.value) is int else list(kind.__members__.values()).index(member)


def numbers_of(root: Compound) -> dict[str, MachineNumber]:
    """Return every number of a machine, by path: for each compound the numbers that it declares in `numbers`, then its
    fields, then the numbers of its laws. Declarations of a compound override those of its laws. Raises DeclarationError
    for an invalid declaration."""
    found: dict[str, MachineNumber] = {}
    for node in (root, *walk(root)):
        if isinstance(node, Compound):
            for number in _of(node):
                found.setdefault(number.path, number)
    return found


def check_settings(owner: Any) -> None:
    """Ask a law to check its settings after a change. Raises DeclarationError or RangeError if the settings are not
    valid. An owner that has no `check_settings` accepts all."""
    check = getattr(owner, "check_settings", None)
    if callable(check):
        with raise_as(DeclarationError, f"{type(owner).__name__}.check_settings failed"):
            check()


def _of(node: Compound) -> Iterator[MachineNumber]:
    place = node._path
    for declared in node._settings.numbers:
        yield from _declared(node, place, partial(declared, node) if callable(declared) else declared)
    yield from _fields(node, place)
    known: set[int] = set()  # a law that is in a list as well has its numbers once
    for name, law in laws_of(node):
        if id(law) not in known:
            known.add(id(law))
            path = f"{place}.{name}".lstrip(".")
            yield from _declared(law, path, partial(getattr, law, "numbers", None))
            yield from _fields(law, path)


def _fields(owner: Any, path: str) -> Iterator[MachineNumber]:
    """Return the fields whose values a wiring can set, of a compound or of a law that is a dataclass."""
    for name, (kind, limits) in _fields_of(owner.__class__).items():
        value, _ = attempt(getattr, owner, name)
        full = f"{path}.{name}".lstrip(".")
        if isinstance(limits, str):
            raise DeclarationError(f"number {full}: its annotation {limits!r} cannot be evaluated")
        if isinstance(value, PLAIN):
            is_field, kind = isinstance(owner, Compound), kind or _kind_of(value)
            yield _checked(MachineNumber(full, _number(limits), owner, name, kind, is_field, True))


@cache
def _fields_of(cls: Any) -> Mapping[str, tuple[type | None, Range | str | None]]:
    """Return type and range of each public field of a dataclass. In place of the range there is a text if the
    annotation cannot be evaluated and seems to contain a range. The result is empty for a frozen dataclass, and for any
    other class."""
    params: Any = getattr(cls, "__dataclass_params__", None)
    if params is None or params.frozen:
        return {}
    hints, fields = hints_of(cls), dataclasses.fields(cls)
    names = [each.name for each in fields if each.init and not each.name.startswith("_")]
    return {name: _annotated(hints.get(name)) for name in names}


def _annotated(hint: Any) -> tuple[type | None, Range | str | None]:
    if isinstance(hint, str) and "Annotated" in hint:
        return None, hint
    limits = next((each for each in get_args(hint)[1:] if isinstance(each, Range)), None)
    kind = get_args(hint)[0] if get_origin(hint) is Annotated else hint
    known = isinstance(kind, type) and issubclass(kind, PLAIN) and not (isinstance(kind, EnumMeta) and not len(kind))
    return kind if known else None, limits  # an Enum without members is the base of several: its value tells which


def _number(limits: Any) -> Number:
    """Return the range of a number as a `Number`, with its use."""
    if isinstance(limits, Number):
        return limits
    return ANY_NUMBER if limits is None else Number(limits.unit, limits.minimum, limits.maximum)


def _declared(owner: Any, path: str, given: Callable[[], Any] | Mapping[str, Range]) -> Iterator[MachineNumber]:
    """Return the numbers that an object declares in `numbers`."""
    where = path or type(owner).__name__
    try:
        with raise_as(DeclarationError, "failed"):
            declared = given() if callable(given) else given
    except UmoError as error:
        raise DeclarationError(f"numbers of {where}: {error}") from error
    if not isinstance(declared, Mapping):
        if not isinstance(owner, Compound):
            return  # an attribute of this name that has another meaning
        raise DeclarationError(f"numbers of {where}: must be a mapping of names to Numbers, not {declared!r}")
    if not isinstance(owner, Compound) and not any(isinstance(each, Range) for each in declared.values()):
        return
    for name, limits in declared.items():
        full = f"{path}.{name}".lstrip(".")
        if not isinstance(name, str) or not isinstance(limits, Range):
            raise DeclarationError(f"number {full}: {limits!r} is not a Number")
        way, _, last = name.rpartition(".")
        yield _checked(_at(full, _number(limits), owner, way, last))


def _at(path: str, declared: Number, owner: Any, way: str, name: str) -> MachineNumber:
    """Return the number that is the attribute `name` of the object at the end of `way`, which leads through attributes,
    indices and keys."""
    is_field = not way and isinstance(owner, Compound)
    for step in filter(None, way.split(".")):
        owner = _step(owner, step, path)
    cls: Any = type(owner)
    fields = _fields_of(cls)
    static = inspect.getattr_static(cls, name, _MISSING)  # not of the object: looking into its dict makes it slower
    only_shown = declared.shown and not (declared.tunable or declared.kept) and name not in fields
    value = None if only_shown and static is not _MISSING else _attribute(owner, name, path)  # it may need the machine
    if only_shown:
        named = _annotated(hints_of(cls).get(name))[0] or _returned(static) or _kind_of(value)
        return MachineNumber(path, declared, owner, name, named if isinstance(named, EnumMeta) else None, False, False)
    if not isinstance(value, PLAIN):
        raise DeclarationError(f"number {path}: {value!r} is not a number")
    if isinstance(static, property) and static.fset is None:
        raise DeclarationError(f"number {path}: the property {name} cannot be set; it can be shown")
    kind = _annotated(hints_of(cls).get(name))[0] or _returned(static) or _kind_of(value)
    return MachineNumber(path, declared, owner, name, kind, is_field and name in fields, True)


def _checked(number: MachineNumber) -> MachineNumber:
    """Check a number and return it. Raises DeclarationError for a use that the type of the number does not allow, and
    for a value outside the range. A value that is not finite means that there is no value."""
    tunable, shown = number.declared.tunable, number.declared.shown
    if tunable and number.kind not in (None, int, float):
        raise DeclarationError(f"number {number.path}: {number.value!r} is not a number; only numbers are tuned")
    if shown and number.kind is str:
        raise DeclarationError(f"number {number.path}: {number.value!r} is a string; only numbers and Enums are shown")
    if number.declared.kept and (number.kind is str or not number.settable):
        raise DeclarationError(
            f"number {number.path}: {number.value!r} cannot be kept; only numbers, true or false, and Enums are"
        )
    value = number.value if number.settable else nan
    if not isinstance(value, float) or isfinite(value):
        try:
            number.checked(value)
        except RangeError as error:
            raise DeclarationError(f"number {error}") from None
    return number


def _step(owner: Any, name: str, path: str) -> Any:
    """Return an attribute of an object, or the item of a list or dict with this index or key."""
    if isinstance(owner, Mapping) and name in (keys := {str(key): key for key in owner}):
        return owner[keys[name]]
    if isinstance(owner, list | tuple) and name.isdigit() and int(name) < len(owner):
        return owner[int(name)]
    return _attribute(owner, name, path)


def _attribute(owner: Any, name: str, path: str) -> Any:
    value, error = attempt(getattr, owner, name)
    if error is None:
        return value
    if error.kind is not AttributeError:
        raise DeclarationError(f"number {path} cannot be read: {error.text}")
    near = did_you_mean(name, [each for each in dir(owner) if not each.startswith("_")])
    raise DeclarationError(f"number {path}: {type(owner).__name__} has no attribute {name!r}{near}")


def _returned(static: Any) -> type | None:
    """Return the type in the return annotation of a property, or None."""
    if not isinstance(static, property) or static.fget is None:
        return None
    function: Any = static.fget
    annotation = getattr(function, "__annotations__", {}).get("return")
    return None if annotation is None else _annotated(evaluated(annotation, getattr(function, "__globals__", {})))[0]


def _kind_of(value: Any) -> type | None:
    """Return the type of a value without an annotation; None for a number."""
    return type(value) if isinstance(value, bool | str | Enum) else None


ANY_NUMBER = Number()
"""A number without a unit and bounds."""
