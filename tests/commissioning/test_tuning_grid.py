"""Tuning on plants whose truth is known: what is told is stable, with margins that python-control confirms."""

from __future__ import annotations

import pytest

from helpers.tiers import first
from helpers.tuning_grid import Tally, verdict
from helpers.tuning_plants import DEVELOP, HELD_OUT, plants

pytest.importorskip("scipy")

TYPICAL = [
    ("without control is unstable", 3),
    ("told", 0),
    ("not linear", 28),
    ("without control oscillates", 11),
    ("told", 4),
]
"""Plants of the part `develop`, and what is said of them."""


@pytest.mark.parametrize(("said", "number"), first(1, TYPICAL))
def test_a_plant_is_tuned_with_true_margins_or_refused_with_its_reason(said: str, number: int) -> None:
    found = verdict(plants(DEVELOP, number + 1)[number])
    if said != "told":
        assert said in found.refused
        return
    assert found.told, found.refused
    assert [each.name for each in found.sets] == ["present", "cautious", "balanced", "quick"]
    assert all(each.is_true for each in found.sets), found.sets


@pytest.mark.full
@pytest.mark.slow
@pytest.mark.parametrize("part", [DEVELOP, HELD_OUT])
def test_of_a_grid_of_plants_no_set_that_is_told_is_unstable_and_margins_are_true(part: str) -> None:
    found = Tally(list(map(verdict, plants(part))))
    assert not found.unstable
    assert found.meets_its_aims, "\n".join(found.lines)
    told = {each.plant.family for each in found.verdicts if each.told}
    assert not told & {"unstable", "double integrator"}
