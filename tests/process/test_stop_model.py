"""The model of the stop: its promises and its mutants. That what the real processes do is a path of it is in
`test_schedules.py`."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from helpers.tiers import first
from tools.schedules import model
from tools.schedules.model import CHECKS, FAULTS, MUTANTS, PAIRS, Is, Model, State, broken, explore
from tools.schedules.planted import BY_NAME, PLANTED


@pytest.mark.parametrize(("kills", "stops", "holds"), first(3, FAULTS))
def test_in_every_state_of_the_model_its_promises_are_kept(kills: int, stops: int, holds: int) -> None:
    found = explore(Model(), kills, stops, holds)
    assert found.states > 3000
    assert found.wrong == "", found.path


@pytest.mark.parametrize("check", first(8, MUTANTS))
def test_the_model_without_a_check_breaks_a_promise(check: str) -> None:
    assert explore(Model(), plan=MUTANTS[check]).wrong == ""
    assert explore(Model(check), plan=MUTANTS[check]).wrong != ""


@pytest.mark.parametrize("pair", first(1, map(pytest.param, PAIRS)))
def test_of_two_checks_that_do_the_same_work_the_model_needs_one(pair: tuple[str, str]) -> None:
    for without in (pair[:1], pair[1:]):
        assert explore(Model(*without), plan=PAIRS[pair]).wrong == ""
    assert explore(Model(*pair), plan=PAIRS[pair]).wrong != ""


def test_each_check_of_the_model_has_a_mutant() -> None:
    assert {*re.findall(r'\bchecks\("(.+?)"\)', Path(model.__file__).read_text("utf-8"))} == CHECKS


def test_a_model_without_a_check_that_there_is_not_is_refused() -> None:
    with pytest.raises(ValueError, match="no such check: nonsense"):
        Model("nonsense")


def test_each_promise_of_the_model_can_be_broken() -> None:
    gone = State(guardian=State().control)
    assert broken(gone._replace(two=True), is_end=False)
    assert broken(gone._replace(outcome=1, slow=True), is_end=False)
    assert broken(gone._replace(fast=True), is_end=True)
    assert broken(gone._replace(outcome=2, recorded=0), is_end=True)
    assert broken(gone._replace(outcome=1), is_end=True)
    assert broken(State(), is_end=True) == "for ever: guardian"
    assert broken(gone._replace(outcome=2, standby=Is.STOPPED), is_end=True)
    assert broken(gone._replace(outcome=2, resetter=Is.ABLE, parent="standby"), is_end=False)
    assert not broken(gone._replace(outcome=1, recorded=0), is_end=True)


# Faults in copies of umo ----------------------------------------------------------------------------------


def test_each_fault_that_is_planted_has_its_place_in_umo() -> None:
    assert len(BY_NAME) == len(PLANTED) >= 60
    for each in PLANTED:
        assert each.place().is_file()
        assert {*each.also} <= {*BY_NAME}
