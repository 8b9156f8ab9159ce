"""The lints of this tree that no linter has: `make lint`.

One name stands for one module and for one class or type; nothing in the package imports the package itself (a circle);
test modules import what they share from tests/helpers, never each other; every link, file and test that README and
docs/ name exists (tests/project/test_named_commands.py has the commands); the wall clock is read where a date is meant,
and nowhere else; nobody asks what kind of value something is, which `Described` says.
"""

from __future__ import annotations

import argparse
import ast
import re
import sys
from collections import defaultdict
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import grimp

ROOT = Path(__file__).parents[1]
TREE, COMMAND, TESTS = ROOT / "src" / "umo", ROOT / "src" / "umo_command", ROOT / "tests"
SHOWN_TO_THE_OBJECTS = TREE / "objects" / "link.py"
"""Protocols of the parts above, under the names that those parts have."""
ROLES = {
    "__init__",
    "__main__",
    "application",
    "control",
    "objects",
    "plant",
    "run",
    "errors",
    "driver",
    "channel",
    "twin",
    "commands",
}
"""Modules with one part in many places: a station's files, a driver's, a command of the command line, its errors."""
ROLES_OF_CLASSES = {"Plant", "Block"}
"""Classes that each station has; what is moved in one transfer, and frames in one piece of a recording."""
WALL_CLOCK = {
    "umo_command/connect/fleet_authority.py": "when a certificate expires",
    "umo_command/tune/kept.py": "when values were kept, perhaps before the computer was started",
    "umo_command/run/run_folder.py": "the name of a folder, the start of a run",
    "umo_command/connect/fleet.py": "when a certificate expires",
    "umo_command/show/why.py": "the name of a file",
    "clients/faces/epics/process_variable.py": "the time of a value",
    "clients/faces/mqtt/home_assistant.py": "the time of an answer",
    "clients/faces/mqtt/sparkplug.py": "a number that another process has not begun with",
    "clients/faces/mqtt/sparkplug_node.py": "the time of a message",
    "clients/faces/opcua/opcua_face.py": "the time of a value",
    "clients/faces/opcua/ua_attributes.py": "the time of an answer",
    "clients/faces/opcua/ua_events.py": "the time of an event",
    "clients/faces/opcua/ua_items.py": "the time of a value",
    "clients/faces/opcua/ua_monitoring.py": "the time of an event",
    "clients/faces/opcua/ua_security.py": "when a certificate expires",
    "clients/fleet/fleet_certificates.py": "when a certificate expires",
    "clients/fleet/fleet_identity.py": "when a certificate expires",
    "clients/fleet/fleet_query.py": "hours of UTC in a history",
    "clients/fleet/mirror_commands.py": "until when a command is valid on another computer",
    "process/frames/publish.py": "when a run was started",
    "process/frames/blackbox.py": "when a black box was kept; the age of a file",
    "process/frame_watcher.py": "the name of a file",
    "process/kept_values.py": "the name of a file",
    "system/calls.py": "the function by which the processes of a run read it",
    "system/device_lock.py": "since when a device is held",
    "system/device_record.py": "when a run began and ended",
    "system/utc.py": "UTC of a period, beside the run's own clock",
    "testing/conformance/certificate.py": "the date of a certificate",
    "clients/faces/conformance/face_rules.py": "whether the time of a value is right",
}
"""The modules that read the wall clock, and the date that each means by it. Durations and limits are of the monotonic
clock or of a run's own: the wall clock is set, by hours, while a machine runs."""
CODE = re.compile(r"^```.*?^```|`[^`\n]+`", re.M | re.S)
LINK = re.compile(r"\]\((?!https?:)([^)#]+)")
FILE = re.compile(r"(?<![\w./~-])(?:tests|tools|bench|docs|src|umo|stations)/[\w./-]*\w")
TEST = re.compile(r"\btest_\w+")
PROGRAM = re.compile(r"(?:python -m |bin/)((?:bench|tools)[\w.]*)")
MAKE = re.compile(r"^`?(?:\$ )?make ([a-z][a-z-]*)", re.M)
KINDS = {"Binary", "BinaryActuator", "BinarySensor", "Digital", "DigitalActuator", "DigitalSensor"}
"""Classes of which nobody asks whether an object is one (docs/decisions/0101-what-a-value-means.md)."""
ASKS_FOR_KINDS = {
    "objects/": "they are declared there",
    "generate/": "C has functions for each kind",
    "wiring/resolve.py": "what a wiring may set of each kind",
    "umo_command/device/get_set.py": "the timer",
    "cycle/run.py": "the timer",
    "control/loop_output.py": "a law drives an actuator, or another law",
}
DESCRIBED = "objects/presentation/described.py"


def main() -> int:
    """Print each problem in a line; 1 if there is one."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    files = [*sorted(TREE.rglob("*.py")), *sorted(COMMAND.rglob("*.py"))]
    files = [file for file in files if "template" not in file.parts]
    parsed = {file: ast.parse(file.read_text("utf-8")) for file in files}
    tests = {file: ast.parse(file.read_text("utf-8")) for file in sorted(TESTS.rglob("*.py"))}
    problems = [*same_modules(files), *same_classes(parsed), *circles(parsed), *tests_importing_tests(tests)]
    placed = {str(file.relative_to(ROOT / "src")).removeprefix("umo/"): module for file, module in parsed.items()}
    problems += [*wall_clocks(placed), *asked_for_kinds(placed)]
    known = {file.stem for file in tests} | {name for module in tests.values() for name in _tests(module)}
    for page in [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]:
        problems += [f"{_places([page])} names {what}, which does not exist" for what in missing(page, known)]
    print("\n".join(problems) or "All checks passed!")
    return bool(problems)


def asked_for_kinds(parsed: dict[str, ast.Module]) -> Iterator[str]:
    """Where the class of an object, or its plain data, is asked what kind of value it is."""
    for file, module in parsed.items():
        for node in ast.walk(module) if file != DESCRIBED else ():
            if _asks_for_fact(node) or (not file.startswith(tuple(ASKS_FOR_KINDS)) and _asks_for_class(node)):
                yield f"{file}:{node.lineno} asks what kind of value it is: Described says it"  # type: ignore[attr-defined]


def _asks_for_fact(node: ast.AST) -> bool:
    """`"one" in about`."""
    asks = isinstance(node, ast.Compare) and isinstance(node.ops[0], ast.In | ast.NotIn)
    return asks and isinstance(node.left, ast.Constant) and node.left.value in ("one", "zero")  # type: ignore[attr-defined]


def _asks_for_class(node: ast.AST) -> bool:
    asks = isinstance(node, ast.Call) and getattr(node.func, "id", "") in ("isinstance", "issubclass")
    return asks and any(getattr(each, "id", "") in KINDS for each in ast.walk(node.args[1]))  # type: ignore[attr-defined]


def same_modules(files: list[Path]) -> Iterator[str]:
    found = defaultdict(list)
    for file in files:
        found[file.stem].append(file)
    for name, each in found.items():
        if len(each) > 1 and name not in ROLES:
            yield f"modules of one name: {_places(each)}"


def same_classes(parsed: dict[Path, ast.Module]) -> Iterator[str]:
    found = defaultdict(list)
    for file, module in parsed.items():
        for name in _types(module) if file != SHOWN_TO_THE_OBJECTS else ():
            found[name].append(file)
    for name, each in found.items():
        if len(each) > 1:
            yield f"classes or types of one name, {name}: {_places(each)}"


def wall_clocks(parsed: dict[str, ast.Module]) -> Iterator[str]:
    """Readings of the wall clock where no date is meant, and entries of `WALL_CLOCK` that are none."""
    found: dict[str, int] = {}
    for file, module in parsed.items():
        plain = {
            each.asname or each.name
            for node in ast.walk(module)
            if isinstance(node, ast.ImportFrom) and node.module == "time"
            for each in node.names
            if each.name in ("time", "time_ns")
        }
        for node in ast.walk(module):
            if isinstance(node, ast.Call) and _reads_wall_clock(node.func, plain):
                found.setdefault(file, node.lineno)
    for file, line in found.items():
        if file not in WALL_CLOCK:
            yield f"{file}:{line} reads the wall clock: take time.monotonic, or name the date in WALL_CLOCK"
    yield from (f"WALL_CLOCK names {file}, which does not read it" for file in sorted({*WALL_CLOCK} - {*found}))


def _reads_wall_clock(function: ast.expr, plain: set[str]) -> bool:
    """`plain`: names of time's own functions in the module."""
    if isinstance(function, ast.Name):
        return function.id in plain
    if not isinstance(function, ast.Attribute) or not isinstance(function.value, ast.Name):
        return False
    of, name = function.value.id, function.attr
    return (of, name) in {("time", "time"), ("time", "time_ns"), ("calls", "wall_time")} or (
        of in ("datetime", "date") and name in ("now", "utcnow", "today")
    )


def _types(module: ast.Module) -> Iterator[str]:
    """Public classes, and assignments that look like the name of a type."""
    for node in module.body:
        names = [node.name] if isinstance(node, ast.ClassDef) else []
        if isinstance(node, ast.Assign):
            names = [each.id for each in node.targets if isinstance(each, ast.Name) and each.id[1:].islower()]
            names = [name for name in names if name[0].isupper() and len(name) > 1]
        yield from (name for name in names if not name.startswith("_") and name not in ROLES_OF_CLASSES)


def circles(parsed: dict[Path, ast.Module]) -> Iterator[str]:
    """Files that import one another, imports for types too; and whoever imports `umo/__init__.py`, which imports the
    others."""
    graph = grimp.build_graph("umo", "umo_command", exclude_type_checking_imports=False, cache_dir=None)
    try:
        TopologicalSorter({each: graph.find_modules_directly_imported_by(each) for each in graph.modules}).prepare()
    except CycleError as error:
        yield f"files import one another: {' < '.join(error.args[1])}"
    for file, module in parsed.items():
        outside = TREE / "stations" in file.parents or COMMAND in file.parents
        if not outside and any(name == "umo" for name, _ in _imports(module)):
            yield f"{_places([file])} imports the package itself"


def tests_importing_tests(tests: dict[Path, ast.Module]) -> Iterator[str]:
    for file, module in tests.items():
        for name, line in _imports(module):
            if name.rpartition(".")[2].startswith("test_"):
                yield f"{_places([file])}:{line} imports {name}: what tests share stands in tests/helpers"


def missing(page: Path, tests: set[str]) -> Iterator[str]:
    """Links, and in code: files, tests (of this tree or of the page), programs, targets of make."""
    text = page.read_text("utf-8")
    code = "\n".join(CODE.findall(text))
    targets = re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text("utf-8"), re.M)
    known = tests.union(re.findall(r"def (test_\w+)", text), re.findall(r"(test_\w+)\.py", code))
    yield from (link for link in LINK.findall(text) if not (page.parent / link).exists())
    for file in FILE.findall(code):
        if not any((folder / file).exists() for folder in (ROOT, ROOT / "src", TREE)):
            yield file
    yield from (name for name in TEST.findall(code) if name not in known)
    for name in PROGRAM.findall(code):
        if not list(ROOT.glob(name.replace(".", "/") + "*")):
            yield f"python -m {name}"
    yield from (f"make {name}" for name in MAKE.findall(code) if name not in targets)


def _tests(module: ast.Module) -> Iterator[str]:
    return (node.name for node in module.body if isinstance(node, ast.FunctionDef) and node.name.startswith("test_"))


def _imports(module: ast.Module) -> Iterator[tuple[str, int]]:
    """The name of each module that is imported, and the line."""
    for node in ast.walk(module):
        if isinstance(node, ast.Import):
            yield from ((each.name, node.lineno) for each in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.module or "", node.lineno


def _places(files: list[Path]) -> str:
    return ", ".join(str(file.relative_to(ROOT)) for file in files)


if __name__ == "__main__":
    sys.exit(main())
