"""The laws of Vectors in C beside Python: raw integers and every number of the laws, equal to the bit."""

from __future__ import annotations

from pathlib import Path
from random import Random

import pytest

from helpers.generating import Beside, Fragile, needs_a_compiler, random_inputs, set_inputs, wired
from helpers.tiers import some
from helpers.translated_bays import bays
from umo.cycle.connect import connect
from umo.objects import atoms
from umo.testing import VirtualTimer

pytestmark = needs_a_compiler


@pytest.mark.parametrize("seed", some(lambda seed: seed < 1, range(4)))
@pytest.mark.full
def test_vectors_are_equal_to_the_bit_whatever_is_missed_fails_or_is_inhibited(seed: int, tmp_path: Path) -> None:
    random, machine, box, steps = Random(seed), bays(), Fragile(), 10_000 if seed else 300
    missed = [random.choice((0, 0, 0, 0, 0, 0, 2, 5)) for _ in range(steps)]
    running = connect(machine, wired(machine, box, VirtualTimer(missed)))
    inputs = [each.path for each in atoms(machine) if each.path != "timer"]
    set_inputs(box, inputs, [0] * len(inputs), [False] * len(inputs))
    with running as m:
        both = Beside.translated(running, box, tmp_path)
        following = random_inputs(both.model, random)
        for number in range(steps):
            raws, failed = following()
            both.step(max(missed[number], 1), raws, failed, [False] * len(both.outputs))
            assert (number, both.difference()) == (number, "")
            if random.random() < 0.02:
                m.acknowledge()
                both.c.acknowledge()
                m.heating.gain, m.heating.derivative_time = random.uniform(-3.0, 3.0), random.choice((0.0, 0.01))
                m.setpoints[:] = random.uniform(0.0, 90.0)
                both.push()
        assert both.told.keys() >= {None}
        assert both.told[None] > steps / 4
