"""Programs that are refused, a file each: what is told of each is written above the line that it is told of.

A file of `tests/generate/refusals` has one program, its last class. A comment `# refused: REASON; NEAREST` stands above
a line for each reason that umo gives for it.
"""

from __future__ import annotations

import ast
import importlib.util
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import umo.generate.lower as room
from helpers.side_by_side import HOST, Rig
from umo.generate.lower.function_builder import FunctionBuilder, NoTranslation
from umo.generate.translator import translate

FOLDER = Path(__file__).parents[1] / "generate" / "refusals"
MARK = "# refused: "
REFUSING = "refused", "NoTranslation"
"""Names of what makes a refusal."""
Told = tuple[int, str]
"""A line and what is told of it."""


def expected(file: Path) -> list[Told]:
    """What the comments of a file say."""
    found: list[Told] = []
    waiting: list[str] = []
    for number, line in enumerate(file.read_text("utf-8").splitlines(), 1):
        if line.strip().startswith(MARK):
            waiting.append(line.strip().removeprefix(MARK))
        else:
            found += [(number, text) for text in waiting]
            waiting = []
    return sorted(found)


def told(file: Path, rig: Rig) -> list[Told]:
    """What umo tells of the program of a file. AssertionError where it is told of another file."""
    program = program_of(file)(rig)
    problems = translate(rig, [], [program.control], HOST).problems
    assert all(each.file == f"refusals/{file.name}" for each in problems), problems
    return sorted((each.line, f"{each.reason}; {each.nearest}" if each.nearest else each.reason) for each in problems)


def program_of(file: Path) -> Any:
    name = f"refusals.{file.stem}"
    spec = importlib.util.spec_from_file_location(name, file)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    kinds = [each for each in vars(module).values() if isinstance(each, type) and each.__module__ == name]
    return kinds[-1]


def places() -> Iterator[tuple[str, int]]:
    """Every place of the lowering that refuses something: file and line."""
    for file in sorted(Path(room.__path__[0]).glob("*.py")):
        for node in ast.walk(ast.parse(file.read_text("utf-8"))):
            if isinstance(node, ast.Call) and len(node.args) > 1:
                func = node.func
                name = func.attr if isinstance(func, ast.Attribute) else getattr(func, "id", "")
                if name in REFUSING and file.name != "function_builder.py":
                    yield file.name, node.lineno


class Reached:
    """The places that have refused something."""

    def __init__(self, patch: Any) -> None:
        self.places: set[tuple[str, int]] = set()
        made = NoTranslation.__init__

        def init(error: NoTranslation, *given: Any) -> None:
            made(error, *given)
            frame: Any = sys._getframe(1)
            if frame.f_code is FunctionBuilder.refused.__code__:
                frame = frame.f_back
            self.places.add((Path(frame.f_code.co_filename).name, frame.f_lineno))

        patch.setattr(NoTranslation, "__init__", init)
