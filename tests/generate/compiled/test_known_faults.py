"""Faults that are planted in what watches known things: each removes one watch, and the ways of setting find it."""

from __future__ import annotations

from collections.abc import Callable
from ctypes import addressof, c_uint64
from types import CellType, FunctionType
from typing import Any

import pytest

from helpers.generating import needs_a_compiler
from helpers.known_runs import AFTER, check
from helpers.known_things import WAYS
from tools.planted_faults import Edit, changed, function_with
from umo.generate import bound_fields, known_values, known_watch
from umo.generate.bound_fields import BoundFields
from umo.generate.compiled_laws import CompiledLaws
from umo.generate.known_values import KnownValues
from umo.generate.known_watch import KnownWatch

pytestmark = [needs_a_compiler, pytest.mark.full]
Patch = pytest.MonkeyPatch


def _without(kind: Callable[[Any], bool]) -> Callable[[Patch], None]:
    """Nothing of this kind of owners is watched."""

    def plant(patch: Patch) -> None:
        begin = KnownWatch.__init__

        def fewer(self: KnownWatch, known: KnownValues, *given: Any) -> None:
            known.objects = {key: each for key, each in known.objects.items() if not kind(each.owner)}
            known.attributes = {key: each for key, each in known.attributes.items() if not kind(each[0])}
            begin(self, known, *given)

        patch.setattr(KnownWatch, "__init__", fewer)

    return plant


def _edited(owner: Any, text: str, wrong: str) -> Callable[[Patch], None]:
    """The function that has this text has another one."""

    def plant(patch: Patch) -> None:
        name = function_with(owner, text)
        patch.setattr(owner, name, changed(Edit(owner, name, (text, wrong))))

    return plant


def _never_shared(patch: Patch) -> None:
    patch.setattr(bound_fields, "is_shared", lambda *_: False)


def _not_elsewhere(patch: Patch) -> None:
    begin = KnownWatch.__init__
    patch.setattr(KnownWatch, "__init__", lambda self, known, changed, elsewhere=(): begin(self, known, changed))


def _only_lengths(patch: Patch) -> None:
    patch.setattr(known_values, "same_all", lambda before, now: len(before) == len(now))


def _all_to_the_object(patch: Patch) -> None:
    release = BoundFields.release

    def released(self: BoundFields) -> None:
        self._own = set(self.names)
        release(self)

    patch.setattr(BoundFields, "release", released)


def _over_what_was_put_there(patch: Patch) -> None:
    release = BoundFields.release

    def released(self: BoundFields) -> None:
        for name in self.names:
            vars(self.owner).pop(name, None)
        release(self)

    patch.setattr(BoundFields, "release", released)


def _not_taken(patch: Patch) -> None:
    patch.setattr(BoundFields, "take_given", lambda self: None)


STILL = c_uint64(7)


def _same_version(patch: Patch) -> None:
    patch.setattr(known_watch, "place_of_version", lambda names: addressof(STILL))


def _another_place(patch: Patch) -> None:
    patch.setattr(known_watch, "place_of", lambda owner, name, value: addressof(STILL))


FAULTS: dict[str, Callable[[Patch], None]] = {
    "attributes of objects": _without(lambda owner: not isinstance(owner, dict | FunctionType | CellType)),
    "names of modules": _without(lambda owner: isinstance(owner, dict)),
    "cells": _without(lambda owner: isinstance(owner, CellType)),
    "functions": _without(lambda owner: isinstance(owner, FunctionType)),
    "slots": _without(lambda owner: type(owner).__name__ == "Slotted"),
    "what is not there": _edited(
        KnownWatch,
        "(each.now, each.names | elsewhere)",
        "(each.now, {name: value for name, value in each.names.items() if value is not ABSENT} | elsewhere)",
    ),
    "containers": _edited(
        KnownValues, "if isinstance(value, np.ndarray) and not", "return\n    if isinstance(value, np.ndarray) and not"
    ),
    "elements": _only_lengths,
    "classes": _edited(
        KnownValues,
        "for each in kind.__mro__:\n        if _changes(each)",
        "return\n    for each in kind.__mro__:\n        if _changes(each)",
    ),
    "the class behind that of an object": _edited(bound_fields, "= _metaclass(kind)(", "= type("),
    "numbers that are put into an object": _not_elsewhere,
    "lists and arrays of others": _never_shared,
    "lists and arrays that are given": _not_taken,
    "before the laws": _edited(
        CompiledLaws,
        "while self._waiting:\n        self",
        "return True\n    while self._waiting:\n        self",
    ),
    "attributes of classes after release": _all_to_the_object,
    "attributes of objects after release": _over_what_was_put_there,
    "deleted attributes": _edited(BoundFields, 'self._refused(f"{path}.{name} is deleted")', "return"),
    "versions of dicts": _same_version,
    "places of references": _another_place,
}


def search() -> None:
    """Whether the ways of setting find a difference: AssertionError."""
    for way in WAYS:
        check([(way, AFTER, "client"), ("in what others have", AFTER + 2, "client")])


def test_without_a_fault_nothing_is_found() -> None:
    search()


@pytest.mark.parametrize("fault", FAULTS)
def test_a_watch_that_is_missing_is_found(fault: str, monkeypatch: pytest.MonkeyPatch) -> None:
    FAULTS[fault](monkeypatch)
    with pytest.raises(AssertionError):
        search()
