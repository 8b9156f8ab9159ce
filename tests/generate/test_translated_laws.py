"""The control laws in C beside Python: raw integers and every number of the laws, equal to the bit."""

from __future__ import annotations

from pathlib import Path
from random import Random

import numpy as np
import pytest

from helpers.generating import Beside, Fragile, needs_a_compiler, random_inputs, set_inputs, wired
from helpers.tiers import some
from helpers.translated_cascade import jacketed
from helpers.translated_oven import oven, oven_wiring
from helpers.vector_plant import zones
from umo.cycle.connect import connect
from umo.objects import Sensor, atoms
from umo.testing import VirtualTimer

pytestmark = needs_a_compiler


@pytest.mark.parametrize("seed", some(lambda seed: seed < 1, range(6)))
def test_laws_are_equal_to_the_bit_whatever_is_missed_fails_or_is_inhibited(seed: int, tmp_path: Path) -> None:
    random, machine, box, steps = Random(seed), oven(), Fragile(), 10_000 if seed else 1_200
    missed = [random.choice((0, 0, 0, 0, 0, 0, 2, 5)) for _ in range(steps)]
    running = connect(machine, oven_wiring(machine, box, VirtualTimer(missed)))
    set_inputs(box, ["temperature", "pressure", "level", "door"], [0] * 4, [False] * 4)
    with running as m:
        both = Beside.translated(running, box, tmp_path)
        following = random_inputs(both.model, random)
        for number in range(steps):
            raws, failed = following()
            both.step(max(missed[number], 1), raws, failed, [False] * len(both.outputs))
            assert (number, both.difference()) == (number, "")
            if random.random() < 0.002:
                m.profile.to(random.uniform(20.0, 80.0))
                m.servo.gain = random.uniform(-3.0, 3.0)
                both.push()
        assert both.told.keys() >= {None, "BadInput"}
        assert both.told[None] > steps / 4


@pytest.mark.parametrize("seed", some(lambda seed: seed < 1, range(6)))
@pytest.mark.full
def test_laws_of_vectors_are_equal_to_the_bit(seed: int, tmp_path: Path) -> None:
    random, machine, box, steps = Random(seed), zones(), Fragile(), 10_000 if seed else 500
    missed = [random.choice((0, 0, 0, 0, 0, 0, 2, 5)) for _ in range(steps)]
    running = connect(machine, wired(machine, box, VirtualTimer(missed)))
    inputs = [each.path for each in atoms(machine) if isinstance(each, Sensor) and each.path != "timer"]
    set_inputs(box, inputs, [0] * len(inputs), [False] * len(inputs))
    with running as m:
        both = Beside.translated(running, box, tmp_path)
        following = random_inputs(both.model, random)
        for number in range(steps):
            raws, failed = following()
            both.step(max(missed[number], 1), raws, failed, [False] * len(both.outputs))
            assert (number, both.difference()) == (number, "")
            if random.random() < 0.01:
                m.setpoints = np.array([random.uniform(20.0, 80.0) for _ in m.zones])
                m.heating.derivative_time = random.choice((0.0, 0.013))
                both.push()
        assert both.told.keys() >= {None, "DriverError", "Interlocked"}
        assert both.told[None] > steps / 4
        assert m.refused and m.unread and m.refused < steps and m.unread < steps


@pytest.mark.full
@pytest.mark.parametrize("seed", some(lambda seed: seed < 1, range(3)))
def test_a_cascade_is_equal_to_the_bit(seed: int, tmp_path: Path) -> None:
    random, machine, box, steps = Random(seed), jacketed(), Fragile(), 10_000 if seed else 1_000
    missed = [random.choice((0, 0, 0, 0, 0, 0, 2, 5)) for _ in range(steps)]
    running = connect(machine, wired(machine, box, VirtualTimer(missed)))
    set_inputs(box, ["vessel", "jacket"], [0] * 2, [False] * 2)
    with running as m:
        both = Beside.translated(running, box, tmp_path)
        following = random_inputs(both.model, random)
        for number in range(steps):
            raws, failed = following()
            both.step(max(missed[number], 1), raws, failed, [False] * len(both.outputs))
            assert (number, both.difference()) == (number, "")
        assert m.behind and m.unread and m.behind + m.unread < steps
