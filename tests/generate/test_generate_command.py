"""`umo new controller`: a folder that compiles, or everything that is in the way."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import Result

from helpers.generating import needs_a_compiler
from umo.generate.lower.lowered_branches import LoweredBranches

Umo = Callable[..., Result]
STATION = """
from dataclasses import dataclass
from umo import BinaryActuator, Compound, DigitalActuator, DigitalSensor
from umo.states import OnOff

class Pump(Compound):
    level: DigitalSensor
    motor: DigitalActuator
    valve: BinaryActuator[OnOff]
    timer: DigitalSensor

    def setup(self):
        self.seen = dict()
        self.phase = ""

    def control(self):
CONTROL

def machine() -> Pump:
    def sensor(**changes):
        return DigitalSensor("mm", minimum=0, maximum=100, resolution=0.1, **changes)
    return Pump(
        level=sensor(),
        motor=DigitalActuator("V", default=0, minimum=0, maximum=10, resolution=0.01, limits="clamp"),
        valve=BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF),
        timer=DigitalSensor("sampling_period", minimum=0, maximum=1000, resolution=1, synchronous=False),
    )
"""
WIRING = """
[drivers.box]
type = "umo.testing:Scripted"
[drivers.clock]
type = "umo.testing:VirtualTimer"
[wire]
level = { driver = "box" }
motor = { driver = "box" }
valve = { driver = "box" }
timer = { driver = "clock", period = "10 ms" }
"""
GOOD = "        self.motor.write(10.0 - self.level.read() / 10.0)\n"
BAD = """\
        self.seen[1] = self.level.read()
        for name in sorted(self.seen):
            print(name)
        import time
        if time.time() > 3.0:
            self.motor.write(float("1.5"))
        if self.phase == f"{self.level}":
            self.valve.write(OnOff.ON)
"""


def station(folder: Path, control: str) -> Path:
    (folder / "wiring").mkdir(parents=True)
    (folder / "objects.py").write_text(STATION.replace("CONTROL", control.rstrip()))
    (folder / "application.py").write_text("async def main(m):\n    pass\n")
    (folder / "wiring" / "simulated.toml").write_text(WIRING)
    return folder


@pytest.fixture
def good(tmp_path: Path) -> Path:
    return station(tmp_path / "pump", GOOD)


@needs_a_compiler
def test_the_folder_of_the_host_compiles_and_runs_periods_of_text(good: Path, tmp_path: Path, umo: Umo) -> None:
    result = umo("new", "controller", str(good), "--target", "host", "-o", str(tmp_path / "c"))
    assert (result.exit_code, result.stderr) == (0, "")
    if shutil.which("make") is None:
        pytest.skip("make is not there")
    subprocess.run(["make", "-s", "-C", tmp_path / "c"], check=True)
    done = subprocess.run(
        [tmp_path / "c" / "machine"], input="0 0\n1 0\n1 500\n1 1000\n", capture_output=True, text=True
    )
    assert [line.split()[0] for line in done.stdout.splitlines()] == ["0", "1000", "500", "0"]


def test_everything_that_does_not_translate_is_told_with_its_line_and_nothing_is_written(
    tmp_path: Path, umo: Umo
) -> None:
    folder = station(tmp_path / "pump", BAD)
    result = umo("new", "controller", str(folder), "--target", "host", "-o", str(tmp_path / "c"))
    lines = result.stderr.splitlines()
    assert result.exit_code == 2 and not (tmp_path / "c").exists()
    assert lines[0] == "Pump cannot be generated:"
    for place, said in (
        (":17: self.seen[1]", "an element of something that is not a list or an array in C"),
        (":21: time.time", "cannot be translated"),
        (":23: self.phase", "a string that is made at run time"),
    ):
        assert any(place in line and said in line for line in lines), (place, result.stderr)
    assert {int(line.split(":")[1]) for line in lines[1:]} == {17, 18, 21, 23}


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--target", "arm"], "no target 'arm'"),
        (["--target", "avr", "--real", "double"], "the target avr has no doubles"),
        (["--target", "host", "--real", "half"], "--real half is neither double nor float"),
    ],
)
def test_a_target_or_numbers_that_there_are_not_are_told_in_a_line(
    good: Path, tmp_path: Path, umo: Umo, arguments: list[str], said: str
) -> None:
    result = umo("new", "controller", str(good), "-o", str(tmp_path / "c"), *arguments)
    assert result.exit_code == 2 and len(result.stderr.splitlines()) == 1 and said in result.stderr


def test_what_fails_in_the_translation_itself_is_told_with_its_line(
    good: Path, tmp_path: Path, umo: Umo, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: object) -> None:
        raise KeyError("nobody thought of it")

    monkeypatch.setattr(LoweredBranches, "lower_expr", fails)
    result = umo("new", "controller", str(good), "--target", "host", "-o", str(tmp_path / "c"))
    assert result.exit_code == 2
    assert ":17: self.motor.write" in result.stderr and "it cannot be translated (KeyError: 'nobody" in result.stderr


def test_a_table_that_the_target_does_not_hold_is_told_in_a_line(tmp_path: Path, umo: Umo) -> None:
    result = umo("new", "controller", "furnace", "--target", "avr", "-o", str(tmp_path / "c"))
    assert result.exit_code == 2 and not (tmp_path / "c").exists()
    head, *lines = result.stderr.splitlines()
    assert head.endswith("cannot be generated:") and len(lines) == 1
    assert "the table of thermocouple K has" in lines[0] and "avr allows at most 32767; a LookupTable" in lines[0]


@pytest.mark.full
def test_objects_of_one_linearization_share_its_table(tmp_path: Path, umo: Umo) -> None:
    assert umo("new", "controller", "furnace", "--target", "cortex-m", "-o", str(tmp_path / "c")).exit_code == 0
    source = (tmp_path / "c" / "machine.c").read_text()
    tables = re.findall(r"umo_real (to_value_\d+)_table\[\]", source)
    assert len(tables) == 1 and source.count(f".to_value = &{tables[0]},") == 40


def test_what_a_user_has_filled_in_is_kept(good: Path, tmp_path: Path, umo: Umo) -> None:
    def generate() -> Result:
        return umo("new", "controller", str(good), "--target", "avr", "-o", str(tmp_path / "c"))

    assert generate().exit_code == 0
    (tmp_path / "c" / "io_board.c").write_text("/* mine */\n")
    result = generate()
    assert result.exit_code == 0 and "kept as they were: " in result.stdout and "io_board.c" in result.stdout
    assert (tmp_path / "c" / "io_board.c").read_text() == "/* mine */\n"


def test_faults_have_numbers_texts_and_places(good: Path, tmp_path: Path, umo: Umo) -> None:
    control = '        if self.level.read() > 90.0:\n            raise RuntimeError(f"too high: {self.level}")\n'
    folder = station(tmp_path / "tank", control)
    assert umo("new", "controller", str(folder), "--target", "host", "-o", str(tmp_path / "c")).exit_code == 0
    faults = json.loads((tmp_path / "c" / "faults.json").read_text())
    assert faults[-1]["kind"] == "RuntimeError" and faults[-1]["line"] == 18 and faults[-1]["file"] == "tank/objects.py"
    assert "too high" in faults[-1]["text"]


def test_a_folder_that_cannot_be_written_is_told_in_a_line(good: Path, tmp_path: Path, umo: Umo) -> None:
    (tmp_path / "file").write_text("")
    result = umo("new", "controller", str(good), "--target", "host", "-o", str(tmp_path / "file"))
    assert result.exit_code == 2 and len(result.stderr.splitlines()) == 1 and "file" in result.stderr


@pytest.mark.parametrize("target", ["host", "avr", "compile"])
def test_check_says_what_would_not_translate_and_writes_nothing(tmp_path: Path, umo: Umo, target: str) -> None:
    folder = station(tmp_path / "bad", BAD)
    files = {each for each in tmp_path.rglob("*") if "__pycache__" not in each.parts}
    told = umo("check", str(folder), "--target", target)
    assert told.exit_code == 2 and "bad/objects.py:17: self.seen[1] = self.level.read()" in told.stderr
    assert "places of Pump cannot be translated" in told.stderr
    assert {each for each in tmp_path.rglob("*") if "__pycache__" not in each.parts} == files


@pytest.mark.parametrize("target", ["host", "avr", "compile"])
def test_check_says_that_all_of_a_machine_translates(good: Path, umo: Umo, target: str) -> None:
    assert "all code can be translated" in umo("check", str(good), "--target", target).stdout


@pytest.mark.parametrize(("control", "is_noted"), [(BAD.splitlines()[0], True), (GOOD, False)])
def test_check_notes_that_laws_which_a_wiring_wants_compiled_will_run_in_python(
    tmp_path: Path, umo: Umo, control: str, is_noted: bool
) -> None:
    folder = station(tmp_path / "tank", control)
    with (folder / "wiring" / "simulated.toml").open("a") as file:
        file.write("[process]\ncompile = true\n")
    told = umo("check", str(folder))
    note = "note: compile = true: the laws will run in Python: tank/objects.py:17: self.seen[1] = self.level.read()"
    assert (note in told.stdout, told.exit_code) == (is_noted, 0)


def test_check_refuses_a_target_that_there_is_not_before_it_looks_at_anything(good: Path, umo: Umo) -> None:
    told = umo("check", str(good), "--target", "arm")
    assert told.exit_code == 2
    assert told.stderr.strip() == "umo: --target arm is not one of host, cortex-m, avr, arduino, compile"
    assert not told.stdout
