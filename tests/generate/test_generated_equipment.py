"""Parts that fail alone, in C beside Python: the same parts are in fault in the same period, and the others go on."""

from __future__ import annotations

import re
from pathlib import Path
from random import Random

import pytest

from helpers.equipment_plant import Slide, plant
from helpers.generating import Beside, Fragile, needs_a_compiler, random_inputs, set_inputs, wired
from helpers.tiers import some
from umo import Compound, DigitalSensor
from umo.cycle.connect import connect
from umo.objects import atoms
from umo.testing import VirtualTimer

pytestmark = needs_a_compiler


def act_on(axis: Slide, random: Random) -> None:
    """The host enables the axis, or plans a motion."""
    if not axis.host_begins_homing():
        axis.profile.to(axis.profile.setpoint.position + random.uniform(-3.0, 3.0))


@pytest.mark.parametrize("seed", some(lambda seed: seed < 1, range(6)))
def test_what_fails_in_equipment_is_its_fault_in_the_same_period(seed: int, tmp_path: Path) -> None:
    random, machine, box, steps = Random(seed), plant(), Fragile(), 10_000 if seed else 2_000
    # after missed periods a moving axis asks the host for another plan: the axis moves where none is missed
    missed = [random.choice((0, 0, 0, 0, 0, 0, 2, 5)) if seed % 2 else 0 for _ in range(steps)]
    running = connect(machine, wired(machine, box, VirtualTimer(missed)))
    inputs = [each.path for each in atoms(machine) if isinstance(each, DigitalSensor) and each.path != "timer"]
    set_inputs(box, inputs, [0] * len(inputs), [False] * len(inputs))
    with running as m:
        both = Beside.translated(running, box, tmp_path)
        following = random_inputs(both.model, random)
        parts = [each.path for each in both.model.equipment]
        assert parts == ["unit", "unit.pump", "unit.valve", "other", "slide"]
        faults, cleared, refused, cut = dict.fromkeys(parts, 0), 0, 0, 0
        for number in range(steps):
            raws, failed = following()
            if number % 50 == 0:
                cut = random.randrange(3 * len(failed))
            if cut < len(failed) and number % 50 < 30:
                failed[cut] = True
            deaf = [random.random() < 0.003 for _ in both.outputs]
            both.step(max(missed[number], 1), raws, failed, deaf)
            assert (number, both.difference()) == (number, "")
            for place, path in enumerate(parts):
                faults[path] += both.c.equipment_fault(place) != 0
            if not seed % 2 and random.random() < 0.05:
                act_on(m.slide, random)
                both.push()
            if random.random() < 0.02:
                m.unit.valve.position.referenced(True)
                both.c.referenced(running.image.slot_of[id(m.unit.valve.position)])
            if random.random() < 0.03:
                if both.clear(random.randrange(-1, len(parts))):
                    cleared += 1
                else:
                    refused += 1
                assert (number, both.difference()) == (number, "")
        assert all(steps / 50 < each < steps for each in faults.values()), faults
        assert refused > 1 and cleared > 1
        assert both.told.keys() >= {None, "BadInput", "Interlocked"}
        assert both.told[None] > steps / 4


class Pump(Compound):
    def setup(self) -> None:
        self.speed, self.ratio = 0.0, 0.0

    def control(self) -> None:
        self.ratio = 1.0 / self.speed


class Unit(Compound, equipment=True):
    pump: Pump
    level: DigitalSensor

    def control(self) -> None:
        assert self.level.read() > 0.0


class Plant(Compound):
    unit: Unit
    timer: DigitalSensor


def test_of_two_laws_of_equipment_that_fail_in_one_period_the_first_is_told(tmp_path: Path) -> None:
    timer = DigitalSensor("sampling_period", minimum=0.0, maximum=1e5, resolution=1.0, synchronous=False)
    level = DigitalSensor("mm", minimum=0.0, maximum=10.0, resolution=1.0)
    box = Fragile()
    machine = Plant(unit=Unit(pump=Pump(), level=level), timer=timer)
    running = connect(machine, wired(machine, box, VirtualTimer([0])))
    set_inputs(box, ["unit.level"], [0], [False])
    with running:
        both = Beside.translated(running, box, tmp_path)
        both.step(1, [0], [False], [])
        (unit,) = running.machine.equipment.all
        kind = both.kinds[both.c.equipment_fault(0)]
        assert {kind} == {"AssertionError", "ZeroDivisionError"} & {*re.findall(r"\w+", str(unit.fault))}
