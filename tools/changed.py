"""The modules of tests that a change can reach by imports: make test CHANGED=1, or CHANGED=REV.

    python -m tools.changed HEAD     prints their files: `tests` for all, nothing for none; on stderr how many, and why

A module reaches what it imports, anywhere in it, and what it names: `umo.control.PID`, "helpers.runs:machine", a
driver, a face or a station by its name, the command umo. A test reaches what a conftest imports if it takes a fixture
of it. Every change reaches what reads all sources, and tests/project. A change of anything but Python (a table, a
page, C), of a conftest, or of a file that has gone reaches all tests.
"""

from __future__ import annotations

import argparse
import ast
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[1]
CODE = ("src", "tests", "tools", "bench")
COMMAND = re.compile(r"^umo$|\bumo [a-z]")
ALL_SOURCES = re.compile(r"^(\*\*/)?\*\.py$")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("revision", help="the commit that the files are compared with; 1: HEAD")
    revision = parser.parse_args().revision
    found, why = reached(ROOT, changed(ROOT, "HEAD" if revision == "1" else revision))
    print(f"make test: {why}", file=sys.stderr)
    print(*found)
    return 0


def changed(root: Path, revision: str) -> list[str]:
    """The files that differ from a commit, or have gone since, and those that git does not know yet."""
    asked = (["diff", "--name-only", "--no-renames", revision, "--"], ["ls-files", "--others", "--exclude-standard"])
    texts = [subprocess.run(["git", *each], cwd=root, capture_output=True, text=True, check=True) for each in asked]
    return sorted({line for each in texts for line in each.stdout.splitlines()})


def reached(root: Path, files: Iterable[str]) -> tuple[list[str], str]:
    """The modules of tests that a change of these files can reach, and a line that says why."""
    modules = modules_of(root)
    places = set(modules.values())
    for file in files:
        if root / file not in places or Path(file).name == "conftest.py":
            return ["tests"], f"all modules, as {file} has changed"
    users: dict[Path, set[Path]] = {}
    for module, uses in graph(root, modules).items():
        for each in uses:
            users.setdefault(each, set()).add(module)
    waiting = [root / file for file in files]
    known = set(waiting)
    while waiting:
        more = users.get(waiting.pop(), set()) - known
        known |= more
        waiting += more
    tests = [place for place in places if place.is_relative_to(root / "tests") and place.name.startswith("test_")]
    found = sorted(str(each.relative_to(root)) for each in tests if each in known)
    return found, f"{len(found)} of {len(tests)} modules, which {len(list(files))} changed files can reach by imports"


def modules_of(root: Path) -> dict[str, Path]:
    """Each Python file by the name with which it is imported, in which folders of tests without an __init__ are not."""
    found = {}
    for place in (each for folder in CODE for each in (root / folder).rglob("*.py")):
        base = {"src": root / "src", "tests": place.parent}.get(place.relative_to(root).parts[0], root)
        while base != root and (base / "__init__.py").exists():
            base = base.parent
        name = ".".join(place.relative_to(base).with_suffix("").parts).removesuffix(".__init__")
        found[name if name not in found else str(place)] = place
    return found


def graph(root: Path, modules: Mapping[str, Path]) -> dict[Path, set[Path]]:
    """What each file uses: files."""
    called = by_name(root, modules)
    found = {}
    for name, place in modules.items():
        nodes = list(ast.walk(ast.parse(place.read_bytes())))
        package = name if place.name == "__init__.py" else name.rpartition(".")[0]
        texts = list(texts_of(nodes))
        uses = {modules[part] for each in named(nodes, package, texts) for part in parts(each) if part in modules}
        if not place.is_relative_to(root / "src"):
            uses |= {each for word in words_of(texts) for each in called.get(word, ())}
            if place.is_relative_to(root / "tests" / "project") or any(map(ALL_SOURCES.search, texts)):
                uses |= set(modules.values())
            arguments = {node.arg for node in nodes if isinstance(node, ast.arg)}
            uses |= {each for each in conftests(root, place.parent) if arguments & fixtures(each)}
        found[place] = uses
    return found


def texts_of(nodes: Iterable[ast.AST]) -> Iterator[str]:
    """The texts in code; docstrings are none."""
    docstrings = {id(node.value) for node in nodes if isinstance(node, ast.Expr)}
    return (
        node.value
        for node in nodes
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in docstrings
    )


def words_of(texts: Iterable[str]) -> Iterator[str]:
    """Those that may name a driver, a face, a station: a whole text, in quotes, or in a line of the command."""
    for text in texts:
        yield text
        yield from re.findall(r"""["'](\w+)["']""", text)
        if COMMAND.search(text):
            yield "umo"
            yield from re.findall(r"\w+", text)


def parts(name: str) -> Iterator[str]:
    """umo.control.PID: umo, umo.control, umo.control.PID. To import a module is to import its packages."""
    words = name.split(".")
    return (".".join(words[:count]) for count in range(1, len(words) + 1))


def named(nodes: Iterable[ast.AST], package: str, texts: Iterable[str]) -> Iterator[str]:
    """Names that may be those of modules."""
    for text in texts:
        if "." in text:
            yield from (text.partition(":")[0], f"{text}.__main__")  # python -m umo.process
    for node in nodes:
        match node:
            case ast.Import(names=names):
                yield from (each.name for each in names)
            case ast.ImportFrom(module=module, names=names, level=level):
                above = package.split(".")[: len(package.split(".")) - level + 1] if level else []
                yield from (".".join([*above, *filter(None, [module]), each.name]) for each in names)
            case ast.Attribute(value=ast.Name(id="umo"), attr=attribute):
                yield f"umo.{attribute}"
            case ast.Attribute(value=ast.Attribute(value=ast.Name(id="umo"), attr=room), attr=attribute):
                yield f"umo.{room}.{attribute}"


def by_name(root: Path, modules: Mapping[str, Path]) -> dict[str, set[Path]]:
    """What is imported because its name stands in a text: entry points, stations, the command. Packages whose modules
    are imported by names that are put together count as a whole."""
    found: dict[str, set[Path]] = {}
    for points in tomllib.loads((root / "pyproject.toml").read_text())["project"].get("entry-points", {}).values():
        for name, value in points.items():
            found[name] = {modules[each] for each in parts(value.partition(":")[0]) if each in modules}
    for name, place in modules.items():
        package, _, rest = name.partition(".stations.")
        if package == "umo" and rest:
            found.setdefault(rest.partition(".")[0], set()).add(place)
        if name.split(".")[0] == "umo_command":
            found.setdefault("umo", set()).add(place)
    return found


@cache
def conftests(root: Path, folder: Path) -> list[Path]:
    folders = [folder, *folder.parents]
    return [file for each in folders if each.is_relative_to(root) and (file := each / "conftest.py").exists()]


@cache
def fixtures(conftest: Path) -> set[str]:
    """The fixtures of a conftest that a test takes by name."""
    functions = [node for node in ast.parse(conftest.read_bytes()).body if isinstance(node, ast.FunctionDef)]
    return {node.name for node in functions if any("fixture" in ast.unparse(each) for each in node.decorator_list)}


if __name__ == "__main__":
    sys.exit(main())
