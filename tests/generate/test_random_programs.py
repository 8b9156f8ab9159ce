"""Programs at random: in generated C each is what it is in Python, or it is refused, with every input.

A failure names the command that plays its program again, and shows what is left of it when it is reduced.
"""

from __future__ import annotations

import ast
from collections import Counter

import pytest

from helpers.generating import needs_a_compiler
from helpers.hazards import HAZARDS
from helpers.programs import program
from helpers.reduced_programs import WRONG, play, play_texts, reduced, told
from helpers.side_by_side import Played
from helpers.tiers import first

BATCH = 50
SHARE = 0.4
"""Of the programs at least so many translate: what is refused is not compared."""


@needs_a_compiler
@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("batch", first(1, range(60)))
def test_programs_are_what_python_does_or_refused(batch: int) -> None:
    seeds = range(batch * BATCH, (batch + 1) * BATCH)
    found = dict(zip(seeds, play(seeds), strict=True))
    wrong = [seed for seed, each in found.items() if each.outcome in WRONG]
    assert not wrong, "\n".join(map(told, wrong[:3]))
    outcomes = Counter(each.outcome for each in found.values())
    assert outcomes["equal"] >= SHARE * BATCH, outcomes
    unforeseen = [reason for each in found.values() for reason in each.reasons if "cannot be translated" in reason]
    assert not unforeseen
    assert all(reason.startswith("program_") for each in found.values() for reason in each.reasons)


def test_a_seed_gives_the_same_program_and_every_hazard_has_its_turn() -> None:
    texts = [program(seed) for seed in range(2 * len(HAZARDS))]
    assert texts == [program(seed) for seed in range(2 * len(HAZARDS))]
    assert len({*texts}) == len(texts)
    for text in texts:
        ast.parse(text)


@needs_a_compiler
@pytest.mark.slow
@pytest.mark.full
def test_a_program_that_is_different_is_found_and_reduced(monkeypatch: pytest.MonkeyPatch) -> None:
    """As one would be where the translator took `<` for `<=`."""
    from umo.generate.lower import lowered_expressions

    monkeypatch.setitem(lowered_expressions.SIGNS, ast.Lt, "<=")
    body = "self.c = 1\nself.yes = self.n < 2"
    monkeypatch.setattr("helpers.reduced_programs.program", lambda seed: _with_body(program(seed), body))
    text, found = reduced(0)
    assert found.outcome == "different"
    assert text.splitlines() == ["self.yes = self.n < 2"]


@pytest.mark.full
@needs_a_compiler
def test_what_the_compiler_does_not_take_is_told_alone() -> None:
    """One program of a batch that does not compile does not hide the others."""
    good, bad = (_with_body(program(0), body) for body in ("self.s = self.u", "self.s = self.v"))
    outcomes = [each.outcome for each in _with_broken(good, bad)]
    assert outcomes == ["equal", "not compiled"]


def _with_broken(good: str, bad: str) -> list[Played]:
    from umo.generate.emit.function_text import FunctionText

    kept = FunctionText.put

    def put(self: FunctionText, text: str) -> None:
        kept(self, text.replace(".v;", ".v @;"))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(FunctionText, "put", put)
        return play_texts([good, bad], [0, 1], trials=2)


def _with_body(text: str, body: str) -> str:
    head = text.partition("    def control(self)")[0]
    return f"{head}    def control(self) -> None:\n" + "".join(f"        {each}\n" for each in body.splitlines())
