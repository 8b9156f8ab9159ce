"""`make test CHANGED=1`: which modules of tests a change can reach."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from tools.changed import changed, reached

PROJECT = """
[project.entry-points."umo.drivers"]
counter = "umo.drivers.counter:Counter"
"""
FILES = {
    "pyproject.toml": PROJECT,
    "src/umo/__init__.py": "",
    "src/umo/errors.py": "",
    "src/umo/control/__init__.py": "",
    "src/umo/control/pid.py": "from umo.errors import UmoError",
    "src/umo/drivers/__init__.py": "",
    "src/umo/drivers/counter.py": "def read():\n    from ..control import pid",
    "src/umo/process/__init__.py": "",
    "src/umo/process/__main__.py": "import umo.process.guardian",
    "src/umo/process/guardian.py": "",
    "src/umo/stations/__init__.py": "",
    "src/umo/stations/oven/objects.py": "",
    "src/umo_command/__init__.py": "",
    "src/umo_command/show.py": "",
    "tests/conftest.py": "import pytest, umo_command.show\n\n@pytest.fixture\ndef shown(): ...",
    "tests/helpers/__init__.py": "",
    "tests/helpers/rig.py": "from umo.control import pid",
    "tests/rooms/test_imports.py": "from helpers import rig",
    "tests/rooms/test_attribute.py": "import umo\numo.control.pid",
    "tests/rooms/test_driver.py": """TABLE = '[drivers.a] type = "counter"'""",
    "tests/rooms/test_program.py": "WORDS = ['python', '-m', 'umo.process']",
    "tests/rooms/test_command.py": "LINE = 'umo show oven'",
    "tests/rooms/test_fixture.py": "def test_it(shown): ...",
    "tests/rooms/test_alone.py": '"As umo show oven."',
    "tests/rooms/test_sources.py": "FILES = '*.py'",
    "tests/project/test_pages.py": "",
}
ALWAYS = {"pages", "sources"}


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    return tmp_path


@pytest.mark.parametrize(
    ("file", "expected"),
    [
        ("src/umo/errors.py", {"imports", "attribute", "driver"}),
        ("src/umo/drivers/counter.py", {"driver"}),
        ("src/umo/process/guardian.py", {"program"}),
        ("src/umo/stations/oven/objects.py", {"command"}),
        ("src/umo_command/show.py", {"command", "fixture"}),
        ("tests/helpers/rig.py", {"imports"}),
        ("tests/rooms/test_alone.py", {"alone"}),
    ],
)
def test_a_change_reaches_what_imports_or_names_it(tree: Path, file: str, expected: set[str]) -> None:
    found, why = reached(tree, [file])
    assert {Path(each).stem.removeprefix("test_") for each in found} == expected | ALWAYS
    assert why.startswith(f"{len(found)} of 9 modules")


@pytest.mark.parametrize("file", ["pyproject.toml", "docs/page.md", "tests/conftest.py", "src/umo/gone.py"])
def test_what_no_import_shows_reaches_all_tests(tree: Path, file: str) -> None:
    assert reached(tree, ["src/umo/errors.py", file]) == (["tests"], f"all modules, as {file} has changed")


def test_without_a_change_nothing_is_run(tree: Path) -> None:
    assert reached(tree, [])[0] == []


def test_what_differs_from_a_commit_has_changed_and_what_git_does_not_know(tree: Path) -> None:
    def git(*words: str) -> None:
        name = ("-c", "user.name=A test", "-c", "user.email=test@localhost")
        subprocess.run(["git", *name, *words], cwd=tree, check=True, capture_output=True)

    git("init")
    git("add", ".")
    git("commit", "-m", "all")
    (tree / "src/umo/errors.py").write_text("A = 1")
    (tree / "src/umo/control/pid.py").rename(tree / "src/umo/control/law.py")
    assert changed(tree, "HEAD") == ["src/umo/control/law.py", "src/umo/control/pid.py", "src/umo/errors.py"]
