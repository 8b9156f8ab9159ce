"""`umo run --fault`, `umo check` with faults, and what a run with faults says of itself."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import pytest

from umo.errors import WiringError
from umo.plant.register_map import register_maps
from umo.plant.simulation import Simulation
from umo.process.station import find
from umo.wiring import resolve


@pytest.mark.full
def test_a_run_with_a_fault_says_so(umo, tmp_path):
    result = umo(
        "run", "conveyor", "--parts", "2", "--fault", "sorter.belt.speed stuck at 1 s",
        "--fault", "sorter.entry noise 0 % at 1 s", "--fault-seed", "3", "--summary", "s.json",
    )  # fmt: skip
    assert result.exit_code == 1
    assert result.stdout.count("injected fault") == 2
    assert "sorter.belt.speed stuck at 1 s" in result.stdout
    assert "the drive runs at" in result.stderr
    faults = ["sorter.belt.speed stuck at 1 s", "sorter.entry noise 0 % at 1 s"]
    assert json.loads((tmp_path / "s.json").read_text())["injected_faults"] == faults
    (folder,) = (tmp_path / "runs").iterdir()
    assert (folder / "trace.csv").read_text().splitlines()[0].endswith(",injected_faults[],not_good")


def test_the_faults_of_a_wiring_are_checked(umo, tmp_path: Path):
    file = find("conveyor").wirings["simulated"]
    text = file.read_text().replace('".plant:Plant"', '"umo.stations.conveyor.plant:Plant"')
    for fault, status in (("sorter.belt.speed stuck at 1 s", 0), ("sorter.belt.speed stuck at 1 litre", 2)):
        changed = tmp_path / "faulty.toml"
        changed.write_text(f'faults = ["{fault}"]\nfault_seed = 4\n{text}')
        assert tomllib.loads(changed.read_text())
        result = umo("check", "conveyor", "-w", str(changed))
        assert result.exit_code == status, result.stderr
    assert "faults: fault 'sorter.belt.speed stuck at 1 litre'" in result.stderr


def test_a_plant_that_is_served_has_its_faults_on_its_own_time():
    station = find("conveyor")
    machine, now = station.machine(), [0.0]
    wired = resolve(machine, station.wirings["simulated"], {"fault": ["sorter.emergency_stop stuck OPEN at 10 ms"]})
    slot = [wire.item.path for wire in wired.wires].index("sorter.emergency_stop")
    with Simulation(wired, lambda: now[0]) as plant:
        seen = []
        for _ in range(8):
            now[0] += 0.002
            plant.catch_up()
            seen.append(plant.read(slot))
    assert seen == [1, 1, 1, 1, 0, 0, 0, 0]


def test_a_box_of_a_wiring_with_faults_is_served_without_them():
    station = find("conveyor")
    machine = station.machine()
    text = tomllib.loads(station.wirings["modbus"].read_text())
    plant = resolve(machine, station.wirings["simulated"])
    (plain,) = register_maps(plant, resolve(machine, text))
    (found,) = register_maps(plant, resolve(machine, text | {"faults": ["sorter.entry stuck at 1 s"]}))
    assert [point.slot for point in found.points] == [point.slot for point in plain.points]


def test_umo_plant_refuses_a_wrong_fault(umo):
    result = umo("device", "plant", "conveyor", "--port", "0", "--fault", "sorter.belt.sped stuck")
    assert result.exit_code == 2
    assert "did you mean 'sorter.belt.speed'?" in result.stderr


def test_a_fault_of_the_command_line_is_blamed_on_it(umo):
    result = umo("run", "conveyor", "--fault", "sorter.belt.sped stuck")
    assert result.exit_code == 2
    assert "umo: --fault 'sorter.belt.sped stuck': there is no object or driver 'sorter.belt.sped'" in result.stderr
    assert ".toml" not in result.stderr and "wiring" not in result.stderr


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("ztheta", "--parts", "200"), "umo: --parts: must be 1 to 6, not 200\n"),
        (("ztheta", "--seed", "2", "--parts", "0"), "umo: --parts: must be 1 to 6, not 0\n"),
        (("furnace", "--faults", "x:3"), "umo: --faults: there is no fault 'x'; the faults are: broken-thermocouple"),
    ],
)
def test_a_value_of_the_command_line_that_a_driver_refuses_is_blamed_on_its_option(umo, words, told):
    result = umo("run", *words)
    assert result.exit_code == 2 and told in result.stderr
    assert ".toml" not in result.stderr and "wiring" not in result.stderr


def test_a_value_of_the_wiring_that_a_driver_refuses_is_blamed_on_the_wiring():
    wiring = {"wire": {"timer": {"driver": "plant"}}, "drivers": {"plant": {"type": "ztheta", "parts": 200}}}
    with pytest.raises(WiringError, match=r"drivers\.plant: parts must be 1 to 6, not 200"):
        resolve(find("ztheta").machine(), wiring, {"seed": 3})


def test_h_is_help(umo):
    result = umo("run", "conveyor", "-h")
    assert result.exit_code == 0
    assert "Options of conveyor" in result.stdout


def test_faults_behind_the_table_of_parameters_are_said_to_be_there(umo, tmp_path):
    umo("new", "station", "mine")
    file = tmp_path / "mine" / "wiring" / "simulated.toml"
    file.write_text(file.read_text().replace("[parameters]", '[parameters]\nfaults = ["valve stuck"]'))
    assert "; put faults before the first table" in umo("check", "mine").stderr
