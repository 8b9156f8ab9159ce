"""Parts with rates of their own, in C beside Python: equal to the bit in every period of the machine."""

from __future__ import annotations

from pathlib import Path
from random import Random

import pytest

from helpers.equipment_plant import Slide
from helpers.generating import Beside, Fragile, needs_a_compiler, random_inputs, set_inputs, wired, without_host
from helpers.machines import actuator, timer
from helpers.rated_plant import rated_plant_with_axis
from helpers.tiers import some
from umo import Compound, DigitalActuator, DigitalSensor
from umo.control import Profile
from umo.cycle.connect import connect
from umo.objects import Sensor, atoms
from umo.testing import VirtualTimer

pytestmark = needs_a_compiler


RATES = (3, 7, 5), (2, 2, 2), (4, 6, 12), (1, 10, 3), (6, 1, 1), (5, 3, 2)
"""Those of the parts of the plant, by the seed."""


def begin_to_move(axis: Slide) -> None:
    """The host enables the axis, or plans a motion."""
    if not axis.host_begins_homing():
        Profile.to(axis.profile, axis.profile.setpoint.position + 3.0)


@pytest.mark.parametrize("seed", some(lambda seed: seed < 1, range(len(RATES))))
def test_every_period_is_the_same_where_ticks_are_missed_and_channels_fail(seed: int, tmp_path: Path) -> None:
    random, machine, box, steps = Random(seed), rated_plant_with_axis(RATES[seed]), Fragile(), 10_000 if seed else 1_500
    missed = [random.choice((0, 0, 0, 0, 0, 0, 2, 5, 23)) for _ in range(steps)]
    running = connect(machine, wired(machine, box, VirtualTimer(missed)))
    inputs = [each.path for each in atoms(machine) if isinstance(each, Sensor) and each.path != "timer"]
    set_inputs(box, inputs, [0] * len(inputs), [False] * len(inputs))
    with running as m:
        both = Beside.translated(running, box, tmp_path)
        assert [each.every for each in both.model.groups] == sorted(each for each in RATES[seed] if each > 1)
        without_host(m)
        following = random_inputs(both.model, random)
        parts = [each.path for each in both.model.equipment]
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
            if random.random() < 0.05:
                m.acknowledge()
                both.c.acknowledge()
            if random.random() < 0.02:
                begin_to_move(m.carriage.slide)
                both.push()
            if random.random() < 0.06:
                if both.clear(random.randrange(-1, len(parts))):
                    cleared += 1
                else:
                    refused += 1
                assert (number, both.difference()) == (number, "")
        assert all(steps / 100 < each < steps for each in faults.values()), faults
        assert refused > 1 and cleared > 1
        assert both.told.keys() >= {None, "BadInput", "DriverError"}
        assert both.told[None] > steps / 4


class Pump(Compound, equipment=True):
    motor: DigitalActuator

    def control(self) -> None:
        self.motor.write(5.0)


class Slow(Compound, every=2):
    valve: DigitalActuator

    def control(self) -> None:
        self.valve.write(5.0)


class PumpAndSlow(Compound):
    timer: DigitalSensor
    pump: Pump
    slow: Slow


def test_defaults_of_equipment_in_fault_are_sent_before_a_slow_part_acts(tmp_path: Path) -> None:
    machine = PumpAndSlow(timer=timer(), pump=Pump(motor=actuator()), slow=Slow(valve=actuator()))
    running = connect(machine, wired(machine, Fragile(), VirtualTimer()))
    with running:
        both = Beside.translated(running, Fragile(), tmp_path)
        c, seen = both.c, list[list[int]]()
        assert both.outputs == ["pump.motor", "slow.valve"]
        assert (c.step(2, []), c.raws_out) == (0, [10, 0])
        assert c.sent([True, False]) == 0
        while c.changed:
            seen.append(c.raws_out)
            assert c.sent() == 0
        assert seen == [[0, 0], [0, 10]]
