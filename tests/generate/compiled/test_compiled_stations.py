"""Every station that ships, and the one that `umo new station` makes, runs with compiled laws from a folder of its
user: with parameters, kept values, recipes and tuning, where it has them. The laws are compiled, and stay so."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import Result

import umo as package
from helpers.compiling import observed
from helpers.generating import needs_a_compiler

pytestmark = needs_a_compiler
STATIONS = Path(package.__file__).parent / "stations"
PARAMETERS = {
    "furnace": {"gain": "4.5", "heating.integral_time": "42.0"},
    "batch": {"reactors.0.heating.gain": "3.9"},
    "conveyor": {"sorter.window": "21.0"},
    "ztheta": {"z.servo.gain": "0.0013"},
    "tank": {"band": "7.0"},
}
"""Numbers that a wiring sets: a constant of `setup`, or a gain of a law, in other values than they have."""
LENGTHS = {"furnace": 12.0, "batch": 60.0, "conveyor": 2.0, "ztheta": 1.0, "tank": 5.0}
"""Seconds of the machine's clock."""
SHIPPED = [pytest.param(each, marks=pytest.mark.full) for each in ("batch", "conveyor", "ztheta", "tank")]


def copied(name: str, umo: Callable[..., Result], more: str = "") -> Path:
    """A station in a folder of its user, whose wiring asks for compiled laws."""
    folder = Path("mine") / name
    if name == "tank":
        assert umo("new", "station", str(folder)).exit_code == 0
    else:
        shutil.copytree(STATIONS / name, folder, ignore=shutil.ignore_patterns("__pycache__"))
    wiring = folder / "wiring" / "simulated.toml"
    text = wiring.read_text("utf-8").partition("[parameters]")[0]
    numbers = "".join(f'"{path}" = {value}\n' for path, value in PARAMETERS[name].items())
    wiring.write_text(f"{text}\n[process]\ncompile = true\n\n[parameters]\n{numbers}{more}", "utf-8")
    return folder


@pytest.mark.parametrize("name", ["furnace", *SHIPPED])
def test_a_copy_in_a_folder_of_its_user_is_compiled_and_stays_so(name: str, umo: Callable[..., Result]) -> None:
    folder = copied(name, umo)
    with observed():
        result = umo("run", str(folder), "--until", f"{LENGTHS[name]}", "--no-record")
        assert "not compiled" not in result.output, result.output
