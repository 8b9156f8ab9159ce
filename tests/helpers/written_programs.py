"""Control programs that are written down, each as a class: how they are given, and what is expected of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest

from helpers.generating import needs_a_compiler
from helpers.side_by_side import Played, Rig, played

GIVEN = [
    {"x": x, "u": u, "n": n, "maybe": maybe}
    for x, u, n, maybe in [
        (3, 2.0, 1, None), (0, 0.0, 0, 0.0), (-2, -0.0, -3, 1.5), (7, 2.5, 2, None), (1, math.nan, 5, math.nan),
        (2, math.inf, 2**31 - 1, -1.0), (5, -7.25, -(2**31) + 1, 3.0), (4, 1e300, 4, 2.0),
    ]
]  # fmt: skip
"""Inputs of a period: NaN, infinities and ends of 32 bits among them."""
TRIALS = [*[[one] for one in GIVEN], GIVEN[:4], GIVEN[3::-1], [GIVEN[0], GIVEN[3], GIVEN[6], GIVEN[7]]]


class Program:
    """`u`, `n` and `maybe` are given in each period."""

    maybe: float | None

    def __init__(self, rig: Rig) -> None:
        self.x, self.a, self.b, self.fan = rig.x, rig.a, rig.b, rig.fan
        self.u, self.n, self.maybe = 0.0, 0, None
        self.k, self.c, self.yes = 0.0, 0, False
        self.begin()

    def begin(self) -> None:
        """Attributes of its own."""

    def control(self) -> None:
        raise NotImplementedError


class Cases:
    """The programs of a module, each of which is equal to Python in C."""

    def __init__(self, trials: Sequence[Sequence[Mapping[str, Any]]] = TRIALS, limits: float = 0.1) -> None:
        """`limits`: the share of periods that may end in C because a whole number left 32 bits."""
        self.equal: list[type[Program]] = []
        self._trials, self._limits = trials, limits

    def is_equal(self, kind: type[Program]) -> type[Program]:
        self.equal.append(kind)
        return kind

    def played(self, folder: Path) -> dict[Any, Played]:
        return dict(zip(self.equal, played(self.equal, lambda _: self._trials, folder), strict=True))

    def test(self) -> Callable[..., None]:
        """The test of the module, which has these as `CASES`: each program is what Python does."""

        @needs_a_compiler
        @pytest.mark.parametrize("kind", self.equal)
        def test(kind: Any, results: dict[Any, Played]) -> None:
            found = results[kind]
            assert (found.outcome, found.reasons, found.difference) == ("equal", (), None)
            assert found.limits <= self._limits * found.periods, found

        return test
