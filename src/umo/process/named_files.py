"""The files that the code of a station names and may read later: modules that a function imports, and data files whose
names are strings in the code.

The code is read, not run. Names that the code composes, and folders that it searches, are not found.
"""

from __future__ import annotations

import ast
from collections.abc import Iterable, Iterator
from os.path import isfile
from pathlib import Path

MAX_NAME = 200
"""The largest number of characters of a string that is examined as the name of a file."""


def named_files(modules: Iterable[str], folder: Path) -> list[str]:
    """Return the files of a folder, by absolute path, that these modules of the folder name or import, without the
    given modules themselves."""
    given = {Path(each) for each in modules}
    found, waiting = set[Path](), [each for each in given if each.suffix == ".py" and each.is_relative_to(folder)]
    while waiting:
        for file in _named_in(waiting.pop(), folder) - given - found:
            found.add(file)
            if file.suffix == ".py":
                waiting.append(file)
    return sorted(map(str, found))


def _named_in(module: Path, folder: Path) -> set[Path]:
    try:
        tree = ast.parse(module.read_bytes())
    except (OSError, SyntaxError, ValueError, RecursionError):
        return set()
    wanted = (path for node in ast.walk(tree) for path in _candidates(node, module.parent, folder))
    there = (each.resolve() for each in wanted if isfile(each))  # `Path.is_file` raises without the permission to look
    return {path for path in there if path.is_relative_to(folder)}


def _candidates(node: ast.AST, beside: Path, folder: Path) -> Iterator[Path]:
    """Yield the possible paths of a file that this part of the code names."""
    match node:
        case ast.Constant(value=str() as text) if "." in text and len(text) < MAX_NAME and text.isprintable():
            yield from (beside / text, folder / text)
        case ast.Import(names=names):
            for each in names:
                yield from _modules(folder, each.name)
        case ast.ImportFrom(module=module, names=names, level=level):
            base = beside.joinpath(*[".."] * (level - 1)) if level else folder
            for name in (module or "", *(f"{module or ''}.{each.name}" for each in names)):
                yield from _modules(base, name.strip("."))


def _modules(base: Path, name: str) -> Iterator[Path]:
    if name and "*" not in name:
        place = base.joinpath(*name.split("."))
        yield from (place.with_name(f"{place.name}.py"), place / "__init__.py")
