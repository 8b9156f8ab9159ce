"""Environments of Python for other projects' programs, made once in the cache folder of this user."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import zlib
from functools import cache
from pathlib import Path

import pytest

from helpers.alone import alone


def foreign_python(requirements: Path, what: str) -> str:
    """The Python of an environment that has them. Skips the test if pip cannot get `what`."""
    python = _installed(requirements)
    if python is None:
        pytest.skip(f"pip cannot install {what} of tests/{requirements.relative_to(Path(__file__).parents[1])}")
    return str(python)


@cache
def _installed(requirements: Path) -> Path | None:
    text = requirements.read_text()
    top = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    place = top / "umo" / f"faces-{zlib.crc32(f'{sys.version_info[:2]} {text}'.encode()):08x}"
    python = place / "bin" / "python"
    with alone(place):
        if not (place / "installed").exists():
            made = subprocess.run([sys.executable, "-m", "venv", str(place)], capture_output=True)
            command = [str(python), "-m", "pip", "install", "-q", "-r", str(requirements)]
            if made.returncode or subprocess.run(command, capture_output=True).returncode:
                shutil.rmtree(place, ignore_errors=True)
                return None
            (place / "installed").touch()
    return python
