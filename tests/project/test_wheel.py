"""One wheel serves every version of Python from 3.11 on."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from shutil import copytree, ignore_patterns, which

import pytest

from helpers.conversions import BUILT

TREE = Path(__file__).parents[2]
ASKED = "import sys; print(*sys.version_info[:2], sys.executable)"
BUILT_IN = "from umo.cycle.conversion import is_built; assert is_built()"
pytestmark = [pytest.mark.full, BUILT]


def others() -> Iterator[str]:
    """Other Pythons of this computer, from 3.12 on."""
    for minor in range(12, 20):
        found = [which(f"python3.{minor}"), *Path.home().glob(f".pyenv/versions/3.{minor}.*/bin/python")]
        for python in filter(None, found):
            asked = subprocess.run([str(python), "-c", ASKED], capture_output=True, text=True)
            if asked.returncode == 0:
                yield str(python)
                break


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    copytree(TREE, folder / "tree", ignore=ignore_patterns(".git", ".venv", "*.so", "build", "runs", "site", "tests"))
    command = [sys.executable, "-m", "build", "--wheel", "--outdir", str(folder), str(folder / "tree")]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return next(folder.glob("*.whl"))


def test_its_binary_uses_the_stable_interface_only(wheel: Path) -> None:
    assert "-cp311-abi3-" in wheel.name
    done = subprocess.run([sys.executable, "-m", "abi3audit", "--strict", str(wheel)], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize("python", list(others()))
def test_it_runs_on_other_versions(python: str, wheel: Path, tmp_path: Path) -> None:
    for command in (
        [python, "-m", "venv", str(tmp_path)],
        [str(tmp_path / "bin" / "python"), "-m", "pip", "install", "--quiet", str(wheel)],
        [str(tmp_path / "bin" / "python"), "-c", BUILT_IN],
        [str(tmp_path / "bin" / "umo"), "run", "conveyor", "--parts", "1"],
    ):
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
        assert done.returncode == 0, f"{command}: {done.stdout + done.stderr}"
