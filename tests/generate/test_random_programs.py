"""Programs at random: in C each is what it is in Python, or it is refused, with every input and whatever the host sets.

A failure names the command that plays its program again, and reduces it.
"""

from __future__ import annotations

import ast
import builtins
from collections import Counter

import pytest

from helpers.boards import need
from helpers.controllers import ARM
from helpers.generating import needs_a_compiler
from helpers.peers.text_devices import CannotRun
from helpers.tiers import first
from tools.fuzz.batches import QUICK, Batch, batches, play
from tools.fuzz.hazards import HAZARDS
from tools.fuzz.mutants import PLANTED, Planted
from tools.fuzz.program import Program, program
from tools.fuzz.shrink import shrunk
from tools.fuzz.verdict import Verdict

SIZE = 12
"""Programs of each kind: with hazards, and without."""


@needs_a_compiler
@pytest.mark.slow
@pytest.mark.parametrize("batch", first(1, range(80)))
@pytest.mark.parametrize("target", ["host", "compiled"])
def test_programs_are_what_python_does_or_refused(target: str, batch: int) -> None:
    assert _outcomes(target, batch)["equal"] >= SIZE


@needs_a_compiler
@pytest.mark.slow
@pytest.mark.full
@pytest.mark.parametrize("target", ["line", "board"])
def test_on_a_controller_they_are_what_python_does_or_refused(target: str) -> None:
    try:
        need(*(ARM if target == "board" else ()))
    except CannotRun as error:
        pytest.skip(str(error))
    assert _outcomes(target, 0)["equal"] >= SIZE // 2


def _outcomes(target: str, batch: int) -> Counter[str]:
    outcomes: Counter[str] = Counter()
    for some in batches(target, range(batch * 2 * SIZE, (batch + 1) * 2 * SIZE), QUICK, SIZE):
        verdicts = play(some)
        wrong = [(each, one) for each, one in zip(some.programs, verdicts, strict=True) if one.is_wrong]
        assert not wrong, "\n".join(f"{some.line(each.seed)}: {one.outcome}: {one.told}" for each, one in wrong)
        outcomes.update(each.outcome for each in verdicts)
    return outcomes


def test_a_seed_gives_the_same_program_and_every_hazard_has_its_turn() -> None:
    programs = [program(seed) for seed in range(2 * len(HAZARDS))]
    assert programs == [program(seed) for seed in range(2 * len(HAZARDS))]
    assert len({each.text for each in programs}) == len(programs)
    assert {each.hazard for each in programs} == {"", *(each.__name__ for each in HAZARDS)}
    for each in programs:
        ast.parse(each.text)


@pytest.mark.parametrize("planted", PLANTED, ids=lambda planted: planted.what)
def test_each_planted_fault_has_its_place(planted: Planted) -> None:
    assert planted.place().is_file()


IN_PYTHON = [each for each in PLANTED if each.file.endswith(".py")]


@pytest.mark.parametrize("planted", IN_PYTHON, ids=lambda planted: planted.what)
def test_a_planted_fault_has_no_name_without_a_value(planted: Planted) -> None:
    """Any program would find that."""
    text = planted.place().read_text("utf-8")
    assert _names(text.replace(planted.text, planted.wrong)) <= _names(text) | {*dir(builtins)}


def _names(text: str) -> set[str]:
    """What a module reads, assigns and imports."""
    nodes = [*ast.walk(ast.parse(text))]
    imported = {each.asname or each.name for each in nodes if isinstance(each, ast.alias)}
    return imported | {each.id for each in nodes if isinstance(each, ast.Name)}


@needs_a_compiler
@pytest.mark.slow
@pytest.mark.full
@pytest.mark.parametrize("target", ["host", "compiled"])
def test_a_program_that_is_different_is_found_and_reduced(monkeypatch: pytest.MonkeyPatch, target: str) -> None:
    """As one would be where the translator took `<` for `<=`."""
    from umo.generate.lower import lowered_expressions

    monkeypatch.setitem(lowered_expressions.SIGNS, ast.Lt, "<=")
    one = _with_body(program(0), "self.c = 1\nif self.on:\n    self.d = 5\nself.yes = self.n < 2")
    least, verdict = shrunk(Batch(target, QUICK, [one]))
    assert verdict.outcome == "different"
    assert _body(least) == "self.yes = self.n < 2"


def test_what_is_refused_is_reduced_to_the_same_refusal() -> None:
    """Not to another one, and with values of the same classes."""
    body = "if self.on:\n    self.pair = Pair(Part.weight(self.u * 2.0), self.maybe)\nself.two = (self.c, self.maybe)"
    least, verdict = shrunk(Batch("host", QUICK, [_with_body(program(0), f"self.d = 1\n{body}")]))
    assert verdict.kind == "refused without a hazard: a value that may be None stands in a tuple"
    assert _body(least) == "self.pair = Pair(1.0, self.maybe)"


@pytest.mark.parametrize(
    ("outcome", "told", "kind"),
    [
        ("different", "period 3: parts.7.part.gain: Python 2.0, C 3.0", "different: part.gain"),
        ("different", "period 0: Python raises None, C IndexError", "different: Python raises None, C IndexError"),
        ("different", "period 12: in fault: Python True, C None", "different: in fault"),
        ("refused", "self.s = x: it is not a number", "refused: it is not a number"),
        ("crashed", "it hangs", "crashed: it hangs"),
    ],
)
def test_the_kind_of_a_verdict_has_no_values(outcome: str, told: str, kind: str) -> None:
    assert Verdict(outcome, told).kind == kind


@needs_a_compiler
@pytest.mark.full
def test_what_the_compiler_does_not_take_is_told_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """One program of a batch that does not compile does not hide the others."""
    from umo.generate.emit.function_text import FunctionText

    kept = FunctionText.put
    monkeypatch.setattr(FunctionText, "put", lambda self, text: kept(self, text.replace(".v;", ".v @;")))
    some = [_with_body(program(seed), f"self.s = self.{name}") for seed, name in ((0, "u"), (2, "v"))]
    assert [each.outcome for each in play(Batch("host", QUICK, some))] == ["equal", "not compiled"]


@needs_a_compiler
@pytest.mark.full
def test_what_crashes_is_told_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    from umo.generate.emit.function_text import FunctionText

    kept = FunctionText.put
    crash = "*(volatile int *)0 = 0; "
    monkeypatch.setattr(FunctionText, "put", lambda self, text: kept(self, crash * text.endswith(".v;") + text))
    some = [_with_body(program(seed), f"self.s = self.{name}") for seed, name in ((0, "u"), (2, "v"))]
    assert [each.outcome for each in play(Batch("host", QUICK, some))] == ["equal", "crashed"]


@needs_a_compiler
@pytest.mark.full
def test_what_hangs_is_told_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tools.fuzz.batches.TIMEOUT", 4)
    loop = "while self.dt > 0.0:\n    self.s = self.u"
    some = [_with_body(program(0), "self.s = self.u"), _with_body(program(2), loop)]
    assert [each.kind for each in play(Batch("host", QUICK, some))] == ["equal: ", "crashed: it hangs"]


def _with_body(one: Program, body: str) -> Program:
    """Its control code is this."""
    head, _, rest = one.text.partition("    def control(self) -> None:\n")
    lines = "".join(f"        {line}\n" for line in body.splitlines())
    return one.changed(
        f"{head}    def control(self) -> None:\n{lines}{rest[rest.index(chr(10) * 2 + 'def part') :]}", 0
    )


def _body(one: Program) -> str:
    functions = (each for each in ast.walk(ast.parse(one.text)) if isinstance(each, ast.FunctionDef))
    return "\n".join(map(ast.unparse, next(each for each in functions if each.name == "control").body))
