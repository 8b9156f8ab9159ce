"""Generated controllers under the address and undefined-behaviour sanitizers, fuzzed over raw integers."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

from helpers.boards import PEERS
from helpers.equipment_plant import plant
from helpers.generating import Fragile, everything, needs_a_compiler, wired, wiring_of
from helpers.translated_oven import oven, oven_wiring
from helpers.vector_plant import zones
from umo.generate.compiled_machine import FLAGS, compiler
from umo.generate.controller_folder import TARGETS, write_folder
from umo.generate.controller_generator import generated
from umo.objects import Compound
from umo.process.station import find
from umo.testing import VirtualTimer

pytestmark = [needs_a_compiler, pytest.mark.full]
PERIODS = 1_000_000
SANITIZERS = "-fsanitize=address,undefined", "-fno-sanitize-recover=all"
Made = tuple[Compound, Any]


def _everything() -> Made:
    machine = everything()
    return machine, wiring_of(machine, Fragile(), VirtualTimer(), "door", "lamp")


def _oven() -> Made:
    machine = oven()
    return machine, oven_wiring(machine, Fragile(), VirtualTimer())


def _ztheta() -> Made:
    station = find("ztheta")
    return station.machine(), station.wiring("modbus")


def _plant() -> Made:
    machine = plant()
    return machine, wired(machine, Fragile(), VirtualTimer())


def _zones() -> Made:
    machine = zones()
    return machine, wired(machine, Fragile(), VirtualTimer())


def _furnace() -> Made:
    station = find("furnace")
    return station.machine(), station.wiring("simulated")


def _batch() -> Made:
    station = find("batch")
    return station.machine(), station.wiring("modbus")


MACHINES: Mapping[str, Callable[[], Made]] = {
    "objects": _everything,
    "laws": _oven,
    "equipment": _plant,
    "vectors": _zones,
    "furnace": _furnace,
    "batch": _batch,
    "ztheta": _ztheta,
}


@pytest.mark.parametrize("which", MACHINES)
def test_a_million_random_periods_do_nothing_undefined(which: str, tmp_path: Path) -> None:
    machine, wiring = MACHINES[which]()
    write_folder(generated(machine, wiring, TARGETS["host"]), tmp_path)
    shutil.copy(PEERS / "fuzz.c", tmp_path)
    cc = compiler()
    assert cc is not None
    sources = [
        file for file in tmp_path.glob("*.c") if file.stem in ("machine", "fuzz") or file.stem.startswith("umo_")
    ]
    command = [cc, *FLAGS, *SANITIZERS, "-g", "-o", str(tmp_path / "fuzz"), *map(str, sources), "-lm"]
    subprocess.run(command, check=True)
    done = subprocess.run([tmp_path / "fuzz", str(PERIODS), "1"], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    assert int(done.stdout.split()[0]) > 1000
