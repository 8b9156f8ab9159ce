"""Sequences that pile up: a sequence is started again and again while the earlier ones still run. One event reports
this."""

from __future__ import annotations

import sys
from collections.abc import Collection
from enum import Enum
from traceback import walk_stack
from types import CodeType
from typing import Any

from umo.cycle.coroutines import code_of, given_to
from umo.cycle.sequences import Task
from umo.text import place_among

FEW = 16
"""The number of sequences of one function for one object at which there is an event. Only sequences that were started
in different periods are counted."""
MANY = 1000
"""The number of sequences of one function, whatever its arguments, at which there is an event."""


class PilingUp:
    """The detection of sequences that accumulate on one machine. The time of a check is proportional to the number of
    sequences of a part, so a check is made only when this number has grown by a quarter."""

    def __init__(self) -> None:
        self._next: dict[tuple[int, CodeType], int] = {}
        """The number of sequences of a part at which the next check is made."""
        self._told: set[CodeType] = set()

    def look(self, task: Task, beside: Collection[Task]) -> str:
        """Return the text of the event for a sequence that was just started, or "" if there is no event. `beside`: all
        sequences of the same part."""
        if (code := code_of(task.sequence)) is None or code in self._told:
            return ""
        key = id(task.part), code
        if len(beside) < self._next.get(key, FEW):
            return ""
        alike = [each for each in beside if code_of(each.sequence) is code]
        given = _given(task)
        same = [each for each in alike if _given(each) == given]
        self._next[key] = len(beside) + max(FEW - _periods(same), len(beside) // 4)
        found = same if _periods(same) >= FEW else alike if _periods(alike) >= MANY else []
        if not found:
            return ""
        self._told.add(code)
        place = place_among((at.f_code.co_filename, line, at.f_code.co_name) for at, line in _stack())
        return (
            f"{len(found):,} of {task.name} run at the same time, and more are started ({place}): start the next one "
            f"when `task.done` of the last one is true, or cancel the last one"
        )


def _stack() -> list[tuple[Any, int]]:
    """Return the frames of the code that starts the sequence, the outermost first."""
    return list(walk_stack(sys._getframe(2)))[::-1]


def _periods(tasks: list[Task]) -> int:
    return len({each.started_in for each in tasks})


def _given(task: Task) -> list[Any]:
    """Return the arguments that distinguish one call of a function from another: objects, integers and texts, but not
    floats, which may be readings."""
    given = (each for each in given_to(task.sequence).values() if not isinstance(each, float))
    return [each if isinstance(each, int | str | Enum) else id(each) for each in given]
