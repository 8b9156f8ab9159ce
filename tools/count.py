"""Counts the tables of docs/machines.md: what is a machine's own, and what umo carries. `make docs` calls it.

A line is a line of a file that is not empty. The library's lines are those of the functions of umo that a run in
virtual time calls, without the station's own and without the command line.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import umo
import umo.control
from umo import Compound
from umo.objects import Atomic, walk
from umo.process.station import Station, find

SOURCE = Path(umo.__file__).parent
PAGE = Path(__file__).parents[1] / "docs" / "machines.md"
RUNS: dict[str, dict[str, Any]] = {
    "ztheta": {"parts": 1},
    "conveyor": {"parts": 4},
    "furnace": {"soak": 5.0},
    "batch": {"batches": 1},
}
"""The stations, and options that make a run short."""
PLANT = {"plant", "physics", "devices", "courier", "parts", "render", "vessel"}
"""Modules of the simulated hardware."""
CARRIED, REPLACED = "umo: functions that a run calls", "wiring: lines that the second circuit replaces"
SECOND = {"ztheta": "second_generation", "conveyor": "hertz", "furnace": "modbus", "batch": "modbus"}
"""The wiring of each machine's second circuit."""


def lines(*files: Path) -> int:
    return sum(bool(line.strip()) for file in files for line in file.read_text("utf-8").splitlines())


def own(name: str) -> dict[str, int]:
    """Lines by kind."""
    folder = SOURCE / "stations" / name
    files = {file.stem: file for file in folder.glob("*.py") if file.stem != "__init__"}
    control = [file for stem, file in files.items() if stem not in PLANT | {"objects", "twin"}]
    return {
        "objects": lines(files["objects"]),
        "control and application": lines(*control),
        "wiring": lines(folder / "wiring" / "simulated.toml"),
        "plant": lines(*(file for stem, file in files.items() if stem in PLANT)),
        "twin": lines(files["twin"]),
    }


def changed(name: str) -> tuple[int, int]:
    """Lines of the first wiring that the second circuit changes or leaves out, and lines that it adds instead."""
    first, second = (_wiring(name, wiring) for wiring in ("simulated", SECOND[name]))
    return (first - second).total(), (second - first).total()


def _wiring(name: str, wiring: str) -> Counter[str]:
    text = (SOURCE / "stations" / name / "wiring" / f"{wiring}.toml").read_text("utf-8")
    stripped = (line.partition("#")[0].rstrip() for line in text.splitlines())
    return Counter(line for line in stripped if line)


def carried(name: str) -> int:
    """Lines of the library's functions that a run calls."""
    station = find(name)
    called: set[CodeType] = set()

    def note(frame: FrameType, event: str, argument: object) -> None:
        if event == "call":
            called.add(frame.f_code)

    sys.setprofile(note)
    try:
        umo.run(station.machine(), station.wiring(None), station.main, **RUNS[name])
    finally:
        sys.setprofile(None)
    found = {(code.co_filename, line) for code in called if _is_library(code) for line in _lines_of(code)}
    return len(found)


def _is_library(code: CodeType) -> bool:
    file = Path(code.co_filename)
    return SOURCE in file.parents and not {"stations", "cli"} & set(file.relative_to(SOURCE).parts)


def _lines_of(code: CodeType) -> Iterator[int]:
    return (line for _, _, line in code.co_lines() if line is not None)


def parts(station: Station) -> list[str]:
    """The kinds of objects, laws and interlocks of a machine, each with its number."""
    machine = station.machine()
    nodes = [machine, *walk(machine)]
    kinds = Counter(_base(node) for node in nodes if isinstance(node, Atomic))
    laws = Counter(
        name
        for node in nodes
        if isinstance(node, Compound)
        for law in vars(node).values()
        for name in _kind_of_law(law)
    )
    axes = Counter(
        base.__name__
        for node in nodes
        for base in type(node).__mro__[:-1]
        if base.__module__ in ("umo.control.servo_axis", "umo.control.stepper_axis")
    )
    declared = [each for node in nodes if isinstance(node, Compound) for each in node.interlocks()]
    interlocks = Counter({"Interlock": len(declared)})
    found = kinds + axes + laws + interlocks
    del found["Compound"]
    return [f"{count} {kind}" for kind, count in found.items()]


def _kind_of_law(law: object) -> list[str]:
    """The public class that it is of; none if it is not a law."""
    public = {*umo.control.__all__, "Vector"} - {"Axis", "ServoAxis", "StepperAxis", "Claim"}
    return [base.__name__ for base in type(law).__mro__ if base.__name__ in public][:1]


def _base(item: Atomic) -> str:
    return next(base.__name__ for base in type(item).__mro__ if base.__module__.startswith("umo.objects."))


def tables() -> list[list[str]]:
    counts = {name: own(name) for name in RUNS}
    rows = [_row(kind, [counts[name][kind] for name in RUNS]) for kind in next(iter(counts.values()))]
    changes = [changed(name) for name in RUNS]
    totals = [_wiring(name, "simulated").total() for name in RUNS]
    made = [_row(name, [", ".join(parts(find(name)))]) for name in RUNS]
    carrying = _row(CARRIED, [carried(name) for name in RUNS])
    replaced = _row(REPLACED, [f"{out} of {n}, by {into}" for (out, into), n in zip(changes, totals, strict=True)])
    return [[*_head(["", *RUNS]), *rows, carrying, replaced], [*_head(["machine", "made of"]), *made]]


def with_tables(page: str) -> str:
    """The page with the tables in the places of those that have the same heads."""
    lines = page.splitlines()
    for table in tables():
        begin = lines.index(table[0])
        lines[begin : lines.index("", begin)] = table
    return "\n".join(lines) + "\n"


def _head(columns: list[str]) -> list[str]:
    return [_row(columns[0], columns[1:]), "| --- " * len(columns) + "|"]


def _row(what: str, cells: Sequence[object]) -> str:
    return f"| {what} | " + " | ".join(map(str, cells)) + " |"


if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__).parse_args()
    PAGE.write_text(with_tables(PAGE.read_text("utf-8")), "utf-8")
