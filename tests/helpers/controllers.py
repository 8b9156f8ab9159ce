"""Machines whose controllers are tried, and the emulated boards on which they run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any, Literal

import numpy as np

from helpers.boards import M3, M4F, MEASURED, avr, emulated, firmware, mps2, need
from helpers.converter import converter
from helpers.equipment_plant import plant
from helpers.generating import KINDS, Fragile, everything, random_inputs, set_inputs, told_by, wired, wiring_of
from helpers.rated_plant import rated_plant
from helpers.translated_oven import oven, oven_wiring
from helpers.vector_plant import zones
from umo import Compound
from umo.cycle.connect import connect
from umo.generate.controller_folder import TARGETS, files_of, write_folder
from umo.generate.controller_generator import target_of
from umo.generate.controller_model import laid_out
from umo.generate.translator import translate
from umo.process.station import find
from umo.testing import VirtualTimer

LEAST_MOVED = 20
"""Periods in which outputs change: of a machine that rests one or two do."""
ARM = "arm-none-eabi-gcc", "qemu-system-arm", "make"


@dataclass(frozen=True)
class Tried:
    """A machine that is tried: how it is made and wired."""

    make: Callable[[], Compound]
    wiring: Callable[[Compound, Fragile, VirtualTimer], dict[str, Any]]
    rests: bool = False
    """Whether its outputs stay at their defaults where no host plans and commands."""


def _wiring(machine: Compound, box: Fragile, clock: VirtualTimer) -> dict[str, Any]:
    return wiring_of(machine, box, clock, "door", "lamp")


def _heated_reactors() -> Compound:
    plant = find("batch").machine()
    for each in plant.reactors:
        each.setpoint, each.stirring, each.covered = 60.0, 100.0, 1.0
    return plant


def _heated_zones() -> Compound:
    furnace = find("furnace").machine()
    furnace.targets, furnace.ramp = np.full(len(furnace.zones), 150.0), 4.0
    furnace.following_error, furnace.most_faulted = 200.0, 1.0
    return furnace


MACHINES = {
    "objects": Tried(lambda: everything(0.5), _wiring),
    "laws": Tried(lambda: oven(0.5), oven_wiring),
    "equipment": Tried(lambda: plant(0.5), wired),
    "rates": Tried(lambda: rated_plant(0.5), wired),
    "vectors": Tried(lambda: zones(0.5, count=2), wired),
    "converter": Tried(converter, wired),
    "batch": Tried(_heated_reactors, wired),
    "conveyor": Tried(lambda: find("conveyor").machine(), wired, rests=True),
    "ztheta": Tried(lambda: find("ztheta").machine(), wired, rests=True),
    "furnace": Tried(_heated_zones, wired),
}
"""The machines that are tried: the laws of the batch plant and of the furnace act as they do after the host has begun a
batch and a run. Ages that are allowed are longer than whole periods: floats round times."""


@dataclass(frozen=True)
class BoardKind:
    """An emulated board, the target for it, and the difference in raw integers that is allowed."""

    target: str
    real: Literal["float"] | None
    allowed: int


BOARDS = {
    "Cortex-M3 with doubles": BoardKind("cortex-m", None, 0),
    "Cortex-M4F with floats": BoardKind("cortex-m", "float", 1),
    "ATmega328P with floats": BoardKind("avr", None, 1),
}
TRIALS = [(board, name) for board in BOARDS for name in MACHINES if (board[:6], name) != ("ATmega", "furnace")]
"""Each machine on each board. The table of a thermocouple is too large for an ATmega328P."""


def generate(tried: Tried, kind: BoardKind, folder: Path) -> None:
    """Write the controller of a machine into a folder."""
    machine, chosen = tried.make(), target_of(kind.target, kind.real)
    with laid_out(machine, tried.wiring(machine, Fragile(), VirtualTimer())) as model:
        write_folder(files_of(model, translate(machine, model.conditions, model.steps, chosen), chosen), folder)


def command_of(kind: BoardKind, tried: Tried, folder: Path) -> Sequence[str | Path]:
    """The command that runs the controller of a machine on an emulated board, made in the folder. CannotRun with the
    package to install."""
    need(*(("avr-gcc", "cc", "pkg-config", "make") if kind.target == "avr" else ARM))
    generate(tried, kind, folder)
    if kind.target == "avr":
        return avr(firmware(folder, TRIAL=f"{MEASURED} -DBAUD=2000000UL"), folder)
    if kind.real is None:
        return mps2(firmware(folder, **M3))
    return mps2(firmware(folder, **M4F), "mps2-an386")


@dataclass
class Ran:
    """What random periods of a controller have shown."""

    differ: int
    """Periods whose outputs differ by one raw step from Python's."""
    cycles: list[int]
    """Of each period: cycles of the processor."""


def run_beside(tried: Tried, command: Sequence[str | Path], allowed: int, periods: int, seed: int = 1) -> Ran:
    """Random periods with missed ticks and channels that fail, on a board and in Python; AssertionError for the first
    difference of more than `allowed` raw integers, for other faults, and for outputs that were hardly moved."""
    random, machine, box = Random(seed), tried.make(), Fragile()
    missed = [random.choice((0, 0, 0, 0, 0, 0, 2, 5)) for _ in range(periods)]
    running = connect(machine, tried.wiring(machine, box, VirtualTimer(missed)))
    with laid_out(machine, tried.wiring(machine, box, VirtualTimer(missed))) as model:
        following = random_inputs(model, random)
        faults = translate(machine, model.conditions, model.steps, TARGETS["host"]).faults
    kinds = KINDS | {each.number: each.kind for each in faults}
    inputs = [one.path for one in model.objects[: model.inputs]]
    outputs = [model.objects[slot].path for slot in model.outputs]
    raws, failed = [0] * len(inputs), [False] * len(inputs)
    set_inputs(box, inputs, raws, failed)
    differ, moved = 0, 0
    with running as m, emulated(*command) as trial:
        wanted = [box.get(path) for path in outputs]
        assert trial.step(0, raws, failed) == (0, wanted)
        for number in range(periods):
            if number % 10 == 0:
                m.acknowledge()
                trial.acknowledge(raws, failed)
            raws, failed = following()
            set_inputs(box, inputs, raws, failed)
            m.timer.read()
            told = told_by(m.sample) or told_by(m.control) or told_by(m.update)
            fault, found = trial.step(max(missed[number], 1), raws, failed)
            before, wanted = wanted, [box.get(path) for path in outputs]
            assert (number, kinds[fault]) == (number, told)
            apart = max(abs(a - b) for a, b in zip(wanted, found, strict=True))
            assert apart <= allowed, f"period {number}: {outputs}: Python has {wanted}, the board {found}"
            differ += wanted != found
            moved += wanted != before
    assert tried.rests or moved > LEAST_MOVED, moved
    return Ran(differ, trial.cycles[1:])
