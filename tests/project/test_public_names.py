"""What the packages export."""

from __future__ import annotations

import importlib
import inspect
import re
import subprocess
import sys
from pathlib import Path

import pytest

import umo
from umo import errors

ROOT = Path(umo.__file__).parent
PACKAGES = [
    ".".join(file.parent.relative_to(ROOT).parts)
    for file in sorted(ROOT.glob("*/**/__init__.py"))
    if "__all__" in file.read_text()
]
CLASSES = {name for name, item in vars(errors).items() if inspect.isclass(item) and item.__module__ == errors.__name__}
ERRORS = {name for name in CLASSES if not name.startswith("_")}


@pytest.mark.parametrize("package", ["umo", *(f"umo.{name}" for name in PACKAGES)])
def test_what_a_package_says_that_it_exports_is_there(package):
    module = importlib.import_module(package)
    assert all(hasattr(module, name) for name in module.__all__)


def test_umo_itself_has_what_every_program_needs_and_the_rest_a_module_each():
    assert len(umo.__all__) <= 30
    assert ERRORS & set(umo.__all__) == {"TaskFailed", "UmoError"}


def test_the_hierarchy_drawn_at_the_top_of_errors_is_the_real_one():
    parents, left = ["UmoError"], set(ERRORS)
    for depth, name, beside in re.findall(r"^((?:\|   )*)[|`]-- (\w+)(?: \((\w+)\))?", errors.__doc__ or "", re.M):
        del parents[1 + len(depth) // 4 :]
        bases = [base.__name__ for base in getattr(errors, name).__bases__]
        assert bases == [parents[-1], *([beside] if beside else [])]
        parents.append(name)
        left.discard(name)
    assert {"UmoError", "Cancelled", "Interrupted", "Failure", "Mistake"} == left
    assert issubclass(umo.errors.Interrupted, KeyboardInterrupt)
    assert issubclass(umo.errors.Cancelled, BaseException) and not issubclass(umo.errors.Cancelled, Exception)


def test_the_help_of_a_command_waits_for_no_machine() -> None:
    code = "import sys, umo_command.app; sys.exit(any(name in sys.modules for name in ('numpy', 'umo.cycle.connect')))"
    subprocess.run([sys.executable, "-c", code], check=True)
