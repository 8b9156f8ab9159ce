"""The look at what is known, in C and in Python: the same answers, and no crash for what is no watch."""

from __future__ import annotations

import ctypes
import gc
import sys
from collections.abc import Callable
from types import CellType, MappingProxyType
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from umo.cycle.conversion import extension
from umo.generate import bound_fields
from umo.generate.known_values import ABSENT, KnownName, KnownValues
from umo.generate.known_watch import Attribute, KnownWatch, Space, _Watch, behind
from umo.generate.python_memory import place_of, place_of_version

WAYS = [_Watch] if extension is None else [_Watch, extension.Watch]


class Thing:
    def __init__(self) -> None:
        self.name = "first"


def half(value: float, by: float = 2.0) -> float:
    return value / by


def watch(way: Any, changed: Callable[[], Any] = lambda: False, **other: Any) -> Any:
    given = {"spaces": (), "always": 0, "attributes": (), "attributes_always": 0, "contents": ()} | other
    return way(*given.values(), ABSENT, changed)


def attribute(owner: Any, name: str) -> Attribute:
    value = getattr(owner, name)
    return owner, name, value, place_of(owner, name, value)


@pytest.mark.parametrize("way", WAYS)
def test_what_is_as_it_was_is_true_and_else_the_one_who_asked_is_told(way: Any) -> None:
    thing, scope, names, table = Thing(), {"LIMIT": 1.5}, ["a", "b"], {"a": names_of("x")}
    cell = CellType(names)
    found = watch(
        way,
        spaces=(
            (vars(thing), ("name", "other"), (thing.name, ABSENT), 0),
            (scope, ("LIMIT",), (scope["LIMIT"],), place_of_version(scope)),
        ),
        always=2,
        contents=((names, tuple(names)), (table, ("a", table["a"])), (bytearray(b"xy"), (b"xy",))),
        attributes=(attribute(cell, "cell_contents"), attribute(half, "__defaults__"), attribute(thing, "__class__")),
        attributes_always=3,
    )
    assert found.look() is True
    before, limit = half.__defaults__, scope["LIMIT"]
    changes: list[tuple[Callable[[], object], Callable[[], object]]] = [
        (lambda: setattr(thing, "other", 1), lambda: delattr(thing, "other")),
        (lambda: scope.update(LIMIT=2.0), lambda: scope.update(LIMIT=limit)),
        (lambda: names.append("c"), names.pop),
        (lambda: table.update(b=[]), lambda: table.pop("b")),
        (lambda: setattr(cell, "cell_contents", []), lambda: setattr(cell, "cell_contents", names)),
        (lambda: setattr(half, "__defaults__", None), lambda: setattr(half, "__defaults__", before)),
        (lambda: setattr(thing, "__class__", Other), lambda: setattr(thing, "__class__", Thing)),
    ]
    for change, undo in changes:
        change()
        assert found.look() is False
        undo()
        assert found.look() is True


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("changed", range(5))
def test_what_is_looked_at_in_turn_is_seen_in_as_many_looks(way: Any, changed: int) -> None:
    spaces, cells = [{"name": each} for each in range(5)], [CellType(each) for each in range(5)]
    given = (
        {"spaces": tuple((each, ("name",), (each["name"],), 0) for each in spaces)},
        {"attributes": tuple(attribute(each, "cell_contents") for each in cells)},
    )
    for number, what in enumerate(given):
        found = watch(way, **what)
        assert all(found.look() for _ in range(10))
        (spaces[changed].clear, lambda: setattr(cells[changed], "cell_contents", None))[number]()
        assert not all(found.look() for _ in range(5))


class Other(Thing):
    """Another class."""


class Everything:
    """What can be watched, and the ways to change it; each way is one of few values, so what was may come back."""

    def __init__(self) -> None:
        self.values = [object(), object(), None]
        self.kind: Any = type("Kind", (Thing,), {"a": self.values[0]})
        self.slotted = type("Slotted", (), {"__slots__": ("a", "b")})()
        self.slotted.a = self.slotted.b = self.values[0]
        self.thing = self.kind()
        self.scope: dict[str, Any] = {"a": self.values[0]}
        self.cell = CellType(self.values[0])
        self.defaults: list[Any] = [(1.0,), (2.0,), None]

        def function(by: float = 1.0) -> None:
            """Nothing."""

        self.function = function
        function.__defaults__ = self.defaults[0]
        self.dicts = [vars(self.thing), {"a": self.values[0]}]

    def put(self, what: str, name: str, number: int) -> None:
        value = self.values[number]
        if what == "default":
            self.function.__defaults__ = self.defaults[number]
        elif what == "cell":
            self.cell.cell_contents = value
        elif what == "class":
            self.thing.__class__ = (self.kind, Other, self.kind)[number]
        elif what == "dict":
            self.thing.__dict__ = self.dicts[number % 2]
        elif what == "bases":
            self.kind.__bases__ = ((Thing,), (Other,), (Thing,))[number]
        elif what == "global":
            self.scope[name] = value
        elif what == "deleted":
            vars(self.thing).pop(name, None)
        elif what == "by vars":
            vars(self.thing).update({name: value})
        else:
            setattr({"slot": self.slotted, "attribute": self.thing, "of class": self.kind}[what], name, value)

    def watched(self, way: Any) -> Any:
        def space(names: dict[str, Any]) -> Space:
            return names, ("a", "b"), (names.get("a", ABSENT), names.get("b", ABSENT)), place_of_version(names)

        owners = (self.slotted, "a"), (self.slotted, "b"), (self.thing, "__class__"), (self.thing, "__dict__")
        others = (self.kind, "__mro__"), (self.cell, "cell_contents"), (self.function, "__defaults__")
        attributes = tuple(attribute(*each) for each in (*owners, *others))
        spaces = space(vars(self.thing)), space(self.scope), space(behind(vars(self.kind)))
        return watch(way, spaces=spaces, always=3, attributes=attributes, attributes_always=len(attributes))


WHAT = "default", "cell", "class", "dict", "bases", "global", "deleted", "by vars", "slot", "attribute", "of class"
PUT = st.tuples(st.sampled_from(WHAT), st.sampled_from("abc"), st.integers(0, 2))


@pytest.mark.skipif(extension is None, reason="there is no extension")
@given(st.lists(st.lists(PUT, max_size=3), min_size=1, max_size=12))
@settings(max_examples=100, derandomize=True)
def test_whatever_is_changed_c_sees_what_python_sees(turns: list[list[tuple[str, str, int]]]) -> None:
    found = Everything()
    python, native = found.watched(_Watch), found.watched(extension.Watch)
    for puts in turns:
        for each in puts:
            if not (each[0] == "slot" and each[1] == "c"):
                found.put(*each)
        assert native.look() is python.look()


@pytest.mark.skipif(extension is None, reason="there is no extension")
def test_it_is_known_where_this_python_keeps_what_is_looked_at() -> None:
    found = Everything()
    assert all(place_of(owner, name, getattr(owner, name)) for owner, name in (
        (found.slotted, "a"), (found.thing, "__class__"), (found.thing, "__dict__"), (found.kind, "__mro__"),
        (found.cell, "cell_contents"), (found.function, "__code__"), (found.function, "__defaults__"),
        (found.function, "__kwdefaults__"),
    ))  # fmt: skip
    assert bool(place_of_version({})) == (sys.version_info[:3] != (3, 13, 0))  # which does not tell of each change


def names_of(text: str) -> list[str]:
    return list(text)


@pytest.mark.skipif(extension is None, reason="there is no extension")
@pytest.mark.parametrize(
    "wrong",
    [
        {"spaces": (1,)},
        {"spaces": (({}, (), 1, 0),)},
        {"spaces": (({}, ("a",), (), 0),)},
        {"spaces": ((1, (), (), 0),)},
        {"always": 1},
        {"contents": ((),)},
        {"contents": (([], []),)},
        {"attributes": (1,)},
        {"attributes": ((1, 2),)},
        {"attributes": ((1, 2, 3, 0),)},
        {"attributes_always": 1},
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
        spaces=((vars(thing), ("name",), (thing.name,), 0),),
        always=1,
        attributes=((half, "end", new(1, None, ctypes.cast(ending, ctypes.c_void_p)), 0),),
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
    monkeypatch.setattr(bound_fields, "REFERENCES_OF_ONE_NAME", bound_fields._references())
    other: list[float] = []
    names: dict[str, Any] = {
        "alone": [1.0],
        "shared": other,
        "array": np.zeros(2),
        "part": np.zeros(4)[1:],
        "none": None,
    }
    before = repr(names)
    assert [name for name in list(names) if bound_fields.is_shared(names, name)] == ["shared"]
    assert repr(names) == before
    whole = np.zeros(4)
    assert bound_fields.is_shared({"part": whole[1:]}, "part")
