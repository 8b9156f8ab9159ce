"""Faults that are planted in umo, to see which are found: a text becomes another one, in a file of a copy of umo, or in
a function of this process.

`tools.fuzz.mutants` has those of the translator, `tools.schedules.planted` those of the stop,
`tools.message_orders.planted` those of a link and a fleet.
"""

from __future__ import annotations

import inspect
import os
import shutil
import subprocess
import sys
import textwrap
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

ROOT = Path(__file__).parents[1]


@dataclass(frozen=True)
class PlantedFault:
    """A fault: `text` of a file of `ROOM` becomes `wrong`."""

    ROOM: ClassVar[str] = "src/umo"

    what: str
    file: str
    text: str
    wrong: str
    layer: str = ""
    """What covers it, in words; "": it is found by itself."""
    also: Sequence[str] = ()
    """The faults that are planted with it, by what they are: those layers."""
    by: str = ""
    """A schedule that finds it, which is tried first."""

    def place(self, tree: Path = ROOT) -> Path:
        """The file; ValueError if it does not contain the text of this fault exactly once."""
        path = tree / self.ROOM / self.file
        if (count := path.read_text("utf-8").count(self.text)) != 1:
            raise ValueError(f"{self.what}: {self.text!r} is {count} times in {self.file}")
        return path

    def line(self, is_found: bool, said: str) -> str:
        """What came of it; with what covers it, where it was not found."""
        covered = f"\n       covered: {self.layer}" if self.layer and not is_found else ""
        return f"{'found ' if is_found else 'MISSED'} {self.what}: {said}{covered}"


def copied(tree: Path) -> Path:
    """The folder `tree`, with a copy of umo, its tools, and its bench, which tools use."""
    for part in ("src", "tools", "bench"):
        shutil.copytree(ROOT / part, tree / part, ignore=shutil.ignore_patterns("__pycache__"))
    return tree


@contextmanager
def planted(faults: Sequence[PlantedFault], tree: Path) -> Iterator[None]:
    """These faults are in the copy meanwhile."""
    before: dict[Path, str] = {}
    try:
        for each in faults:
            file = each.place(tree)
            text = file.read_text("utf-8")
            before.setdefault(file, text)
            file.write_text(text.replace(each.text, each.wrong), "utf-8")
        yield
    finally:
        for file, text in before.items():
            file.write_text(text, "utf-8")


def played_with(
    faults: Sequence[PlantedFault], tree: Path, timeout: float, *words: str
) -> subprocess.CompletedProcess[str]:
    """`python -m` these words in the copy while these faults are in it. TimeoutExpired after so many s."""
    path = os.pathsep.join([str(tree / "src"), str(tree)])
    with planted(faults, tree):
        return subprocess.run(
            [sys.executable, "-m", *words], cwd=tree, env=os.environ | {"PYTHONPATH": path}, capture_output=True,
            text=True, check=False, timeout=timeout,
        )  # fmt: skip


class Edit:
    """Other texts in a function or property of a class or a module: each pair is a text that it contains once, and the
    text that takes its place."""

    def __init__(self, owner: Any, name: str, *texts: tuple[str, str]) -> None:
        self.owner, self.name, self.texts = owner, name, texts


def function_with(owner: Any, text: str) -> str:
    """The name of the function of a class, or of a module, that contains this text. AssertionError if it is not one."""
    module = owner.__name__ if inspect.ismodule(owner) else owner.__module__
    own = {name: each for name, each in vars(owner).items() if inspect.isfunction(each) and each.__module__ == module}
    found = [name for name, each in own.items() if text in textwrap.dedent(inspect.getsource(each))]
    assert len(found) == 1, f"{text!r} is in {len(found)} functions of {owner.__name__}"
    return found[0]


def changed(edit: Edit) -> Any:
    """The function or property with these texts. AssertionError if a text that is to be replaced is not there once."""
    known: Any = inspect.getattr_static(edit.owner, edit.name)
    function: Any = known.fget if isinstance(known, property) else known
    source = textwrap.dedent(inspect.getsource(function))
    for old, new in edit.texts:
        assert source.count(old) == 1, f"{edit.name} no longer has {old!r}"
        source = source.replace(old, new)
    found: dict[str, Any] = {}
    exec(compile(source, "<mutant>", "exec"), function.__globals__, found)
    return found[edit.name]


@contextmanager
def edited(edits: Sequence[Edit]) -> Iterator[None]:
    """The functions have these texts meanwhile. AssertionError if a text that is to be replaced is not there once."""
    with ExitStack() as stack:
        for edit in edits:
            stack.callback(setattr, edit.owner, edit.name, inspect.getattr_static(edit.owner, edit.name))
            setattr(edit.owner, edit.name, changed(edit))
        yield
