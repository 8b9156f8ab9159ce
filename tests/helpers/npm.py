"""Packages of npm for the tests, installed once into the cache folder of this user."""

from __future__ import annotations

import os
import shutil
import subprocess
import zlib
from functools import cache
from pathlib import Path

import pytest

from helpers.alone import alone


def modules(folder: Path) -> Path:
    """The folder node_modules with what the package-lock.json of a folder names; the test is skipped without it."""
    found = _installed(folder)
    if isinstance(found, str):
        pytest.skip(found)
    return found


@cache
def _installed(folder: Path) -> Path | str:
    npm = shutil.which("npm")
    if npm is None or shutil.which("node") is None:
        return "the tests with clients of npm need node and npm"
    lock = (folder / "package-lock.json").read_bytes()
    place = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "umo" / f"faces-{zlib.crc32(lock):x}"
    with alone(place):
        if not (place / "installed").exists():
            place.mkdir(exist_ok=True)
            for name in ("package.json", "package-lock.json"):
                shutil.copy(folder / name, place)
            command = [npm, "ci", "--no-audit", "--no-fund", "--silent", "--ignore-scripts"]
            if subprocess.run(command, cwd=place, capture_output=True, check=False).returncode:
                return f"tests with clients of npm need the packages of {folder.name}/package.json: npm cannot get them"
            (place / "installed").touch()
    return place / "node_modules"
