"""One meaning for each name in the tree, and no circle of imports."""

from __future__ import annotations

import ast
from collections import defaultdict
from pathlib import Path

import umo

TREE = Path(umo.__file__).parent
SHOWN_TO_THE_OBJECTS = TREE / "objects" / "link.py"
"""Protocols of what lies above, under the names that those things have."""
ROLES = {"__init__", "application", "control", "objects", "plant", "run", "errors", "driver", "channel", "twin"}
"""Modules with one part in many places: a station's files, a driver's, a command of the command line, its errors."""
ROLES_OF_CLASSES = {"Plant"}
"""Each station's own."""


def modules() -> list[Path]:
    return [file for file in sorted(TREE.rglob("*.py")) if "template" not in file.parts]


def test_no_two_modules_have_one_name() -> None:
    found = defaultdict(list)
    for file in modules():
        found[file.stem].append(str(file.relative_to(TREE)))
    assert {name: files for name, files in found.items() if len(files) > 1 and name not in ROLES} == {}


def test_no_two_classes_or_types_have_one_name() -> None:
    found = defaultdict(list)
    for file in modules():
        if file == SHOWN_TO_THE_OBJECTS:
            continue
        for node in ast.parse(file.read_text()).body:
            names = [node.name] if isinstance(node, ast.ClassDef) else []
            if isinstance(node, ast.Assign):
                names = [each.id for each in node.targets if isinstance(each, ast.Name) and each.id[1:].islower()]
                names = [name for name in names if name[0].isupper() and len(name) > 1]
            for name in (each for each in names if not each.startswith("_") and each not in ROLES_OF_CLASSES):
                found[name].append(str(file.relative_to(TREE)))
    assert {name: files for name, files in found.items() if len(files) > 1} == {}


def test_nothing_in_the_package_imports_the_package_itself() -> None:
    """`umo/__init__.py` imports the others: it would be a circle."""
    stations = TREE / "stations"
    for file in modules():
        if stations in file.parents or file.parent == TREE / "cli":
            continue
        for node in ast.walk(ast.parse(file.read_text())):
            assert not (isinstance(node, ast.Import) and any(each.name == "umo" for each in node.names)), file
            assert not (isinstance(node, ast.ImportFrom) and node.module == "umo"), file
