"""The laws of the stations in C, beside Python: equal to the bit, raw integers and every field."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from random import Random
from typing import Any

import pytest

from helpers.generating import Beside, Fragile, needs_a_compiler, random_inputs, set_inputs
from umo.control import Axis
from umo.control.inputs import HOMING
from umo.cycle.connect import connect
from umo.errors import UmoError
from umo.generate.code_world import translate
from umo.generate.compiled_machine import CompiledMachine, compiled
from umo.generate.controller_folder import TARGETS, files_of, write_folder
from umo.generate.controller_model import model_of
from umo.objects import Compound, Quality, atoms
from umo.process.station import find
from umo.testing import VirtualTimer

pytestmark = needs_a_compiler
PERIODS = 2_000


def wired(machine: Compound, box: Fragile, clock: VirtualTimer) -> dict[str, Any]:
    wire: dict[str, Any] = {each.path: {"driver": "box"} for each in atoms(machine) if each.path != "timer"}
    return {"drivers": {"box": box, "clock": clock}, "wire": wire | {"timer": {"driver": "clock", "period": "1 ms"}}}


def act_on_axes(m: Any, random: Random) -> None:
    """What the host does with an axis: it enables it, plans a motion, tunes it."""
    for axis in (m.z, m.theta):
        assert isinstance(axis, Axis)
        axis._accept = Quality.OUT_OF_RANGE if axis.encoder.quality < Quality.UNREFERENCED else HOMING
        what = random.randrange(4)
        if what == 0:
            axis.enabled = not axis.enabled
            axis._interrupted = axis._standing = False
            axis._stand()
        elif what == 1:
            axis.profile.to(axis.profile.setpoint.position + random.uniform(-3.0, 3.0) * axis.window)
        elif what == 2:
            axis.profile.at(random.uniform(-1.0, 1.0) * axis.velocity / 50)
        else:
            axis.following_error = 1e9 if random.random() < 0.9 else 100.0 * axis.window


@pytest.mark.parametrize(("station", "act"), [("ztheta", act_on_axes)])
def test_a_station_is_equal_to_the_bit(station: str, act: Callable[[Any, Random], None], tmp_path: Path) -> None:
    random, box = Random(2), Fragile()
    missed = [0] * PERIODS  # after missed periods a moving axis asks the host for another plan
    machine = find(station).machine()
    running = connect(machine, wired(machine, box, VirtualTimer(missed)))
    inputs = [each.path for each in atoms(machine) if each.path != "timer"]
    set_inputs(box, inputs, [0] * len(inputs), [False] * len(inputs))
    with running as m:
        model = model_of(running.machine, running.wired)
        translation = translate(m, model.functions, TARGETS["host"])
        write_folder(files_of(model, translation, TARGETS["host"]), tmp_path)
        c = CompiledMachine(compiled(tmp_path), model.inputs, len(model.outputs))
        both, following = Beside(running, box, c, model, translation.faults), random_inputs(model, random)
        structs = [c.struct(number, each) for number, each in enumerate(translation.structs)]
        assert c.begin([0] * model.inputs) == 0
        for number in range(PERIODS):
            raws, failed = following()
            both.step(max(missed[number], 1), raws, failed, [False] * len(model.outputs))
            assert (number, both.difference()) == (number, "")
            assert (number, [line for each in structs for line in each.differences()]) == (number, [])
            if random.random() < 0.05:
                with suppress(UmoError):
                    act(m, random)
                for each in structs:
                    each.push()
        assert both.told[None] > PERIODS / 4
