"""The look at what is known, in C and in Python: the same answers, and no crash for what is no watch."""

from __future__ import annotations

from collections.abc import Callable
from types import CellType, FunctionType, MappingProxyType
from typing import Any

import pytest

from umo.cycle.conversion import extension
from umo.generate.known_values import ABSENT, KnownName, KnownValues
from umo.generate.known_watch import ADDRESSES, KnownWatch, _Watch

WAYS = [_Watch] if extension is None else [_Watch, extension.Watch]


class Thing:
    def __init__(self) -> None:
        self.name = "first"


def half(value: float, by: float = 2.0) -> float:
    return value / by


def watch(way: Any, changed: Callable[[], Any] = lambda: False, **other: Any) -> Any:
    given = {
        "spaces": (),
        "always": 0,
        "types": (),
        "contents": (),
        "attributes": (),
        "cells": (),
        "functions": (),
        "in_turn": (),
    } | other
    return way(*given.values(), ADDRESSES, CellType, FunctionType, ABSENT, changed)


@pytest.mark.parametrize("way", WAYS)
def test_what_is_as_it_was_is_true_and_else_the_one_who_asked_is_told(way: Any) -> None:
    thing, scope, names, table = Thing(), {"LIMIT": 1.5}, ["a", "b"], {"a": names_of("x")}
    cell = CellType(names)
    function = (half, half.__code__, half.__defaults__, half.__kwdefaults__)
    spaces = (
        (thing, Thing, -1, ("name", "other"), (thing.name, ABSENT)),
        (scope, None, 1, ("LIMIT",), (scope["LIMIT"],)),
    )
    found = watch(
        way,
        spaces=spaces,
        always=2,
        contents=((names, tuple(names)), (table, ("a", table["a"])), (bytearray(b"xy"), (b"xy",))),
        attributes=((thing, "name", thing.name),),
        cells=((cell, names),),
        functions=(function,),
    )
    assert found.look() is True
    changes: list[tuple[Callable[[], object], Callable[[], object]]] = [
        (lambda: setattr(thing, "other", 1), lambda: delattr(thing, "other")),
        (lambda: scope.update(more=1), lambda: scope.pop("more")),
        (lambda: names.append("c"), names.pop),
        (lambda: table.update(b=[]), lambda: table.pop("b")),
        (lambda: setattr(cell, "cell_contents", []), lambda: setattr(cell, "cell_contents", names)),
        (lambda: setattr(half, "__defaults__", None), lambda: setattr(half, "__defaults__", function[2])),
    ]
    for change, undo in changes:
        change()
        assert found.look() is False
        undo()
        assert found.look() is True


def names_of(text: str) -> list[str]:
    return list(text)


@pytest.mark.skipif(extension is None, reason="there is no extension")
@pytest.mark.parametrize(
    "wrong",
    [
        {"spaces": (1,)},
        {"spaces": (({}, None, 0, (), 1),)},
        {"spaces": (({}, None, 0, ("a",), ()),)},
        {"spaces": ((1, None, 0, (), ()),)},
        {"spaces": ((1, 2, 0, (), ()),)},
        {"always": 1},
        {"types": (1,)},
        {"contents": ((),)},
        {"contents": (([], []),)},
        {"attributes": ((1, 2),)},
        {"cells": ((1, 2),)},
        {"functions": ((len, 1, 2, 3),)},
        {"in_turn": ((half, 1),)},
    ],
)
def test_what_is_no_watch_is_a_type_error(wrong: dict[str, Any]) -> None:
    with pytest.raises(TypeError):
        watch(extension.Watch, **wrong)


def test_a_proxy_of_a_dict_is_as_it_was_without_being_compared_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    behind = {"a": 1.0}
    known, told = KnownValues(), list[KnownName]()
    thing = Thing()
    thing.proxy = MappingProxyType(behind)  # type: ignore[attr-defined]
    known.attribute(thing, "proxy", ("", 1))
    found = KnownWatch(known, told.extend)
    monkeypatch.setattr(found, "_renew", lambda: pytest.fail("compared anew"))
    look = found.look
    assert look() and look()
    behind["a"] = 2.0
    assert not look() and [each.name for each in told] == ["proxy"]
