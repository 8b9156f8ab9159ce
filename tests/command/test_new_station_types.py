"""`umo new station` writes settings with which mypy and pyright find what types can find of a beginner's mistakes."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from umo_command.new.templates import make_station

SOURCE = Path(__file__).parents[1].parent / "src"
MISTAKES = """

async def wrong(m: Tank) -> None:
    wait("1 s")  # E: nobody awaits it
    m.fill(300.0)  # E: nor this
    m.tagret = 100.0  # E: no such attribute
    m.regulator.lw = 3.0  # E: nor in a law
    print(m.lvel)  # E: nor where it is read
    m.inlet.wirte(OpenClosed.OPEN)  # E: nor of an object
    m.inlet.write(PassFail.PASS)  # E: a state of another type
    m.inlet.write(1)  # E: a number is no state
    if state_of(m.overflow) is OpenClosed.OPEN:  # E: a state of another type
        pass
    if m.inlet.read() == 1:  # E: a number
        pass
    if m.overflow.read() == "pass":  # E: a text
        pass
    if m.overflow.read() in (OpenClosed.OPEN, OpenClosed.CLOSED):  # T: states of another type
        pass
    if m.inlet == 1:  # E: an object
        pass
    if m.inlet is OpenClosed.OPEN:  # E: an object
        pass
    if m.level > 3:  # E: an object
        pass
    if m.overflow.read is PassFail.PASS:  # T: it is not called
        pass
    await until(m.overflow)  # E: an object is no condition
    await until(value_of(m.level) > 3.0)  # E: worked out once
    m.cycle.start(m.fill)  # E: it is not called
    m.inlet = OpenClosed.OPEN  # E: a part cannot be replaced
    m.level.units = "cm"  # E: it cannot be set
    if m.overflow:  # T: always true
        pass
    if m.overflow.read:  # T: always true
        pass
    if m.overflow.read():  # T: a state has no truth value
        pass


async def untyped(m):  # E: nothing of m would be looked at
    m.tagret = 100.0
"""
"""E: an error of both checkers; T: of mypy."""


def station(folder: Path, name: str, mistakes: str = "") -> Path:
    made = folder / name
    make_station(made)
    if mistakes:
        file = made / "application.py"
        text = file.read_text("utf-8").replace("import wait\n", "import state_of, until, value_of, wait\n")
        file.write_text(f"from umo.states import OpenClosed, PassFail\n{text}{mistakes}", "utf-8")
    return made


def mypy(folder: Path) -> list[tuple[str, int]]:
    """File and line of each error, found by `mypy` in the folder of the station."""
    command = [sys.executable, "-m", "mypy", "--no-error-summary", f"--cache-dir={os.devnull}"]
    environment = {**os.environ, "MYPYPATH": str(SOURCE)}
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, env=environment, check=False)
    assert done.returncode in (0, 1), done.stdout + done.stderr
    return [(file, int(line)) for file, line in re.findall(r"^(\S+\.py):(\d+): error", done.stdout, re.MULTILINE)]


def pyright(folder: Path) -> list[tuple[str, int]]:
    command = [sys.executable, "-m", "pyright", "--outputjson", "--pythonpath", sys.executable]
    try:
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=300, check=False)
        report = json.loads(done.stdout)["generalDiagnostics"]
    except (OSError, ValueError, KeyError, subprocess.TimeoutExpired) as error:
        pytest.skip(f"pyright cannot start here (it fetches its npm package at first use): {error}")
    errors = [each for each in report if each["severity"] == "error"]
    return [(Path(each["file"]).name, each["range"]["start"]["line"] + 1) for each in errors]


def marked(folder: Path, marks: str) -> set[tuple[str, int]]:
    lines = (folder / "application.py").read_text("utf-8").splitlines()
    return {("application.py", n) for n, text in enumerate(lines, 1) if re.search(f"# [{marks}]: ", text)}


def test_the_settings_name_the_folder_whatever_it_is_called(tmp_path: Path) -> None:
    for name in ("tank", "my-machine", "größe"):
        text = (station(tmp_path, name) / "pyproject.toml").read_text("utf-8")
        assert tomllib.loads(text)["tool"]["mypy"]["packages"] == [name]


@pytest.mark.full
@pytest.mark.parametrize("name", ["tank", "my-machine"])
def test_a_new_station_has_no_error_of_mypy(tmp_path: Path, name: str) -> None:
    assert mypy(station(tmp_path, name)) == []


@pytest.mark.full
def test_mypy_finds_each_planted_mistake_and_nothing_else(tmp_path: Path) -> None:
    folder = station(tmp_path, "my-machine", MISTAKES)
    assert set(mypy(folder)) == marked(folder, "ET")


@pytest.mark.full
def test_a_new_station_has_no_error_of_pyright(tmp_path: Path) -> None:
    assert pyright(station(tmp_path, "my-machine")) == []


@pytest.mark.full
def test_pyright_finds_each_planted_mistake_and_nothing_else(tmp_path: Path) -> None:
    folder = station(tmp_path, "my-machine", MISTAKES)
    found = set(pyright(folder))
    assert marked(folder, "E") <= found <= marked(folder, "ET")
