"""The look at what is known, in C and in Python: the same answers, and no crash for what is no watch."""

from __future__ import annotations

import ctypes
import gc
import sys
from collections.abc import Callable
from types import CellType, FunctionType, MappingProxyType
from typing import Any

import numpy as np
import pytest

from umo.cycle.conversion import extension
from umo.generate import bound_fields
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


@pytest.mark.skipif(extension is None, reason="the watch in C")
def test_a_watch_that_is_looked_at_while_it_is_collected_says_no() -> None:
    """What it has held is gone: somebody whose end comes with it may still ask."""
    answers: list[bool] = []
    address = 0

    @ctypes.CFUNCTYPE(None, ctypes.c_void_p)
    def ending(capsule: int) -> None:
        answers.append(ctypes.cast(address, ctypes.py_object).value.look())

    new = ctypes.pythonapi.PyCapsule_New
    new.restype, new.argtypes = ctypes.py_object, [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p]
    thing = Thing()
    found = watch(
        extension.Watch,
        lambda: True,
        spaces=((thing, Thing, -1, ("name",), (thing.name,)),),
        always=1,
        attributes=((half, "end", new(1, None, ctypes.cast(ending, ctypes.c_void_p))),),
    )
    address, holder = id(found), [found]
    holder.append(holder)  # type: ignore[arg-type]  # it is collected, after the watch
    del holder, found
    gc.collect()
    assert answers == [False]


@pytest.mark.parametrize("more", [-1, 0, 1])
def test_a_list_of_one_name_is_not_shared_however_this_python_counts_references(
    monkeypatch: pytest.MonkeyPatch, more: int
) -> None:
    """Python 3.14 counts one less of what a function has on its stack."""
    count = sys.getrefcount
    monkeypatch.setattr(sys, "getrefcount", lambda value: count(value) - 1 + more)  # this call has one of its own
    monkeypatch.setattr(bound_fields, "ALONE", bound_fields._references())
    other: list[float] = []
    names: dict[str, Any] = {"alone": [1.0], "shared": other, "array": np.zeros(2), "part": np.zeros(4)[1:]}
    assert [name for name in list(names) if bound_fields.is_shared(names, name)] == ["shared"]
    whole = np.zeros(4)
    assert bound_fields.is_shared({"part": whole[1:]}, "part")
