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


def _no_absent(patch: Patch) -> None:
    changes = KnownWatch._renew

    def renew(self: KnownWatch) -> None:
        for each in self._known.objects.values():
            each.names = {name: value for name, value in each.names.items() if value is not known_values.ABSENT}
        changes(self)

    patch.setattr(KnownWatch, "_renew", renew)


def _no_contents(patch: Patch) -> None:
    patch.setattr(KnownValues, "_content", lambda *_: None)


def _no_classes(patch: Patch) -> None:
    patch.setattr(KnownValues, "_class", lambda *_: None)


def _never_shared(patch: Patch) -> None:
    patch.setattr(bound_fields, "is_shared", lambda *_: False)


def _not_elsewhere(patch: Patch) -> None:
    begin = KnownWatch.__init__
    patch.setattr(KnownWatch, "__init__", lambda self, known, changed, elsewhere=(): begin(self, known, changed))


def _only_lengths(patch: Patch) -> None:
    patch.setattr(known_values, "same_all", lambda before, now: len(before) == len(now))


def _no_metaclass(patch: Patch) -> None:
    patch.setattr(bound_fields, "_metaclass", type)


def _not_before_the_laws(patch: Patch) -> None:
    patch.setattr(CompiledLaws, "_look", lambda self: True)


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


def _not_deleted(patch: Patch) -> None:
    patch.setattr(BoundFields, "_deleter", lambda self: lambda owner, name: None)


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
    "what is not there": _no_absent,
    "containers": _no_contents,
    "elements": _only_lengths,
    "classes": _no_classes,
    "the class behind that of an object": _no_metaclass,
    "numbers that are put into an object": _not_elsewhere,
    "lists and arrays of others": _never_shared,
    "lists and arrays that are given": _not_taken,
    "before the laws": _not_before_the_laws,
    "attributes of classes after release": _all_to_the_object,
    "attributes of objects after release": _over_what_was_put_there,
    "deleted attributes": _not_deleted,
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
