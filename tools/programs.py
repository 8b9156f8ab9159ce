"""Control programs at random: is what umo generates from them equal to Python, or refused?

    python -m tools.programs run 2000            the programs 0 to 1,999: how many are equal, refused, different
    python -m tools.programs run 500 --from 7000
    python -m tools.programs replay 1234         one program, reduced if it is different
    python -m tools.programs plant 200           faults planted in the translator: which are found within 200 programs

A planted fault takes a check or a refusal out of a copy of the translator, or changes an operator. How the programs are
made is in tests/helpers/programs.py, how they are played in tests/helpers/side_by_side.py.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import warnings
from collections import Counter
from pathlib import Path
from typing import NamedTuple

HERE = Path(__file__).parents[1]
sys.path.insert(0, str(HERE / "tests"))
BATCH = 50
"""Programs in one library."""
SHOWN = 12
"""Reasons of refusals that are shown."""
PLANT_TIMEOUT = 1200.0
"""Time in s for the programs of one planted fault."""


class Planted(NamedTuple):
    """A fault: this text of a file of the translator becomes another one."""

    what: str
    file: str
    text: str
    wrong: str


PLANTED = (
    Planted("a real number is cut to a whole one", "lower/lowered_values.py",
            "if not _widens(code.type, of):", "if False:"),
    Planted("the sign of a whole or real zero", "lower/lowered_expressions.py",
            "if any(map(_is_mixed, terms)) and not any(map(_is_float, terms)):", "if False:"),
    Planted("a state that is None is equal to the first", "lower/lowered_conditions.py",
            'test = Operator("&&", there[0], test)', "pass"),
    Planted("an array with several names is changed", "lower/lowered_aliases.py",
            "if isinstance(place, Elementwise) or self.shares(place.value):", "if False:"),
    Planted("one list at two places is not seen", "lower/translation_memory.py",
            "if each != place and (one is value or _overlap(one, value)):", "if False:"),
    Planted("names after a loop of no turns", "lower/lowered_loops.py",
            "self._end([*ways, *left])", "self.f.flow.known.clear()"),
    Planted("what is not None is still so after a call", "lower/function_builder.py",
            "self.flow.forget_fields()", "pass"),
    Planted("None that is assigned counts as a number", "lower/lowered_assignments.py",
            "return not isinstance(term.type, OptionalType)", "return True"),
    Planted("the class of a number that may be real", "lower/lowered_builtins.py",
            "if len(answers) != 1 or len(wanted) != len(terms):", "if False:"),
    Planted("the counter of a class", "lower/lowered_assignments.py",
            "if reason := refused_store(owner, name) or _odd_attribute(owner, name):",
            'if reason := "":'),
    Planted("a place that is found twice", "lower/lowered_assignments.py",
            "index = self.f.values.settled(index)\n        if isinstance(index, Code) and index.type.name",
            "if isinstance(index, Code) and index.type.name"),
    Planted("a variable of a generator that leaks", "lower/lowered_sequences.py",
            'node = _with_own_names(node, f" {node.lineno} {node.col_offset}")', "pass"),
    Planted("a loop in its other direction", "lower/lowered_sequences.py",
            "find=lambda n: turns.find(last - n)", "find=turns.find"),
    Planted("a filter of a generator that is not asked", "lower/lowered_builtins.py",
            "self._leave_unless(self.f.values.truth(self.f.term(test), test), on)",
            "self.f.values.truth(self.f.term(test), test)"),
    Planted("the logarithm of NaN", "lower/lowered_builtins.py",
            'Operator("<=", kept, ZERO)', 'negated(Operator(">", kept, ZERO))'),
    Planted("an error of 32 bits is caught", "lower/code_world.py",
            "return not issubclass(kind, ControllerLimit) and (", "return ("),
    Planted("the order of arguments", "lower/function_builder.py",
            "if any(map(changes, rest)):  # what was computed before may change: it is kept under a name",
            "if False:"),
    Planted("less becomes less or equal", "lower/lowered_expressions.py", 'ast.Lt: "<"', 'ast.Lt: "<="'),
    Planted("the remainder has the sign of C", "lower/lowered_expressions.py",
            "return Code(REAL, Runtime(f\"umo_{'mod' if",
            "return Code(REAL, Runtime(f\"umo_{'fmod' if"),
    Planted("a division by zero goes on", "lower/lowered_expressions.py",
            'self.f.raises(ZeroDivisionError, node, Operator("==", named, ZERO))', "pass"),
    Planted("an index beyond the end", "lower/lowered_expressions.py",
            'self.f.raises(IndexError, node, Operator("||", below, above))', "pass"),
    Planted("`finally` is left out when it returns", "emit/function_text.py",
            "around = [way for way in self.ways if way.returning]", "around: list[FaultWay] = []"),
    Planted("`and` computes both", "lower/lowered_conditions.py",
            "self.f.add(If(test if both else negated(test), tuple(body)))",
            "self.f.add(If(TRUE, tuple(body)))"),
    Planted("what a call changes is not seen", "check/form_effects.py",
            "return isinstance(node, CallStatement)", "return False"),
    Planted("an assignment that is read is left out", "check/shape.py",
            "new = {source for each in new for source in sources.get(each, ())} - found", "new = set()"),
)  # fmt: skip


def main() -> int:
    warnings.simplefilter("ignore")  # numpy's, of what programs divide by zero
    parser = argparse.ArgumentParser(
        "python -m tools.programs", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=["run", "replay", "plant"])
    parser.add_argument("number", type=int)
    parser.add_argument("--from", type=int, default=0, dest="first")
    parser.add_argument("--until-wrong", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.what == "replay":
        return replay(given.number)
    if given.what == "plant":
        return plant(given.number)
    return run(range(given.first, given.first + given.number), given.until_wrong)


def run(seeds: range, until_wrong: bool = False) -> int:
    """The programs of these seeds: the number of each outcome; a line for each that is wrong."""
    from helpers.reduced_programs import WRONG, play

    outcomes: Counter[str] = Counter()
    reasons: Counter[str] = Counter()
    sums: Counter[str] = Counter()
    for at in range(0, len(seeds), BATCH):
        batch = seeds[at : at + BATCH]
        for seed, found in zip(batch, play(batch), strict=True):
            outcomes[found.outcome] += 1
            sums += Counter(periods=found.periods, faults=found.faults, limits=found.limits)
            if found.outcome == "refused":
                reasons[found.reasons[0].split("; ")[0].rpartition(": ")[2]] += 1
            if found.outcome in WRONG:
                print(f"python -m tools.programs replay {seed}: {found.outcome}", flush=True)
                if until_wrong:
                    return 1
    print(f"{len(seeds)} programs: {', '.join(f'{number} {name}' for name, number in outcomes.most_common())}")
    print(f"{sums['periods']} periods, {sums['faults']} with the same error, {sums['limits']} beyond 32 bits")
    for reason, number in reasons.most_common(SHOWN):
        print(f"{number:6} refused: {reason}")
    return int(any(outcomes[each] for each in WRONG))


def replay(seed: int) -> int:
    """One program as it is, or reduced."""
    from helpers.programs import HEAD, program
    from helpers.reduced_programs import WRONG, reduced

    print(program(seed).removeprefix(HEAD.partition("{begin}")[0]))
    body, found = reduced(seed)
    print(found.outcome, found.difference or "\n".join(found.reasons))
    if found.outcome in WRONG:
        print(f"reduced:\n{body}")
    return int(found.outcome in WRONG)


def plant(count: int) -> int:
    """Each fault in a copy of the tree, and the number of programs until one is different."""
    with tempfile.TemporaryDirectory() as name:
        tree = Path(name)
        for part in ("src", "tests/helpers", "tools"):
            shutil.copytree(HERE / part, tree / part, ignore=shutil.ignore_patterns("__pycache__"))
        missed = [each.what for each in PLANTED if not _is_found(each, tree, count)]
    print(f"{len(PLANTED) - len(missed)} of {len(PLANTED)} found within {count} programs")
    return int(bool(missed))


def _is_found(planted: Planted, tree: Path, count: int) -> bool:
    file = tree / "src" / "umo" / "generate" / planted.file
    text = file.read_text("utf-8")
    if text.count(planted.text) != 1:
        print(f"STALE {planted.what}: {planted.text!r} is not in {planted.file} once")
        return False
    file.write_text(text.replace(planted.text, planted.wrong), "utf-8")
    command = [sys.executable, "-m", "tools.programs", "run", str(count), "--until-wrong"]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(tree / "src"), str(tree)])}
    try:
        done = subprocess.run(
            command, cwd=tree, env=environment, capture_output=True, text=True, check=False, timeout=PLANT_TIMEOUT
        )
    finally:
        file.write_text(text, "utf-8")
    said = (done.stdout or done.stderr).strip().splitlines() or [""]
    is_found = done.returncode == 1 and said[-1].startswith("python -m tools.programs replay")
    print(f"{'found ' if is_found else 'MISSED'} {planted.what}: {said[-1]}", flush=True)
    return is_found


if __name__ == "__main__":
    sys.exit(main())
