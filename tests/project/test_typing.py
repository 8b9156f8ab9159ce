"""mypy --strict and pyright on the snippets in tests/typing: an editor completes the tree, mistakes are marked."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

from helpers.machines import actuator
from helpers.tiers import first, named
from umo import BinaryActuator, Compound, DigitalActuator, connect
from umo.errors import DeclarationError, RangeError
from umo.states import OnOff, PassFail
from umo_command.new.templates import make_station

HERE = Path(__file__).parents[1] / "typing"
SOURCE = Path(__file__).parents[1].parent / "src"
FILES = ("good.py", "bad.py")

Finding = tuple[str, int, str, str]
"""File, line, severity, message."""


def marked(name: str, mark: str) -> dict[int, str]:
    lines = (HERE / name).read_text().splitlines()
    return {n: text.partition(f"# {mark}: ")[2] for n, text in enumerate(lines, 1) if f"# {mark}: " in text}


@cache
def mypy() -> list[Finding]:
    fresh = f"--cache-dir={os.devnull}"  # mypy crashed over a cache from before a refactoring
    command = [sys.executable, "-m", "mypy", "--strict", "--no-error-summary", fresh, "--config-file=", *FILES]
    done = subprocess.run(command, cwd=HERE, capture_output=True, text=True, env={"MYPYPATH": str(SOURCE)}, check=False)
    assert done.returncode in (0, 1), done.stdout + done.stderr
    found = re.findall(r"^(\w+\.py):(\d+): (\w+): (.*)$", done.stdout, re.MULTILINE)
    return [(file, int(line), severity, message) for file, line, severity, message in found]


@cache
def pyright() -> list[Finding]:
    try:
        command = [sys.executable, "-m", "pyright", "--outputjson", "--pythonpath", sys.executable, *FILES]
        done = subprocess.run(command, cwd=HERE, capture_output=True, text=True, timeout=300, check=False)
        report = json.loads(done.stdout)["generalDiagnostics"]
    except (OSError, ValueError, KeyError, subprocess.TimeoutExpired) as error:
        pytest.skip(f"pyright cannot start here (it fetches its npm package at first use): {error}")
    return [
        (Path(d["file"]).name, d["range"]["start"]["line"] + 1, d["severity"], d["message"].partition("\n")[0])
        for d in report
    ]


CHECKERS = pytest.mark.parametrize("checker", first(1, named(["pyright", "mypy"], [pyright, mypy])))


@CHECKERS
def test_the_good_file_passes(checker):
    assert [f for f in checker() if f[0] == "good.py" and f[2] == "error"] == []


@CHECKERS
def test_an_editor_knows_the_type_of_every_part(checker):
    shown = {}
    for file, line, _, message in checker():
        if match := re.search(r'(?:Revealed type is|Type of ".*" is) "(.*)"$', message):
            shown[line] = re.sub(r"\b(?:\w+\.)+|builtins\.", "", match[1])
            assert file == "good.py"
    assert shown == marked("good.py", "R")


@CHECKERS
def test_each_mistake_is_marked_at_its_line_and_no_other_line_is(checker):
    lines = {line for file, line, severity, _ in checker() if file == "bad.py" and severity == "error"}
    expected = set(marked("bad.py", "E"))
    assert sorted(expected - lines) == [], "not found"
    assert sorted(lines - expected) == [], "not expected"


def test_what_neither_checker_finds_is_found_at_run_time():
    class Machine(Compound):
        motor: DigitalActuator

    with connect(Machine(motor=actuator())) as m, pytest.raises(RangeError, match="True is not a number"):
        m.motor.write(True)
    with pytest.raises(DeclarationError, match="is not a state of OnOff"):
        BinaryActuator(OnOff, one=OnOff.ON, default=PassFail.PASS)


@pytest.mark.full
def test_a_new_station_and_its_tests_pass_pyright(tmp_path: Path) -> None:
    make_station(tmp_path / "tank")
    command = [sys.executable, "-m", "pyright", "--outputjson", "--pythonpath", sys.executable, "tank"]
    try:
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=300, check=False)
        report = json.loads(done.stdout)
    except (OSError, ValueError, subprocess.TimeoutExpired) as error:
        pytest.skip(f"pyright cannot start here (it fetches its npm package at first use): {error}")
    assert [(Path(d["file"]).name, d["message"]) for d in report["generalDiagnostics"]] == []
    assert report["summary"]["filesAnalyzed"] >= 5
