"""The cases of a test that `make test` runs; `make test-all` runs all of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from itertools import product
from typing import Any

import pytest


def first(count: int, cases: Iterable[Any]) -> list[Any]:
    """The first `count` cases run always, the others are marked `full`."""
    return [case if number < count else _full(case) for number, case in enumerate(cases)]


def some(chosen: Callable[[Any], bool], cases: Iterable[Any]) -> list[Any]:
    """The chosen cases run always, the others are marked `full`."""
    return [case if chosen(case) else _full(case) for case in cases]


def each_value(*axes: Sequence[Any]) -> list[Any]:
    """All combinations of the axes. As many as it takes for each value of each axis run always: its number is that of
    the longest axis; the others are marked `full`."""
    shown = {tuple(turn % len(axis) for axis in axes) for turn in range(max(map(len, axes)))}
    return [
        case if numbers in shown else _full(case)
        for numbers, case in zip(product(*(range(len(axis)) for axis in axes)), product(*axes), strict=True)
    ]


def _full(case: Any) -> Any:
    if hasattr(case, "marks"):  # made by pytest.param
        return pytest.param(*case.values, marks=[*case.marks, pytest.mark.full], id=case.id)
    return pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=pytest.mark.full)
