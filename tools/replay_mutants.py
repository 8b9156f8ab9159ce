"""Mutants of control code under a replay: is each that alters a commanded raw integer caught by one recording?

    python -m tools.replay_mutants              100 mutants of two stations: a table, and what fell short
    python -m tools.replay_mutants 20 conveyor  some of one station

A mutant has one change in a file of the station's control code, or in a number of it. The truth comes from elsewhere:
the mutant also runs on the plant with the same seed. Until it commands something else, its inputs are the recorded
ones; so the first period that differs from the recorded run must be the one that the replay finds.
"""

from __future__ import annotations

import ast
import json
import logging
import os
import random
import shutil
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from helpers.tapes import MemoryTape, taped
from umo import connect, drive
from umo.cycle.stopping import TimeLimit
from umo.process.job import Job, Plan
from umo.process.job_facts import job_facts
from umo.process.station import shipped
from umo.recording.replay.program import Program
from umo.recording.replay.replaying import replay
from umo.recording.replay.tape import NotReplayable

FILES = {
    "conveyor": (("control.py", "tracking.py", "belt.py", "application.py"), {"seed": 1}),
    "ztheta": (("control.py", "axes.py", "courier.py", "application.py"), {"parts": 1, "seed": 1}),
}
"""The control code of each station, and the options of its run."""
SWAPS: dict[type[ast.AST], type[ast.AST]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Lt: ast.GtE,
    ast.Gt: ast.LtE,
    ast.LtE: ast.Gt,
    ast.GtE: ast.Lt,
    ast.Eq: ast.NotEq,
    ast.Is: ast.IsNot,
    ast.And: ast.Or,
    ast.Or: ast.And,
}
LONGER = 1.3
"""A mutant may run so many times as long as the station, plus 2 s; then it is stopped."""


@dataclass
class Mutant:
    station: str
    file: str
    line: int
    change: str
    truth: int | None = None
    """The first period in which it commands something else on the plant; None: in none."""
    found: int | None = None
    """The first period in which its replay differs; None: in none."""
    fails: str = ""
    """Why it cannot be run or replayed: it was caught before its first period."""

    @property
    def verdict(self) -> str:
        if self.fails:
            return "does not connect"
        if self.truth == self.found:
            return "alters no raw" if self.truth is None else "caught at its period"
        return "NOT AS ON THE PLANT"


def run(place: Path, options: dict[str, Any], until: float | None = None) -> MemoryTape:
    """A run of a station on its plant."""
    plan = Plan(Job(str(place), options=options))
    connection = connect(plan.machine, plan.wired)
    with suppress(Exception), connection as m, taped(connection, job_facts(plan)) as tape:
        if until is not None:
            connection.machine.observers.append(TimeLimit(until, connection.stop))
        drive(m, plan.application)
    return tape


def first_difference(one: MemoryTape, other: MemoryTape) -> int | None:
    """The first period in which two runs commanded different raw integers."""
    outputs = [slot for slot, each in enumerate(one.layout.objects) if each.get("actuator")]
    rows = [_commanded(tape, outputs) for tape in (one, other)]
    for number, (first, second) in enumerate(zip(*rows, strict=False)):
        if first != second:
            return number
    short, long = sorted(map(len, rows))
    return None if short == long else short


def _commanded(tape: MemoryTape, outputs: list[int]) -> list[Any]:
    found: list[Any] = []
    for block in tape.recorded:
        at = 0
        fields = ["slot", "kind", "error", "raw", "before"]
        for raws, count in zip(
            block.frames["raws"][:, outputs].tolist(), block.frames["entries"].tolist(), strict=True
        ):
            found.append((raws, block.entries[at : at + count][fields].tolist()))
            at += count
    return found


def mutants_of(station: str, count: int, seed: int) -> Iterator[tuple[Mutant, str]]:
    """Mutants, each with the new text of its file."""
    draw, place = random.Random(seed), shipped()[station]
    places = [(name, number) for name in FILES[station][0] for number in range(_sites(place / name))]
    for name, number in draw.sample(places, min(count, len(places))):
        tree = ast.parse((place / name).read_text())
        node = list(_nodes(tree))[number]
        line, change = _mutate(node, draw)
        yield Mutant(station, name, line, change), ast.unparse(ast.fix_missing_locations(tree))


def _sites(path: Path) -> int:
    return len(list(_nodes(ast.parse(path.read_text()))))


def _nodes(tree: ast.AST) -> Iterator[ast.AST]:
    """What can be changed: numbers, comparisons, sums, conditions."""
    for node in ast.walk(tree):
        kind: Any = getattr(node, "op", None) or (node.ops[0] if isinstance(node, ast.Compare) else None)
        is_number = isinstance(node, ast.Constant) and type(node.value) in (int, float)
        if is_number or (type(kind) in SWAPS and not isinstance(node, ast.AugAssign | ast.UnaryOp)):
            yield node


def _mutate(node: Any, draw: random.Random) -> tuple[int, str]:
    before = ast.unparse(node)
    if isinstance(node, ast.Constant):
        value = node.value
        node.value = value + 1 if value in (0, 1) else type(value)(value * draw.choice([0.9, 1.1, 1.01, 2.0]))
    elif isinstance(node, ast.Compare):
        node.ops[0] = SWAPS[type(node.ops[0])]()  # type: ignore[call-overload]
    else:
        node.op = SWAPS[type(node.op)]()  # type: ignore[assignment]
    return node.lineno, f"{before} -> {ast.unparse(node)}"


def tried(mutant: Mutant, text: str, recorded: MemoryTape, folder: Path) -> Mutant:
    """In a process of its own: its modules and what it breaks go with it."""
    reader, writer = os.pipe()
    if (child := os.fork()) == 0:
        status = 1
        try:
            os.close(reader)
            _try(mutant, text, recorded, folder)
            os.write(writer, json.dumps(asdict(mutant)).encode())
            status = 0
        finally:
            os._exit(status)
    os.close(writer)
    with os.fdopen(reader, "rb") as pipe:
        data = pipe.read()
    os.waitpid(child, 0)
    return Mutant(**json.loads(data)) if data else Mutant(**asdict(mutant) | {"fails": "its process ended"})


def _try(mutant: Mutant, text: str, recorded: MemoryTape, folder: Path) -> None:
    place = folder / f"{mutant.station}_{mutant.file.removesuffix('.py')}_{mutant.line}_{abs(hash(mutant.change))}"
    shutil.copytree(shipped()[mutant.station], place, ignore=shutil.ignore_patterns("__pycache__"))
    (place / mutant.file).write_text(text)
    options = FILES[mutant.station][1]
    end = float(recorded.frames["time"][-1])
    try:
        result = replay(recorded, Program.of(recorded, str(place)))
        mutant.found = None if result.difference is None else result.difference.period
        mutant.truth = first_difference(recorded, run(place, options, LONGER * end + 2.0))
    except (NotReplayable, UnboundLocalError) as error:
        mutant.fails = str(error)


def campaign(count: int, stations: list[str], seed: int = 1) -> list[Mutant]:
    done = []
    with tempfile.TemporaryDirectory() as folder:
        for station in stations:
            recorded = run(shipped()[station], FILES[station][1])
            for mutant, text in mutants_of(station, count // len(stations), seed):
                done.append(tried(mutant, text, recorded, Path(folder)))
                print(f"{done[-1].verdict:22} {station}/{mutant.file}:{mutant.line}: {mutant.change[:70]}", flush=True)
    return done


def table(done: list[Mutant]) -> str:
    counts = Counter((mutant.station, mutant.verdict) for mutant in done)
    lines = ["| station | verdict | mutants |", "| --- | --- | --- |"]
    return "\n".join([*lines, *(f"| {station} | {what} | {n} |" for (station, what), n in sorted(counts.items()))])


if __name__ == "__main__":
    logging.disable(logging.CRITICAL)
    number = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    results = campaign(number, sys.argv[2:] or list(FILES))
    print(table(results))
    sys.exit(any(mutant.verdict == "NOT AS ON THE PLANT" for mutant in results))
