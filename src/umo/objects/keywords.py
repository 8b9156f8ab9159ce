"""The settings of a compound's class: class keywords, such as `class Press(Compound, stop_order=("ram", "valve")):`."""

from __future__ import annotations

from collections import ChainMap
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from umo.duration import seconds, seconds_of_setting
from umo.errors import DeclarationError
from umo.objects.range import Range
from umo.text import did_you_mean

if TYPE_CHECKING:
    from umo.objects.node import Node

ByAttribute = Mapping[str, Range] | Callable[[Any], Mapping[str, Range]]
"""Numbers by the names of attributes, or a function of the object that returns this."""

AlarmsByName = Mapping[str, Any] | Callable[[Any], Mapping[str, Any]]
"""Alarms (`umo.operation.alarms.Alarm`) by their names, or a function of the object that returns this."""

Reaction = Literal["default", "hold", "run on"]
"""The reaction of actuators and axes while nothing controls them. Actuators go to their defaults, or keep their values
("hold" and "run on"). Axes are disabled ("default"), stop on their profiles and stay under control ("hold"), or
continue their motions to the end, except homing and jogs, which stop ("run on")."""
REACTIONS: tuple[Reaction, ...] = ("default", "hold", "run on")
"""The possible reactions of a compound."""

IN_MANUAL = "manual"
"""Value of `equipment`: the compound contains its failures in manual mode only."""


class ClassSettings(NamedTuple):
    """The class keywords of a class and its bases. `Compound` documents them."""

    stop_order: Sequence[str] = ()
    max_period: str | float | None = None
    equipment: bool | Literal["manual"] = False
    numbers: tuple[ByAttribute, ...] = ()
    """The numbers of the class, then those of its bases."""
    when_suspended: Reaction | None = None
    every: int | str | None = None
    alarms: tuple[AlarmsByName, ...] = ()
    """The alarms of the class, then those of its bases."""


def settings_of(cls: type, given: Mapping[str, Any]) -> ClassSettings:
    """Return the settings of a class from its class keywords (not None) and the settings of its bases. Raises
    DeclarationError for an unknown keyword, and for a value of a wrong type."""
    own = {name: value for name, value in given.items() if value is not None}
    for name, value in own.items():
        if name not in KEYWORDS:
            near = f" (did you mean {FORMER_NAMES[name]!r}?)" if name in FORMER_NAMES else did_you_mean(name, KEYWORDS)
            known = ", ".join(KEYWORDS)
            raise DeclarationError(
                f"class {cls.__name__}: there is no class keyword {name!r}{near}; there are: {known}"
            )
        if not _is_valid(name, value):
            raise DeclarationError(f"class {cls.__name__}: {name} is {KEYWORDS[name]}, not {value!r}")
    cls._own_settings = own  # type: ignore[attr-defined]
    each = [vars(base).get("_own_settings", {}) for base in cls.__mro__]
    numbers = tuple(own["numbers"] for own in each if "numbers" in own)
    alarms = tuple(own["alarms"] for own in each if "alarms" in own)
    return ClassSettings(**{**ChainMap(*each), "numbers": numbers, "alarms": alarms})


def declared_reaction(node: Node | None) -> Reaction | None:
    """Return the reaction that the nearest compound declares, from this node up, or None if there is none."""
    while node is not None:
        settings: ClassSettings | None = getattr(node, "_settings", None)
        if settings is not None and settings.when_suspended is not None:
            return settings.when_suspended
        node = node._parent
    return None


KEYWORDS = {
    "stop_order": "a tuple of paths and patterns",
    "max_period": 'a duration such as "2 ms"',
    "equipment": 'True, False or "manual"',
    "numbers": "a mapping by names of attributes, or a function of the object that returns one",
    "when_suspended": '"default", "hold" or "run on"',
    "every": 'a number of periods from 1 on, or a duration such as "10 ms"',
    "alarms": "a mapping of names to Alarms, or a function of the object that returns one",
}
"""The class keywords, each with its type in words."""
FORMER_NAMES = {"stopping": "stop_order", "longest_period": "max_period", "signals": "numbers", "tunable": "numbers"}
"""Former names of class keywords."""
MISSPELT_RATIO = 0.8
"""The least similarity (difflib's ratio) at which a name in a class body counts as a misspelt keyword."""


def refuse_in_body(cls: type, fields: Collection[str]) -> None:
    """Check the body of a class. Raises DeclarationError if the body assigns a setting, even a misspelt one or one with
    a former name, because a setting has no effect there. Fields with these names, methods and classes are allowed."""
    for name, value in vars(cls).items():
        if name.startswith("_") or name in fields or isinstance(value, type):
            continue
        if hasattr(value, "__get__") and not (isinstance(value, property) and name in {*KEYWORDS, *FORMER_NAMES}):
            continue
        meant = name if name in KEYWORDS else FORMER_NAMES.get(name) or _similar(name, value)
        if meant:
            raise DeclarationError(
                f"{cls.__name__}.{name}: give `{meant}` as a class keyword: class {cls.__name__}(..., {meant}=...)"
            )


def _is_valid(name: str, value: Any) -> bool:
    if name == "stop_order":
        return isinstance(value, tuple | list) and all(isinstance(each, str) for each in value)
    if name == "max_period":
        with suppress(DeclarationError):
            return not isinstance(value, bool) and seconds_of_setting(value) > 0
        return False
    if name == "every":
        if isinstance(value, str):
            with suppress(DeclarationError):
                return seconds(value) > 0
        return type(value) is int and value >= 1
    if name == "equipment":
        return value is True or value is False or (isinstance(value, str) and value == IN_MANUAL)
    if name == "when_suspended":
        return isinstance(value, str) and value in REACTIONS
    return isinstance(value, Mapping) or callable(value)


def _similar(name: str, value: Any) -> str:
    """Return the keyword of which this name is a misspelling, or "" if it is none."""
    near = get_close_matches(name, [*KEYWORDS, *FORMER_NAMES], n=1, cutoff=MISSPELT_RATIO)
    meant = FORMER_NAMES.get(near[0], near[0]) if near else ""
    if meant == "alarms":
        declared = isinstance(value, Mapping) and any(type(each).__name__ == "Alarm" for each in value.values())
    elif meant == "numbers":
        declared = isinstance(value, Mapping) and any(isinstance(each, Range | str) for each in value.values())
    else:
        declared = bool(meant) and _is_valid(meant, value)
    return meant if declared else ""
