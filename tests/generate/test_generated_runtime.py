"""The runtime of a generated controller, compiled, beside the machine in Python: equal to the bit."""

from __future__ import annotations

from pathlib import Path
from random import Random

import pytest

from helpers.generating import (
    Beside,
    Fragile,
    everything,
    needs_a_compiler,
    random_inputs,
    set_inputs,
    wiring_of,
)  # fmt: skip
from helpers.tiers import some
from tools.compiled_machine import CompiledMachine, compiled
from umo.cycle.connect import connect
from umo.generate.controller_folder import TARGETS, files_of, write_folder
from umo.generate.controller_model import laid_out, model_of
from umo.generate.translator import translate
from umo.testing import VirtualTimer

pytestmark = needs_a_compiler


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The machine with everything, compiled once."""
    folder, machine = tmp_path_factory.mktemp("controller"), everything()
    with laid_out(machine, wiring_of(machine, Fragile(), VirtualTimer(), "door", "lamp")) as model:
        write_folder(
            files_of(model, translate(machine, model.conditions, model.steps, TARGETS["host"]), TARGETS["host"]), folder
        )
    return compiled(folder)


@pytest.mark.full
@pytest.mark.parametrize("seed", some(lambda seed: seed < 1, range(12)))
def test_ten_thousand_random_periods_are_equal_to_the_bit(library: Path, seed: int) -> None:
    random, machine, box, steps = Random(seed), everything(), Fragile(), 10_000 if seed else 2_000
    missed = [random.choice((0, 0, 0, 0, 0, 0, 2, 5)) for _ in range(steps)]
    running = connect(machine, wiring_of(machine, box, VirtualTimer(missed), "door", "lamp"))
    with laid_out(machine, wiring_of(machine, box, VirtualTimer(missed), "door", "lamp")) as model:
        following = random_inputs(model, random)
    inputs = [one.path for one in model.objects[: model.inputs]]
    raws, none = [0] * len(inputs), [False] * len(inputs)
    set_inputs(box, inputs, raws, none)
    with running as m:
        model = model_of(running.machine, running.wired)
        controller = CompiledMachine(library, model.inputs, len(model.outputs))
        both = Beside(running, box, controller, model)
        assert controller.begin(raws) == 0
        assert both.difference() == ""
        encoder = next(one.slot for one in model.objects if one.path == "encoder")
        for number in range(steps):
            raws, failed = following()
            deaf = [one_of_many(random) and model.objects[slot].synchronous for slot in model.outputs]
            both.step(max(missed[number], 1), raws, failed, deaf)
            assert (number, both.difference()) == (number, "")
            if random.random() < 0.05:
                m.acknowledge()
                controller.acknowledge()
            if random.random() < 0.01:
                known = random.random() < 0.7
                at = random.uniform(0.0, 50.0) if known and m.encoder.quality.value < 4 else None
                m.encoder.referenced(known, at=at)
                controller.referenced(encoder, known, at)
        assert both.told.keys() == {None, "DriverError", "BadInput", "RangeError", "Interlocked"}
        assert both.told[None] > steps / 4


def one_of_many(random: Random) -> bool:
    return random.random() < 0.01
