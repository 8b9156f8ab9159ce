"""Tunable numbers: what may be changed from outside while the machine runs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from umo.errors import DeclarationError, RangeError
from umo.objects.compound import Compound
from umo.objects.paths import walk
from umo.objects.range import Range
from umo.objects.settings import as_declared, check_settings
from umo.text import did_you_mean
from umo.user_code import attempt, read_numbers, told_as


class Tunable(NamedTuple):
    """One number: an attribute of a compound, or of something that is an attribute of it, such as a law."""

    path: str
    """Such as `z.servo.gain`."""
    range: Range
    owner: Any
    name: str

    def read(self) -> float:
        """Its value now; NaN if reading it fails."""
        return read_numbers([self])[0]

    def set(self, value: object) -> None:
        """RangeError if the value is not a number within the range, or its owner does not accept it; then the number is
        what it was."""
        number, before = self.range.checked(self.path, value), getattr(self.owner, self.name)
        _, error = attempt(self._set, number)
        if error is not None:
            attempt(setattr, self.owner, self.name, before)
            raise RangeError(f"{self.path}: {error.text}")

    def _set(self, number: float) -> None:
        setattr(self.owner, self.name, as_declared(self.owner, self.name, number))
        check_settings(self.owner)

    def describe(self) -> dict[str, Any]:
        """As plain data."""
        return {"path": self.path, **self.range.describe()}


def tunables_of(root: Compound) -> dict[str, Tunable]:
    """The numbers that compounds declare in `tunable`, by path; DeclarationError for an attribute that is missing or
    not a number."""
    compounds = [node for node in (root, *walk(root)) if isinstance(node, Compound)]
    return {each.path: each for node in compounds for each in _of(node)}


def _of(node: Compound) -> Iterator[Tunable]:
    with told_as(DeclarationError, f"{node._path or type(node).__name__}.tunable failed"):
        declared = given(node) if callable(given := node._settings.tunable) else given
    if not isinstance(declared, Mapping):
        raise DeclarationError(f"{type(node).__name__}.tunable must be a mapping of names to Ranges, not {declared!r}")
    for name, limits in declared.items():
        path = f"{node._path}.{name}".lstrip(".")
        if not isinstance(limits, Range):
            raise DeclarationError(f"tunable {path}: {limits!r} is not a Range")
        owner: Any = node
        *way, last = name.split(".")
        for step in way:
            owner = _attribute(owner, step, path)
        value = _attribute(owner, last, path)
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise DeclarationError(f"tunable {path}: {value!r} is not a number")
        yield Tunable(path, limits, owner, last)


def _attribute(owner: Any, name: str, path: str) -> Any:
    value, error = attempt(getattr, owner, name)
    if error is None:
        return value
    if error.kind is not AttributeError:
        raise DeclarationError(f"tunable {path} cannot be read: {error.text}")
    near = did_you_mean(name, [each for each in dir(owner) if not each.startswith("_")])
    raise DeclarationError(f"tunable {path}: {type(owner).__name__} has no attribute {name!r}{near}")
