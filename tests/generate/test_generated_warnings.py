"""Compilers have nothing to say of generated C and of the runtime, with many warnings on."""

from __future__ import annotations

import inspect
import shutil
import subprocess
from pathlib import Path

import pytest

from umo.generate.c_compiler import FLAGS
from umo.generate.controller_folder import TARGETS, write_folder
from umo.generate.controller_generator import generated
from umo.process.station import find
from umo.stations.conveyor import belt

STATIONS = {"conveyor": "simulated", "batch": "modbus", "furnace": "simulated", "ztheta": "modbus"}
"""A wiring of each station that has control laws."""
COMPILERS = [name for name in ("gcc", "clang") if shutil.which(name)]


@pytest.mark.parametrize("compiler", COMPILERS)
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[] if name == "conveyor" else pytest.mark.full) for name in STATIONS]
)
def test_a_station_compiles_without_a_warning(name: str, compiler: str, tmp_path: Path) -> None:
    station = find(name)
    write_folder(generated(station.machine(), station.wiring(STATIONS[name]), TARGETS["host"]), tmp_path)
    sources = sorted(tmp_path.glob("*.c"))
    assert "-Wconversion" in FLAGS and "-Wshadow" in FLAGS and "-Werror" in FLAGS
    done = subprocess.run([compiler, *FLAGS, "-fsyntax-only", *sources], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")


def test_a_statement_tells_its_line_and_a_fault_has_a_name(tmp_path: Path) -> None:
    station = find("conveyor")
    files = generated(station.machine(), station.wiring("simulated"), TARGETS["host"])
    (told,) = (each for each in files["machine.c"].splitlines() if " v_deviates = " in each)
    (number,) = (n for n, each in enumerate(inspect.getsource(belt).splitlines(), 1) if " deviates = " in each)
    assert told.endswith(f"/* belt.py:{number} */")
    names = [line.split()[0] for line in files["machine_faults.h"].splitlines() if line.startswith("    FAULT_")]
    assert names and all(name in files["machine.c"] for name in names)
    assert "goto" not in files["machine.c"] and "(void)v_" not in files["machine.c"]
