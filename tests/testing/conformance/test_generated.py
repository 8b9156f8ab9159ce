"""Generated broken drivers: 300 by one seed, of nine kinds, of eight correct drivers. The kit finds 95 % of those that
break a promise, each by a rule that is right for its kind."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from subprocess import run

import pytest

from conformance.generated import (
    ALL_KINDS,
    DRIVERS,
    KINDS,
    LATER_KINDS,
    RIGHT_RULES,
    Correct,
    Generated,
    equivalent,
    generated,
    judged,
    later,
    rightly_caught,
)
from umo.testing.conformance import all_rules, conform, runner

SEED, COUNT = 1, 300
TOGETHER = 6
"""Trials at a time."""
ENVIRONMENT = os.environ | {"PYTHONPATH": os.pathsep.join(map(str, Path(__file__).parents[1:3]))}
MOST_MISSED = 0.05
QUICK = (7, 16, 25, 42, 52)
"""Mutants that a quick rule finds at once, of five kinds."""


@pytest.fixture(autouse=True)
def what_hangs_is_found_soon(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runner, "HANG", 1.0)


def test_each_kind_has_mutants_and_each_can_be_made() -> None:
    mutants = generated(SEED, COUNT)
    assert len(mutants) == COUNT
    assert {each.kind for each in mutants} == KINDS.keys()
    assert {each.correct for each in mutants} == {*DRIVERS}
    assert all(each.driver() for each in mutants[::10])


def test_each_kind_has_rules_that_are_right_to_catch_it() -> None:
    assert RIGHT_RULES.keys() == ALL_KINDS.keys()
    assert set().union(*RIGHT_RULES.values()) <= {rule.id for rule in all_rules()}


def test_each_argument_is_that_of_a_mutant() -> None:
    assert equivalent().keys() <= {each.name for each in (*generated(SEED, COUNT), *later())}


@pytest.mark.parametrize("correct", DRIVERS, ids=lambda each: each.name)
def test_the_driver_without_a_change_is_made_anew_and_passes(correct: Correct) -> None:
    with correct.subject(correct.unchanged()) as subject:
        certificate = conform(subject, only=["answers"])
    assert certificate.passed, str(certificate)


@pytest.mark.parametrize("number", QUICK)
def test_some_are_found_at_once(number: int) -> None:
    mutant = generated(SEED, COUNT)[number]
    assert rightly_caught(mutant, certificate := judged(mutant)), f"{mutant.name}: {certificate!r}"


def missed(tried: Sequence[Generated]) -> list[str]:
    """The names of those that the kit does not find by a right rule. Each is tried in a process of its own: what a
    driver leaves open is nobody else's, and a trial waits most of its time."""
    with ThreadPoolExecutor(TOGETHER) as threads:
        found = threads.map(lambda each: run([sys.executable, __file__, each.name], env=ENVIRONMENT).returncode, tried)
        return [each.name for each, status in zip(tried, found, strict=True) if status]


@pytest.mark.full
@pytest.mark.timeout(7200)
def test_the_mutants_are_found() -> None:
    tried = [each for each in generated(SEED, COUNT) if each.name not in equivalent()]
    left = missed(tried)
    assert len(left) <= MOST_MISSED * len(tried), "\n".join([f"{len(left)} of {len(tried)}", *left])


def test_each_later_kind_has_mutants_and_each_can_be_made() -> None:
    assert {each.kind for each in later()} == LATER_KINDS.keys()
    assert all(each.driver() for each in later())


@pytest.mark.full
@pytest.mark.timeout(7200)
def test_the_mutants_of_later_kinds_are_found() -> None:
    tried = [each for each in later() if each.name not in equivalent()]
    left = missed(tried)
    assert len(left) <= MOST_MISSED * len(tried), "\n".join([f"{len(left)} of {len(tried)}", *left])


if __name__ == "__main__":
    (this,) = (each for each in (*generated(SEED, COUNT), *later()) if each.name == sys.argv[1])
    runner.HANG = 1.0
    sys.exit(not rightly_caught(this, judged(this)))
