"""Counts what a machine costs, and what the core is made of.

    python tools/count.py        the tables of docs/machines.md: what is a machine's own, and what umo carries
    python tools/count.py core   what `umo.cycle` is made of, printed: each count with its rule, below
    python tools/count.py verbs  the files that know a verb of clients by name, printed

`make docs` calls the first. A line is a line of a file that is not empty. The lines of the library are those of its
functions that a run in virtual time calls, without the station's own and without the command line.
"""

from __future__ import annotations

import argparse
import ast
import re
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import umo
import umo.control
from umo import Compound
from umo.objects import Atomic, walk
from umo.operation.commands.verbs import VERBS
from umo.process.station import Station, find

SOURCE = Path(umo.__file__).parent
COMMAND = SOURCE.with_name("umo_command")
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
    return SOURCE in file.parents and not {"stations"} & set(file.relative_to(SOURCE).parts)


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
    replaced = _row(REPLACED, [_replacement(*change, n) for change, n in zip(changes, totals, strict=True)])
    return [[*_head(["", *RUNS]), *rows, carrying, replaced], [*_head(["machine", "made of"]), *made]]


def _replacement(out: int, into: int, total: int) -> str:
    """Return how many lines of a wiring the second circuit replaces, and by how many others."""
    return f"{out} of {total}, by {into} other{'s' if into != 1 else ''}"


def with_tables(page: str) -> str:
    """The page with the tables in the places of those that have the same heads."""
    lines = page.splitlines()
    for table in tables():
        begin = lines.index(table[0])
        lines[begin : lines.index("", begin)] = table
    return "\n".join(lines) + "\n"


# What the core is made of -------------------------------------------------------------------------------

CORE = SOURCE / "cycle"
PROGRAMS = {"stations", "testing"}
"""Rooms of programs that use what the others have."""
KNOWN = {
    "suspension": r"suspen|^resuming$",
    "rates": r"^Rate(Map|d.*|Groups?)?$|^rate_groups$|^Part(Clock|Group)$|^GroupView$|^WHOLE$|^urgent$|^hasten$",
    "faults": r"in_fault|^fault_of$|EquipmentFault|EquipmentState|Containment",
}
"""A file knows one of these if a name in its code, also an import's, matches."""
SCALING_IN_C = re.compile(r" [*/] [\w.>\[\]-]*resolution")
SCALING_ROOMS = ("cycle", "objects", "recording", "generate")


def core_counts() -> Iterator[tuple[str, int, str]]:
    """What is counted, the number, and where."""
    trees = {file: ast.parse(file.read_text("utf-8")) for file in sorted(SOURCE.rglob("*.py"))}
    core = {file: tree for file, tree in trees.items() if CORE in file.parents}
    for number, name in sorted(_members(core.values()), reverse=True)[:5]:
        yield f"members of {name}", number, "names of its body and attributes of self that it sets, without __names__"
    for capability, pattern in KNOWN.items():
        files = [file for file, tree in trees.items() if not PROGRAMS & set(file.relative_to(SOURCE).parts)
                 and any(re.search(pattern, name) for name in _names(trees[file]))]  # fmt: skip
        yield f"files in which {capability} are known", len(files), ", ".join(file.stem for file in files)
    yield "Protocols of the core", _protocols(core.values()), f"of the library: {_protocols(trees.values())}"
    branches = {file.stem: number for file, tree in core.items() if (number := _branches(tree))}
    yield "branches on `synchronous`", sum(branches.values()), ", ".join(f"{name} {n}" for name, n in branches.items())
    ways = sorted(name for tree in core.values() for name in _ways_to_a_default(tree))
    yield "ways to a default", len(ways), ", ".join(ways)
    scalings = Counter(file.name for file in _scaling_files() for each in _scalings(file))
    yield "scalings", scalings.total(), ", ".join(f"{name} {number}" for name, number in scalings.items())
    yield "lines of the core in Python", lines(*core), "not empty"
    yield "lines of the core in C", lines(*CORE.glob("*.c"), *CORE.glob("*.h")), "not empty"


def _members(trees: Iterable[ast.AST]) -> Iterator[tuple[int, str]]:
    """Their number and the name of each class."""
    for node in (node for tree in trees for node in ast.walk(tree) if isinstance(node, ast.ClassDef)):
        names = {each.name for each in node.body if isinstance(each, ast.FunctionDef | ast.AsyncFunctionDef)}
        fields = (each for each in node.body if isinstance(each, ast.Assign | ast.AnnAssign))
        names |= {
            each.id for field in fields for each in ast.walk(field) if isinstance(each, ast.Name) and _is_set(each)
        }
        attributes = (each for each in ast.walk(node) if isinstance(each, ast.Attribute) and _is_set(each))
        names |= {each.attr for each in attributes if isinstance(each.value, ast.Name) and each.value.id == "self"}
        yield len([name for name in names if not name.startswith("__")]), node.name


def _is_set(node: ast.Name | ast.Attribute) -> bool:
    return isinstance(node.ctx, ast.Store)


def _names(tree: ast.AST) -> Iterator[str]:
    for node in ast.walk(tree):
        found = [getattr(node, name, None) for name in ("id", "attr", "arg", "name", "module")]
        yield from (part for name in found if isinstance(name, str) for part in name.split("."))


def _protocols(trees: Iterable[ast.AST]) -> int:
    classes = (node for tree in trees for node in ast.walk(tree) if isinstance(node, ast.ClassDef))
    return sum(any("Protocol" in ast.unparse(base) for base in each.bases) for each in classes)


def _branches(tree: ast.AST) -> int:
    """The places where a condition asks whether an object is synchronous, or in the set of those that are not."""
    conditions = [condition for node in ast.walk(tree) for condition in _conditions(node)]
    asked = (each for condition in conditions for each in ast.walk(condition))
    words = {"synchronous", "asynchronous"}
    return len({each for each in asked if getattr(each, "attr", None) in words or getattr(each, "id", None) in words})


def _conditions(node: ast.AST) -> list[ast.expr]:
    if isinstance(node, ast.If | ast.IfExp | ast.While):
        return [node.test]
    if isinstance(node, ast.comprehension):
        return node.ifs
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
        return [node.operand]
    return node.values if isinstance(node, ast.BoolOp) else []


def _ways_to_a_default(tree: ast.AST) -> Iterator[str]:
    """The functions that make a default pending by what is made for that."""
    makes = {"set_default", "_at_default"}
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef) and node.name not in makes:
            calls = (each.func for each in ast.walk(node) if isinstance(each, ast.Call))
            if any(getattr(each, "attr", "") in makes for each in calls):
                yield node.name


def _scaling_files() -> list[Path]:
    return [
        file
        for room in SCALING_ROOMS
        for file in sorted((SOURCE / room).rglob("*.[pch]*"))
        if file.suffix in (".py", ".c", ".h")
    ]


def _scalings(file: Path) -> Sequence[object]:
    """The places in the code where something is multiplied by a resolution, or divided by one."""
    text = file.read_text("utf-8")
    if file.suffix == ".py":
        return [node for node in ast.walk(ast.parse(text)) if _is_scaling(node)]
    return [line for line in text.splitlines() if SCALING_IN_C.search(line)]


def _is_scaling(node: ast.AST) -> bool:
    by: Sequence[ast.expr] = ()
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mult | ast.Div):
        by = [node.right]
    elif isinstance(node, ast.Call) and ast.unparse(node.func).endswith(("multiply", "divide")):
        by = node.args
    return any(re.search(r"resolution(\[.*\])?$", ast.unparse(each)) for each in by)


# Who knows a verb by name -------------------------------------------------------------------------------

ROOMS_OF_COMMANDS = (
    "operation/alarms", "operation/commands", "clients", "commissioning", "cycle", "process/frames", "system"
)  # fmt: skip
TABLE_OF_VERBS = ("operation/commands/verbs.py", "cycle/events.py")
"""The table, and the word of the cycle's events that it takes over."""
OWN_PLACES = ("clients/faces/opcua/ua_packml.py", "clients/page/static/states.js")
"""Protocols, and panels, of the commands of PackML, which have names of their own."""
GIVEN_TO = ("ask", "_ask", "send", "_send", "_send_on", "may", "refusal", "_refusal", "do", "Called", "ClientCommand")
"""Functions that are given a verb."""
IN_PAGE = re.compile(r'do: "([a-z ]+)"|^const \w+ = \[?"([a-z ]+)"')


def verb_counts(source: Path = SOURCE) -> Iterator[tuple[str, list[str]]]:
    """Files, and the verbs that each knows by name: a text that is the name. One of several words counts anywhere; one
    word where a function in `GIVEN_TO` is given it, where it is the argument `do`, or is compared with something of
    that name. Of the page: where it is the field `do`, or a constant."""
    for folder in (*(source / room for room in ROOMS_OF_COMMANDS), source.with_name(COMMAND.name)):
        for file in sorted(folder.rglob("*.py")):
            where = file.relative_to(source.parent).as_posix().removeprefix("umo/")
            if where not in TABLE_OF_VERBS + OWN_PLACES and "template" not in file.parts:
                yield where, sorted(set(_verbs_in(ast.parse(file.read_text("utf-8")))))
    for file in sorted((source / "clients" / "page" / "static").glob("*.js")):
        lines = file.read_text("utf-8").splitlines()
        found = {one or other for line in lines for one, other in IN_PAGE.findall(line)}
        if (where := file.relative_to(source).as_posix()) not in OWN_PLACES:
            yield where, sorted(found & VERBS.keys())


def _verbs_in(tree: ast.AST) -> Iterator[str]:
    for node in ast.walk(tree):
        inner: Iterable[ast.AST] = ()
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value:
            inner = [node]
        elif isinstance(node, ast.Call):
            inner = [each.value for each in node.keywords if each.arg == "do"]
            if _called(node) in GIVEN_TO:
                inner = [*inner, *node.args]
        elif isinstance(node, ast.Compare) and re.search(r"\bdo\b", ast.unparse(node)):
            inner = [each for each in ast.walk(node) if isinstance(each, ast.Constant)]
        yield from (each.value for each in inner if isinstance(each, ast.Constant) and each.value in VERBS)


def _called(call: ast.Call) -> str:
    return call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")


def _head(columns: list[str]) -> list[str]:
    return [_row(columns[0], columns[1:]), "| --- " * len(columns) + "|"]


def _row(what: str, cells: Sequence[object]) -> str:
    return f"| {what} | " + " | ".join(map(str, cells)) + " |"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", nargs="?", choices=["machines", "core", "verbs"], default="machines")
    what = parser.parse_args().what
    if what == "verbs":
        counted = {where: found for where, found in verb_counts() if found}
        for where, found in counted.items():
            print(f"{where}: {', '.join(found)}")
        print(f"{len(counted)} files know a verb by name")
    elif what == "core":
        for what, number, where in core_counts():
            print(f"{number:6,}  {what} ({where})")
    else:
        PAGE.write_text(with_tables(PAGE.read_text("utf-8")), "utf-8")
