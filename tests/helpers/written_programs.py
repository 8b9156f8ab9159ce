"""Control programs that are written down, each as a class: how they are given, and what is expected of them."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

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
    """The programs of a module: those that are equal to Python in C, and those that are refused."""

    def __init__(self) -> None:
        self.equal: list[type[Program]] = []
        self.refused: dict[type[Program], str] = {}
        """With a part of the reason."""

    def is_equal(self, kind: type[Program]) -> type[Program]:
        self.equal.append(kind)
        return kind

    def is_refused(self, reason: str) -> Callable[[type[Program]], type[Program]]:
        def kept(kind: type[Program]) -> type[Program]:
            self.refused[kind] = reason
            return kind

        return kept

    def played(self, folder: Path) -> dict[Any, Played]:
        kinds = [*self.equal, *self.refused]
        return dict(zip(kinds, played(kinds, lambda _: TRIALS, folder), strict=True))


def check_equal(found: Played) -> None:
    assert (found.outcome, found.reasons, found.difference) == ("equal", (), None)
    assert found.limits <= 1, "C left 32 bits in more periods than the one in which Python does"


def check_refused(found: Played, reason: str, file: str) -> None:
    """It is refused for this reason, and each reason names the line."""
    assert found.outcome == "refused", found.difference
    assert any(reason in each for each in found.reasons), found.reasons
    assert all(each.startswith(f"generate/{Path(file).name}:") for each in found.reasons), found.reasons
