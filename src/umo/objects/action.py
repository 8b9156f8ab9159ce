"""Actions: methods that a person or another program may call from outside while the machine runs."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from functools import cache
from itertools import chain, starmap
from math import inf
from typing import Any, Literal, TypeVar, cast, get_args, get_origin, overload

from umo.errors import DeclarationError, RangeError, StateError
from umo.objects.compound import Compound
from umo.objects.laws import laws_in
from umo.objects.paths import walk
from umo.objects.range import Range
from umo.objects.truth import checked_truth
from umo.signature import signature_of
from umo.text import cut_repr, did_you_mean
from umo.user_code import raise_as

F = TypeVar("F", bound=Callable[..., Any])
Declared = Range | Callable[[Any], Range]
"""Unit and range of an argument, or a function that takes the compound and returns them."""
MARK = "__umo_action__"
"""The name of the attribute by which the decorator marks a method."""
KINDS: Mapping[Any, str] = {float: "number", int: "integer", bool: "bool", str: "text"}
"""Kinds of arguments by their types."""


@dataclass(frozen=True)
class _Mark:
    """The arguments of the decorator."""

    ranges: Mapping[str, Declared]
    harmless: bool
    apart: bool
    release: str | None


@overload
def action(function: F, /) -> F: ...
@overload
def action(
    *, harmless: bool = ..., apart: bool = ..., release: str | None = ..., **ranges: Declared
) -> Callable[[F], F]: ...
def action(
    function: Any = None,
    /,
    *,
    harmless: bool = False,
    apart: bool = False,
    release: str | None = None,
    **ranges: Declared,
) -> Any:
    """Mark a method, or an `async def` sequence, of a compound or of a law as an action: `umo do STATION call` and
    `umo.attach` may call it from outside while the machine runs.

        class Press(Compound):
            @action(force=Range("kN", 0.0, 80.0))
            async def close(self, force: float) -> None: ...

            @action(velocity=lambda press: Range("mm/s", -press.velocity, press.velocity), release="halt")
            def jog(self, velocity: float) -> None: ...

            def halt(self) -> None: ...

            @action(harmless=True)
            def clear_count(self) -> None: ...

    Every argument is annotated: float, int, bool, str, an Enum, a two-state type or a Literal. A number needs a
    `Range`, or a function of the compound that returns one. `harmless`: the action may also be called in automatic
    mode, while the application runs. `apart`: the page shows the action apart from the others, in red, so that nobody
    clicks it by mistake. `release`: the action lasts as long as the caller holds it. Then its sequences are cancelled,
    and the method with this name is called without arguments. This method must end what the action began, and must
    start nothing: it is also called if the action has already ended for another reason. A sequence that an action
    starts (`cycle.start`) belongs to it: it ends when the action is cancelled, or the lease ends. Actuators that an
    action still drives when the lease ends in manual mode react as declared by `when_suspended`. The first line of the
    docstring describes the action. The result must be plain data; clients see at most 448 bytes of its JSON.
    """
    mark = _Mark(ranges, checked_truth("harmless", harmless), checked_truth("apart", apart), release)
    if function is None:
        return lambda method: _marked(method, mark)
    if not callable(function):
        raise DeclarationError(f"@action marks a method, not {cut_repr(function)}; its arguments are given by name")
    return _marked(function, mark)


def _marked(function: F, mark: _Mark) -> F:
    setattr(function, MARK, mark)
    return function


@dataclass(frozen=True)
class Argument:
    """One argument of an action."""

    name: str
    kind: str
    """The kind of the argument's values: "number", "integer", "bool", "text" or "choice"."""
    range: Range | None
    """Unit and bounds of a number; None for any other kind."""
    choices: Mapping[str, Any]
    """The values of a choice by their names."""
    required: bool
    default: Any = None

    def converted(self, value: Any, path: str) -> Any:
        """Return the value for the method. Raises RangeError or StateError if it is not valid."""
        name = f"{path}: {self.name}"
        if self.kind == "choice":
            if not isinstance(value, str) or value not in self.choices:
                known = ", ".join(self.choices)
                raise StateError(f"{name}: {value!r} is not one of {known}{did_you_mean(str(value), self.choices)}")
            return self.choices[value]
        if self.range is not None:
            return (self.range.check_whole if self.kind == "integer" else self.range.check)(name, value)
        if type(value) is not (bool if self.kind == "bool" else str):
            raise StateError(f"{name}: {value!r} is not {'true or false' if self.kind == 'bool' else 'a string'}")
        return value

    def describe(self) -> dict[str, Any]:
        """Return the argument as plain data."""
        about: dict[str, Any] = {"name": self.name, "kind": self.kind, "required": self.required}
        if self.range is not None:
            about |= self.range.describe()
        if self.choices:
            about["choices"] = list(self.choices)
        return about | ({} if self.default is None else {"default": self.default})


@dataclass(frozen=True)
class Action:
    """An action of a compound of a machine, or of a law of the compound."""

    path: str
    """Path of the action, such as `z.move_to`."""
    part: Compound
    """The object that has the action."""
    call: Callable[..., Any]
    arguments: tuple[Argument, ...]
    harmless: bool
    release: Callable[[], Any] | None
    """Method that ends what the action began, under dead-man control, or None if the action ends by itself."""
    help: str
    apart: bool = False

    def converted(self, given: Mapping[str, Any]) -> dict[str, Any]:
        """Return the arguments for the method. Raises RangeError or StateError if an argument is missing, unknown or
        not allowed."""
        known = {each.name: each for each in self.arguments}
        for name in given:
            if name not in known:
                names = ", ".join(known) or "none"
                raise RangeError(
                    f"{self.path}: there is no argument {name!r}{did_you_mean(name, known)}; it has: {names}"
                )
        for name, each in known.items():
            if each.required and name not in given:
                raise RangeError(f"{self.path}: the argument {name} is missing")
        return {name: known[name].converted(value, self.path) for name, value in given.items()}

    def describe(self) -> dict[str, Any]:
        """Return the action as plain data."""
        return {
            "path": self.path,
            "help": self.help,
            "arguments": [each.describe() for each in self.arguments],
            "harmless": self.harmless,
            "apart": self.apart,
            "dead_man": self.release is not None,
        }


def actions_of(root: Compound) -> dict[str, Action]:
    """Return every action of the compounds of a machine and of their laws, by path. Raises DeclarationError for an
    argument without a type or a range."""
    compounds = ((node, node._path, node) for node in (root, *walk(root)) if isinstance(node, Compound))
    owners = chain(compounds, laws_in(root))
    marked = ((part, path, owner, *each) for part, path, owner in owners for each in _marks(owner.__class__).items())
    return {each.path: each for each in starmap(_action, marked)}


def actions_on(part: Compound, path: str, owner: Any) -> dict[str, Action]:
    """Return the actions of the object at this path, by their paths. The object must not be a law itself. `part` is the
    compound that has the object."""
    found = (_action(part, path, owner, *each) for each in _marks(owner.__class__).items())
    return {each.path: each for each in found}


@cache
def _marks(kind: Any) -> dict[str, _Mark]:
    """Return the arguments of the decorator by the names of the methods, in the order of declaration. The methods of
    bases come first."""
    names = dict.fromkeys(name for each in reversed(kind.__mro__) for name in vars(each))
    found = ((name, getattr(inspect.getattr_static(kind, name, None), MARK, None)) for name in names)
    return {name: mark for name, mark in found if isinstance(mark, _Mark)}


@cache
def _declared(kind: Any, name: str) -> tuple[Mapping[str, inspect.Parameter], str]:
    """Return the parameters of an action without `self`, and the first paragraph of its docstring."""
    method = getattr(object.__new__(kind), name)
    about = (inspect.getdoc(method) or "").partition("\n\n")[0].replace("\n", " ")
    return signature_of(method), about


def _action(part: Compound, place: str, owner: Any, name: str, mark: _Mark) -> Action:
    path = f"{place}.{name}".lstrip(".")
    parameters, about = _declared(owner.__class__, name)
    for given in mark.ranges:
        if given not in parameters:
            raise DeclarationError(f"action {path} has no argument {given!r}{did_you_mean(given, parameters)}")
    arguments = tuple(_argument(owner, path, each, mark.ranges) for each in parameters.values())
    release = _release(owner, path, mark.release)
    return Action(path, part, getattr(owner, name), arguments, mark.harmless, release, about, mark.apart)


def _release(owner: Any, path: str, name: str | None) -> Callable[[], Any] | None:
    if name is None:
        return None
    method = getattr(owner, name, None) if isinstance(name, str) else None
    if not callable(method):
        known = [each for each in dir(owner) if not each.startswith("_") and callable(getattr(type(owner), each, None))]
        raise DeclarationError(f"action {path}: release={name!r} is not a method{did_you_mean(str(name), known)}")
    with raise_as(DeclarationError, f"action {path}: release={name!r} cannot be called without arguments"):
        inspect.signature(method).bind()
    if inspect.iscoroutinefunction(method):
        raise DeclarationError(f"action {path}: release={name!r} is a sequence; a release acts at once")
    return cast("Callable[[], Any]", method)


def _argument(owner: Any, path: str, each: inspect.Parameter, declared: Mapping[str, Declared]) -> Argument:
    where = f"action {path}: argument {each.name}"
    if each.kind in (each.VAR_POSITIONAL, each.VAR_KEYWORD, each.POSITIONAL_ONLY):
        raise DeclarationError(f"{where} cannot be given by its name")
    required = each.default is each.empty
    choices = _choices(each.annotation)
    kind = "choice" if choices else KINDS.get(each.annotation, "")
    if not kind:
        raise DeclarationError(f"{where} must be annotated as float, int, bool, str, an Enum or a Literal")
    given = declared.get(each.name)
    with raise_as(DeclarationError, f"{where}: its range failed"):
        limits = given(owner) if callable(given) else given
    if (kind in ("number", "integer")) != (limits is not None):
        need = "needs a range" if limits is None else "is not a number and has no range"
        raise DeclarationError(f"{where} {need}: @action({each.name}=Range(...))")
    return Argument(each.name, kind, limits, choices, required, None if required else _plain(each.default, choices))


def _choices(kind: Any) -> dict[str, Any]:
    if get_origin(kind) is Literal:
        return {str(each): each for each in get_args(kind)}
    if isinstance(kind, type) and issubclass(kind, Enum):
        return {each.name: each for each in kind}
    return {}


def _plain(default: Any, choices: Mapping[str, Any]) -> Any:
    """Return a default in the form that is shown to people: for a choice, its name. None if the default says nothing to
    them."""
    if choices:
        return next((name for name, value in choices.items() if value == default), None)
    if isinstance(default, float):
        return default if abs(default) < inf else None
    return default if isinstance(default, str | int) else None
