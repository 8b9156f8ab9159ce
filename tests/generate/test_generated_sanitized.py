"""Generated controllers under the address and undefined-behaviour sanitizers, fuzzed over raw integers."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from helpers.boards import PEERS
from helpers.controllers import MACHINES
from helpers.generating import Fragile, needs_a_compiler
from umo.generate.c_compiler import FLAGS, compiler
from umo.generate.controller_folder import TARGETS, write_folder
from umo.generate.controller_generator import generated
from umo.testing import VirtualTimer

pytestmark = [needs_a_compiler, pytest.mark.full]
PERIODS = 1_000_000
SANITIZERS = "-fsanitize=address,undefined", "-fno-sanitize-recover=all"


@pytest.mark.parametrize("which", MACHINES)
def test_a_million_random_periods_do_nothing_undefined(which: str, tmp_path: Path) -> None:
    machine = MACHINES[which].make()
    wiring = MACHINES[which].wiring(machine, Fragile(), VirtualTimer())
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
    assert int(done.stdout.split()[0]) > 50
