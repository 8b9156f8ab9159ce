"""The code that README, docs and docstrings show, as modules that `umo check` can look at: their imports and
definitions are carried out, nothing else."""

from __future__ import annotations

import ast
import inspect
import re
import sys
import textwrap
from collections.abc import Iterator
from contextlib import suppress
from inspect import CO_COROUTINE
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

import umo
import umo.control
import umo.states
from helpers.documents import PAGES, ROOT, blocks
from helpers.own_modules import SRC, own_modules
from umo import Compound

DOCSTRING = re.compile(r'"""(.*?)"""', re.S)
DEFINITIONS = (ast.Import, ast.ImportFrom, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)


def pages(folder: Path) -> Iterator[ModuleType]:
    """One of each page that shows Python: its blocks, one below the other."""
    for page in PAGES:
        name = "_".join(page.relative_to(ROOT).with_suffix("").parts).replace("-", "_")
        if shown := [text for _, text in blocks(page, "python")]:
            yield _module(folder / f"{name}.py", "\n".join(shown), {})


def docstrings(folder: Path) -> Iterator[ModuleType]:
    """One of each module of umo whose docstrings have examples. Those know what umo exports, and their own module if
    something has imported it."""
    for file in own_modules().values():
        if "stations" in file.parts:
            continue  # they are looked at as stations
        code = file.read_text("utf-8")
        indented = any("\n    " in inspect.cleandoc(text) for text in DOCSTRING.findall(code) if "\n\n" in text)
        if indented and (examples := list(_examples(ast.parse(code)))):
            name = ".".join(file.relative_to(SRC).with_suffix("").parts).removesuffix(".__init__")
            known = {key: value for each in (umo, umo.control, umo.states) for key, value in vars(each).items()}
            known |= vars(sys.modules.get(name, umo))
            yield _module(folder / f"{name.replace('.', '_')}.py", "\n\n".join(examples), known)


def _examples(node: Any) -> Iterator[str]:
    """The indented lines of the docstrings in a module, class or function that are Python and call something."""
    for part in _indented((ast.get_docstring(node) or "").splitlines()):
        with suppress(SyntaxError):
            if any(isinstance(each, ast.Call) for each in ast.walk(ast.parse(part))):
                yield part
    for inner in node.body:
        if isinstance(inner, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            yield from _examples(inner)


def _indented(lines: list[str]) -> Iterator[str]:
    found: list[str] = []
    for line in [*lines, "end"]:
        if line.startswith("    ") or (found and not line.strip()):
            found.append(line)
        elif found:
            yield textwrap.dedent("\n".join(found)).strip()
            found = []


def machine_of(module: ModuleType) -> Compound | None:
    """The machine that a function of the module makes without arguments; None: it has none."""
    functions = [each for each in vars(module).values() if isinstance(each, FunctionType)]
    for each in functions:
        if each.__module__ == module.__name__ and not each.__code__.co_flags & CO_COROUTINE:
            with suppress(Exception):
                if isinstance(found := each(), Compound):
                    return found
    return None


def _module(file: Path, text: str, known: dict[str, object]) -> ModuleType:
    module = ModuleType(file.stem)
    module.__file__ = str(file)
    file.write_text(text)
    module.__dict__.update({key: value for key, value in known.items() if not key.startswith("__")})
    sys.modules[file.stem] = module  # annotations are resolved there
    for node in ast.parse(text).body:
        if isinstance(node, DEFINITIONS):
            with suppress(Exception):  # it needs what was not carried out, or shows what is refused
                exec(compile(ast.Module([node], []), str(file), "exec", dont_inherit=True), module.__dict__)
    return module
