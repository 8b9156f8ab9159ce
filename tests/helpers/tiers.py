"""The cases of a test that `make test` runs; `make test-all` runs all of them."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

QUICK = "not full"
"""The expression of marks (`pytest -m`) of `make test`."""
_is_quick = False


def choose(marks: str) -> None:
    """Before the tests are collected: what they are selected by. `make test` makes no other cases than its own."""
    global _is_quick
    _is_quick = marks == QUICK


class LeftOut(pytest.Module):
    """A module without a test that is to run: it is not imported."""

    def collect(self) -> list[pytest.Item | pytest.Collector]:
        return []


_FULL_MODULE = re.compile(r"^pytestmark = (\[[^]]*)?pytest\.mark\.full\b", re.M)


def has_marks(thing: Any, name: str) -> bool:
    """Whether a test function or class, or a case of one, has this mark."""
    marks = getattr(thing, "pytestmark", None) or getattr(thing, "marks", None)
    return isinstance(marks, list | tuple) and any(mark.name == name for mark in marks)


def is_left_out(file: Path) -> bool:
    """`make test` does not import a module that marks all of its tests `full`."""
    return _is_quick and _FULL_MODULE.search(file.read_text("utf-8")) is not None


def has_no_smoke(file: Path) -> bool:
    """Nor one that has none of the tests of faces that it runs."""
    return _is_quick and "mark.smoke" not in file.read_text("utf-8")


def is_test_left_out(test: Any) -> bool:
    """`make test` makes no cases of a function or class that is marked `full`: there are thousands."""
    return _is_quick and has_marks(test, "full")


def first(count: int, cases: Iterable[Any]) -> list[Any]:
    """The first `count` cases run always, the others are marked `full`."""
    return _cases([(case, number < count) for number, case in enumerate(cases)])


def some(chosen: Callable[[Any], bool], cases: Iterable[Any]) -> list[Any]:
    """The chosen cases run always, the others are marked `full`."""
    return _cases([(case, chosen(case)) for case in cases])


def each_value(*axes: Sequence[Any]) -> list[Any]:
    """All combinations of the axes. As many as it takes for each value of each axis run always: its number is that of
    the longest axis; the others are marked `full`."""
    shown = {tuple(turn % len(axis) for axis in axes) for turn in range(max(map(len, axes)))}
    places = product(*(range(len(axis)) for axis in axes))
    return _cases([(case, place in shown) for place, case in zip(places, product(*axes), strict=True)])


def budget(quick: int, full: int) -> settings:
    """So many examples of a property in `make test`, and so many in `make test-all`."""
    return settings(max_examples=quick if _is_quick else full)


def named(names: Sequence[str], cases: Sequence[Any]) -> list[Any]:
    """Each case with the name that it has among the tests."""
    values = (case if isinstance(case, tuple) else (case,) for case in cases)
    return [pytest.param(*each, id=name) for name, each in zip(names, values, strict=True)]


def _cases(cases: list[tuple[Any, bool]]) -> list[Any]:
    if _is_quick and any(always for _, always in cases):
        return [case for case, always in cases if always]
    return [case if always else _full(case) for case, always in cases]


def _full(case: Any) -> Any:
    if hasattr(case, "marks"):  # made by pytest.param
        return pytest.param(*case.values, marks=[*case.marks, pytest.mark.full], id=case.id)
    return pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=pytest.mark.full)
