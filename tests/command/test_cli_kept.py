"""`umo tune kept`, `umo run --fresh` in virtual time, `umo tune save`."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from umo.process import kept_file
from umo.process.kept_file import KeptValues
from umo_command.app import app

OBJECTS = """
from dataclasses import KW_ONLY
from typing import Annotated
from umo import Compound, DigitalSensor, Number

class Press(Compound):
    timer: DigitalSensor
    _: KW_ONLY
    count: Annotated[int, Number("", 0, 1000, kept=True)] = 0
    gain: Annotated[float, Number("", 0, 10, tunable=True)] = 1.0

def machine() -> Press:
    return Press(
        timer=DigitalSensor("sampling_period", minimum=0, maximum=99_999, resolution=1, synchronous=False)
    )
"""
MAIN = """
from umo.control import wait

async def main(m):
    m.cycle.progress(f"count {m.count}")
    m.count += 1
    await wait("5 ms")
    return m.count
"""


@pytest.fixture
def press(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    folder = tmp_path / "press"
    (folder / "wiring").mkdir(parents=True)
    (folder / "objects.py").write_text(OBJECTS)
    (folder / "application.py").write_text(MAIN)
    (folder / "wiring" / "simulated.toml").write_text('[wire]\ntimer = { driver = "simulated", period = "1 ms" }\n')
    monkeypatch.chdir(tmp_path)
    yield folder


def put(station: str = "press", wiring: str = "simulated", **numbers: Any) -> Path:
    entries = {path: {"value": value, "unit": "", "type": "int"} for path, value in numbers.items()}
    path = kept_file.path_of(station, wiring)
    with kept_file.locked(path, 1.0):
        kept_file.write(path, kept_file.dump(KeptValues(station, wiring, sections={"numbers": entries})))
    return path


def umo(*words: str) -> Any:
    return CliRunner().invoke(app, list(words))


def test_the_states_of_parts_are_shown(press: Path) -> None:
    path = kept_file.path_of("press", "simulated")
    sections = {"numbers": {}, "states": {"a.unit": "running", "b.unit": "held"}}
    with kept_file.locked(path, 1.0):
        kept_file.write(path, kept_file.dump(KeptValues("press", "simulated", sections=sections)))
    assert "in that period: a.unit running, b.unit held\n" in umo("tune", "kept", "press").stdout


RUN = ("run", "press", "--no-record")


def test_a_run_in_virtual_time_takes_a_copy_and_writes_nothing(press: Path) -> None:
    path = put(count=41)
    before = path.read_bytes()
    result = umo(*RUN)
    assert (result.exit_code, "count 41" in result.output) == (0, True)
    assert path.read_bytes() == before
    assert "count 0" in umo(*RUN, "--fresh").output
    assert sorted(each.name for each in path.parent.iterdir()) == [path.name, path.with_suffix(".lock").name]


def test_a_run_in_virtual_time_tells_what_it_does_not_take_and_leaves_a_damaged_file_where_it_is(press: Path) -> None:
    path = put(count=4100)
    result = umo(*RUN)
    assert "the kept value of count is not used: 4100 is outside 0 to 1000" in " ".join(result.stderr.split())
    path.write_bytes(b"torn")
    result = umo(*RUN)
    assert (result.exit_code, "are lost: the file is incomplete" in " ".join(result.stderr.split())) == (0, True)
    assert path.read_bytes() == b"torn"


def test_kept_lists_the_values_of_every_wiring_or_of_one(press: Path) -> None:
    put(count=411)
    put(wiring="modbus", count=422)
    put("other", count=433)
    text = umo("tune", "kept", "press").output
    assert [number in text.split() for number in ("411", "422", "433")] == [True, True, False]
    text = umo("tune", "kept", "press", "-w", "modbus").output
    assert [number in text.split() for number in ("411", "422")] == [False, True]


def test_kept_says_which_file_cannot_be_read(press: Path) -> None:
    put(count=41).write_bytes(b"torn")
    assert "the file is incomplete" in " ".join(umo("tune", "kept", "press").stderr.split())


def test_one_value_is_forgotten_and_the_others_stay(press: Path) -> None:
    path = put(count=41, other=3)
    assert umo("tune", "kept", "press", "--forget", "count").exit_code == 0
    values = kept_file.read(path)
    assert values is not None
    assert list(values.numbers) == ["other"]


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["tune", "kept", "pres"], "no values are kept of pres"),
        (["tune", "kept", "press", "-w", "modbus"], "no values are kept of press with the wiring modbus"),
        (["tune", "kept", "press", "--forget", "coun"], "'coun' is not kept (did you mean 'count'?)"),
    ],
)
def test_mistakes_are_told(press: Path, words: list[str], text: str) -> None:
    put(count=41)
    result = umo(*words)
    assert result.exit_code == 2
    assert text in " ".join(result.stderr.split())


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="locks")
def test_nothing_is_forgotten_while_a_run_keeps_it(press: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = put(count=41)
    monkeypatch.setattr("umo_command.tune.kept.LOCK_TIMEOUT", 0.0)
    with kept_file.locked(path, 1.0):
        result = umo("tune", "kept", "press", "--forget", "count")
    assert (result.exit_code, "a run is using the kept values" in " ".join(result.stderr.split())) == (2, True)
