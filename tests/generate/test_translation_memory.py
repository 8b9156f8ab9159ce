"""Whom it concerns that something is learnt: who has looked it up before, and was told something else."""

from __future__ import annotations

import gc
import weakref
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from helpers.side_by_side import HOST, connected_rig
from umo.generate.c_types import BOOL, INT, REAL
from umo.generate.lower import passes
from umo.generate.lower.translation_memory import Learner, TranslationMemory
from umo.generate.translator import translate


class Counting:
    """What control code learns of its own attributes."""

    def __init__(self) -> None:
        self.count, self.total, self.mode = 0, 0.0, "idle"
        self.row = np.array([1.0, 2.0])

    def sure(self) -> None:
        """Each attribute has from the start the type that it is assigned."""
        self.count += 1
        if self.count > 3:
            self.total += 0.5

    def of_an_array(self) -> None:
        self.total = self.row[0] + self.row[1]

    def as_state(self) -> None:
        if self.mode == "idle":
            self.count = 0
        self.mode = "busy" if self.count else "idle"


def learner(memory: TranslationMemory) -> Learner:
    """Somebody new who looks things up."""
    memory.current.learner = new = Learner()
    return new


def test_what_was_looked_up_and_has_changed_makes_stale() -> None:
    memory = TranslationMemory()
    first = learner(memory)
    assert memory.locals.get("x") is None
    second = learner(memory)
    memory.learn(memory.locals, "x", INT, lambda: None)
    assert (first.is_stale, second.is_stale) == (True, False)


def test_what_is_learnt_twice_with_another_type_was_wrong_the_first_time() -> None:
    memory = TranslationMemory()
    one = learner(memory)
    memory.learn(memory.locals, "x", INT, lambda: None)
    assert not one.is_stale
    memory.learn(memory.locals, "x", REAL, lambda: None)
    assert one.is_stale


def test_what_changes_without_changing_the_answer_makes_nobody_stale() -> None:
    memory = TranslationMemory()
    one = learner(memory)
    assert memory.fields.look("x", lambda of: of == BOOL) is False
    memory.fields.put("x", INT)
    assert not one.is_stale
    memory.fields.put("x", BOOL)
    assert one.is_stale


def test_a_caller_is_stale_with_what_it_calls() -> None:
    memory = TranslationMemory()
    called = learner(memory)
    assert "x" not in memory.assigned
    caller, later = Learner(), Learner()
    called.used_by(caller)
    memory.assigned.add("x")
    called.used_by(later)
    assert caller.is_stale and later.is_stale


def entries_of(steps: list[Callable[[], Any]], monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The steps that are lowered, in order."""
    found, lower = [], passes._entry

    def noted(world: Any, function: Any, is_condition: bool) -> Any:
        found.append(function.__name__)
        return lower(world, function, is_condition)

    monkeypatch.setattr(passes, "_entry", noted)
    with connected_rig() as (machine, _):
        assert translate(machine, [], steps, HOST).problems == []
    return found


def test_steps_whose_types_are_right_from_the_start_are_lowered_once(monkeypatch: pytest.MonkeyPatch) -> None:
    program = Counting()
    assert entries_of([program.sure, program.sure], monkeypatch) == ["sure", "sure"]


def test_only_the_step_that_was_wrong_learns_before_the_next_pass(monkeypatch: pytest.MonkeyPatch) -> None:
    text, number = Counting(), Counting()
    found = entries_of([number.sure, text.as_state], monkeypatch)
    assert found[:2] == ["sure", "as_state"] == found[-2:]
    assert {*found[2:-2]} == {"as_state"}


def test_a_translation_that_is_over_keeps_no_array_of_the_machine() -> None:
    program = Counting()
    row = weakref.ref(program.row)
    gc.disable()
    try:
        with connected_rig() as (machine, _):
            translate(machine, [], [program.of_an_array, program.as_state], HOST)
        del program
        assert row() is None
    finally:
        gc.enable()
