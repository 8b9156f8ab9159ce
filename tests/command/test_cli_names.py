"""How the commands for running stations find the one that is meant: by name, folder, or pid."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from helpers.machines import bench, wired
from umo import connect, published
from umo.process.frames.search import meant_by, readers
from umo.testing import Scripted, VirtualTimer, periods, station


@contextmanager
def running(name: str, place: Path | None = None) -> Iterator[Any]:
    """A run of a machine, as by `umo.start(function)`, or of the station in a folder."""
    machine = bench() if place is None else station(place).machine()
    wiring = wired(machine, Scripted(), clock=VirtualTimer()) if place is None else None
    connection = connect(machine, wiring)
    with connection, published(connection, name, "rig", place=place):
        periods(machine)
        yield machine


def said(result: Any) -> str:
    return " ".join(result.stderr.split())


def test_get_and_set_know_a_run_that_has_no_folder(umo: Any) -> None:
    with running("press"):
        result = umo("device", "get", "press", "motor", "valve")
        assert (result.exit_code, result.stdout) == (0, "motor  0.0 V  ● good\nvalve  OFF  ● good\n"), said(result)
        assert said(result) == f"umo: read from the frames of press, which is running (pid {os.getpid()})"
        assert umo("device", "get", "press", "motor", "--unit", "mV").stdout == "motor  0 mV  ● good\n"
        result = umo("device", "set", "press", "motor", "1")
        assert (result.exit_code, said(result)) == (2, "umo: press: it takes no commands")


def test_get_and_set_know_a_run_whose_folder_is_elsewhere(umo: Any, tank: Path, tmp_path: Path) -> None:
    elsewhere = tank.rename(tmp_path / "mill")
    (tmp_path / "here").mkdir()
    os.chdir(tmp_path / "here")
    with running("mill", elsewhere):
        for name in ("mill", "../mill", str(elsewhere), str(os.getpid())):
            assert umo("device", "get", name, "inlet").stdout == "inlet  CLOSED  ● good\n"
            assert umo("do", name, "mode").stdout == "mill  takes no commands\n"
        law = "umo: regulator is not an object; name one of its numbers: regulator.low and regulator.high\n"
        assert umo("device", "get", "mill", "regulator").stderr == law


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["device", "get", "press", "moter"], "no object 'moter' (did you mean 'motor'?)"),
        (["device", "set", "press", "encoder", "1"], "encoder is a sensor; only actuators can be set"),
        (["device", "set", "press", "valve", "OFFF"], "valve has no state 'OFFF' (did you mean 'OFF'?): OFF, ON"),
        (["device", "set", "press", "motor", "1e999"], "motor: '1e999' is too large for a number in V"),
        (
            ["device", "get", "press", "motor", "--zones", "3"],
            "options of its machine cannot be changed; leave out --zones",
        ),
        (["device", "get", "pres", "motor"], "or one of: batch, conveyor, furnace, ztheta; running: press"),
    ],
)
def test_a_mistake_about_a_run_is_a_line(umo: Any, words: list[str], text: str) -> None:
    with running("press"):
        result = umo(*words)
        assert (result.exit_code, text in said(result)) == (2, True), said(result)


def test_a_folder_here_and_a_run_of_its_name_elsewhere_are_told_apart(umo: Any, tank: Path, tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()
    elsewhere = tank.rename(tmp_path / "other" / "tank")
    assert umo("new", "station", "tank").exit_code == 0
    with running("tank", elsewhere):
        result = umo("device", "get", "tank", "level")
        assert result.exit_code == 2
        assert f"{elsewhere}, which is running (pid {os.getpid()}): give ./tank or the pid" in said(result)
        assert "this reading opens driver tank" in said(umo("device", "get", "./tank", "level"))
        with running("tank", tmp_path / "tank"):
            assert "from the frames" in said(umo("device", "get", "tank", "inlet"))


def test_a_name_means_the_run_in_its_folder_first(umo: Any, tank: Path, tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to("tank")
    with running("tank", tank), running("tank"):
        found = readers()
        for name, count in (("tank", 1), ("./tank", 1), ("link", 1), ("link/", 1), (str(os.getpid()), 2), ("./no", 0)):
            assert len(meant_by(name, found)) == count, name
        assert meant_by("tank", found)[0].about["place"] == str(tank)


# What will be refused is refused before a device is opened ----------------------------------------------

OBJECTS = """
from umo import Compound, DigitalActuator, DigitalSensor


class Rig(Compound):
    motor: DigitalActuator
    valve: DigitalActuator


def machine() -> Rig:
    return Rig(
        motor=DigitalActuator("V", default=0.0, minimum=-10.0, maximum=10.0, resolution=0.01, limits="clamp"),
        valve=DigitalActuator("percent", default=0.0, minimum=0.0, maximum=100.0, resolution=1.0),
    )
"""
WIRING = """
[wire]
motor = { driver = "simulated" }
valve = { driver = "simulated", maximum = 50.0 }
"""


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["motor", "1e999"], "motor: '1e999' is too large for a number in V"),
        (["motor", "-1e308 kV"], "motor: '-1e308 kV' is too large for a number in V"),
        (["motor", "nan"], "motor: 'nan' is not a number in V"),
        (["valve", "60"], "valve: 60 % is outside 0 to 50"),
    ],
)
def test_set_refuses_before_it_opens_a_device(umo: Any, tmp_path: Path, words: list[str], text: str) -> None:
    (tmp_path / "rig" / "wiring").mkdir(parents=True)
    (tmp_path / "rig" / "objects.py").write_text(OBJECTS)
    (tmp_path / "rig" / "wiring" / "bench.toml").write_text(WIRING)
    result = umo("device", "set", "rig", *words, "--for", "0")
    assert (result.exit_code, said(result)) == (2, f"umo: {text}")
    assert (
        "motor  10.00 V  raw 1000  ● good  (clamped)" in umo("device", "set", "rig", "motor", "11", "--for", "0").stdout
    )


COMMANDS_OF_A_FOLDER: list[list[str]] = [
    ["show", "parts", "mill"],
    ["show", "period", "mill"],
    ["check", "mill"],
    ["tune", "law", "mill"],
    ["new", "service", "mill"],
    ["new", "controller", "mill", "--target", "host", "--out", "c"],
    ["new", "station", "copied", "--copy", "mill"],
]


@pytest.mark.parametrize("words", COMMANDS_OF_A_FOLDER, ids=lambda words: " ".join(words[:2]))
def test_commands_that_read_the_folder_of_a_station_take_the_name_of_a_running_one(
    umo: Any, tank: Path, tmp_path: Path, words: list[str]
) -> None:
    elsewhere = tank.rename(tmp_path / "mill")
    (tmp_path / "here").mkdir()
    os.chdir(tmp_path / "here")
    assert said(umo(*words)).startswith("umo: there is no station 'mill'")
    with running("mill", elsewhere):
        result = umo(*words)
    assert result.exit_code == 0, said(result)


def test_the_recipes_of_a_running_station_are_found_by_its_name(umo: Any, tank: Path, tmp_path: Path) -> None:
    elsewhere = tank.rename(tmp_path / "mill")
    (tmp_path / "here").mkdir()
    os.chdir(tmp_path / "here")
    with running("mill", elsewhere):
        assert said(umo("tune", "recipe", "mill")) == "umo: mill has no recipes"


def test_a_command_that_needs_the_folder_says_that_the_run_has_none(umo: Any) -> None:
    with running("press"):
        result = umo("show", "parts", "press")
    assert result.exit_code == 2
    assert said(result) == (
        f"umo: press is running (pid {os.getpid()}), but its run names no folder of a station, which this command "
        f"needs: give the folder"
    )


def test_a_run_is_not_started_by_the_name_of_a_running_station(umo: Any, tank: Path, tmp_path: Path) -> None:
    elsewhere = tank.rename(tmp_path / "mill")
    (tmp_path / "here").mkdir()
    os.chdir(tmp_path / "here")
    with running("mill", elsewhere):
        assert said(umo("run", "mill")).startswith("umo: there is no station 'mill'")
