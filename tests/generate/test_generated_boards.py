"""A generated controller on emulated boards, beside the machine in Python: doubles are equal to the bit, floats lie
within one raw step. Needs cross compilers and emulators; a test without them is skipped and says which."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any, Literal

import pytest

from helpers.boards import M3, M4F, avr, emulated, firmware, mps2, need
from helpers.failing_plant import plant
from helpers.generating import KINDS, Fragile, everything, random_inputs, set_inputs, told_by, wired, wiring_of
from helpers.peers.text_devices import CannotRun
from helpers.translated_oven import oven, oven_wiring
from umo import Compound
from umo.cycle.connect import connect
from umo.generate.code_world import translate
from umo.generate.controller_folder import files_of, write_folder
from umo.generate.controller_generator import target_of
from umo.generate.controller_model import laid_out
from umo.process.station import find
from umo.testing import VirtualTimer

PERIODS = 10_000
ARM = "arm-none-eabi-gcc", "qemu-system-arm", "make"
pytestmark = pytest.mark.full
Board = tuple[Sequence[str | Path], int]
"""The command of an emulated board, and the difference in raw integers that is allowed."""


@dataclass
class Tried:
    """A machine that is tried: how it is made and wired."""

    make: Callable[[], Compound]
    wiring: Callable[[Compound, Fragile, VirtualTimer], dict[str, Any]]


def _wiring(machine: Compound, box: Fragile, clock: VirtualTimer) -> dict[str, Any]:
    return wiring_of(machine, box, clock, "door", "lamp")


MACHINES = {
    "objects": Tried(lambda: everything(0.5), _wiring),
    "laws": Tried(lambda: oven(0.5), oven_wiring),
    "equipment": Tried(lambda: plant(0.5), wired),
    "batch": Tried(lambda: find("batch").machine(), wired),
    "conveyor": Tried(lambda: find("conveyor").machine(), wired),
}


@pytest.fixture(params=list(MACHINES))
def tried(request: pytest.FixtureRequest) -> Tried:
    return MACHINES[request.param]


@pytest.fixture(params=["Cortex-M3 with doubles", "Cortex-M4F with floats", "ATmega328P with floats"])
def board(request: pytest.FixtureRequest, tried: Tried, tmp_path: Path) -> Board:
    try:
        return _board(request.param.split()[0], tried, tmp_path)
    except CannotRun as error:
        pytest.skip(str(error))


def _board(name: str, tried: Tried, folder: Path) -> Board:
    if name == "ATmega328P":
        need("avr-gcc", "cc", "pkg-config", "make")
        _generate(tried, "avr", None, folder)
        return avr(firmware(folder, TRIAL="-DUMO_MEASURE -DBAUD=2000000UL"), folder), 1
    need(*ARM)
    if name == "Cortex-M3":
        _generate(tried, "cortex-m", None, folder)
        return mps2(firmware(folder, **M3)), 0
    _generate(tried, "cortex-m", "float", folder)
    return mps2(firmware(folder, **M4F), "mps2-an386"), 1


def _generate(tried: Tried, target: str, real: Literal["double", "float"] | None, folder: Path) -> None:
    machine, chosen = tried.make(), target_of(target, real)
    with laid_out(machine, tried.wiring(machine, Fragile(), VirtualTimer())) as model:
        write_folder(files_of(model, translate(machine, model.conditions, model.steps, chosen), chosen), folder)


def test_ten_thousand_random_periods_on_a_board(board: Board, tried: Tried) -> None:
    command, allowed = board
    random, machine, box = Random(1), tried.make(), Fragile()
    missed = [random.choice((0, 0, 0, 0, 0, 0, 2, 5)) for _ in range(PERIODS)]
    running = connect(machine, tried.wiring(machine, box, VirtualTimer(missed)))
    with laid_out(machine, tried.wiring(machine, box, VirtualTimer(missed))) as model:
        following = random_inputs(model, random)
    inputs = [one.path for one in model.objects[: model.inputs]]
    outputs = [model.objects[slot].path for slot in model.outputs]
    raws, failed = [0] * len(inputs), [False] * len(inputs)
    set_inputs(box, inputs, raws, failed)
    differ = 0
    with running as m, emulated(*command) as trial:
        assert trial.step(0, raws, failed) == (0, [box.get(path) for path in outputs])
        for number in range(PERIODS):
            raws, failed = following()
            set_inputs(box, inputs, raws, failed)
            told = _period(m)
            fault, found = trial.step(max(missed[number], 1), raws, failed)
            wanted = [box.get(path) for path in outputs]
            assert (number, KINDS[fault]) == (number, told)
            apart = max(abs(a - b) for a, b in zip(wanted, found, strict=True))
            assert apart <= allowed, f"period {number}: {outputs}: Python has {wanted}, the board {found}"
            differ += wanted != found
    assert differ <= PERIODS / 20
    print(f"{differ} of {PERIODS} periods differ; at most {max(trial.cycles[1:])} cycles")


def _period(m: Any) -> str | None:
    m.timer.read()
    return told_by(m.sample) or told_by(m.control) or told_by(m.update)
