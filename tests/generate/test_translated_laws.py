"""The control laws in C beside Python: raw integers and every number of the laws, equal to the bit."""

from __future__ import annotations

from pathlib import Path
from random import Random

import pytest

from helpers.generating import Beside, Fragile, needs_a_compiler, random_inputs, set_inputs
from helpers.tiers import some
from helpers.translated_oven import oven, oven_wiring
from umo.cycle.connect import connect
from umo.generate.code_world import translate
from umo.generate.compiled_machine import CompiledMachine, compiled
from umo.generate.controller_folder import TARGETS, files_of, write_folder
from umo.generate.controller_model import model_of
from umo.testing import VirtualTimer

pytestmark = needs_a_compiler


@pytest.mark.parametrize("seed", some(lambda seed: seed < 1, range(6)))
def test_laws_are_equal_to_the_bit_whatever_is_missed_fails_or_is_inhibited(seed: int, tmp_path: Path) -> None:
    random, machine, box, steps = Random(seed), oven(), Fragile(), 10_000 if seed else 2_000
    missed = [random.choice((0, 0, 0, 0, 0, 0, 2, 5)) for _ in range(steps)]
    running = connect(machine, oven_wiring(machine, box, VirtualTimer(missed)))
    set_inputs(box, ["temperature", "pressure", "level", "door"], [0] * 4, [False] * 4)
    with running as m:
        model = model_of(running.machine, running.wired)
        translation = translate(m, model.functions, TARGETS["host"])
        write_folder(files_of(model, translation, TARGETS["host"]), tmp_path)
        c = CompiledMachine(compiled(tmp_path), model.inputs, len(model.outputs))
        both, following = Beside(running, box, c, model, translation.faults), random_inputs(model, random)
        structs = [c.struct(number, each) for number, each in enumerate(translation.structs)]
        assert c.begin([0] * model.inputs) == 0
        for number in range(steps):
            raws, failed = following()
            both.step(max(missed[number], 1), raws, failed, [False] * len(model.outputs))
            assert (number, both.difference()) == (number, "")
            assert (number, [line for each in structs for line in each.differences()]) == (number, [])
            if random.random() < 0.002:
                m.profile.to(random.uniform(20.0, 80.0))
                m.servo.gain = random.uniform(-3.0, 3.0)
                for each in structs:
                    each.push()
        assert both.told.keys() >= {None, "BadInput"}
        assert both.told[None] > steps / 4
