"""The laws of the stations in C, beside Python: equal to the bit, raw integers and every field."""

from __future__ import annotations

from contextlib import suppress
from math import nan
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pytest

from helpers.generating import Beside, Fragile, needs_a_compiler, random_inputs, set_inputs, wired, without_host
from helpers.tiers import first
from umo.control import Axis
from umo.control.axis import Interruption
from umo.control.axis_state import AxisState
from umo.control.inputs import HOMING
from umo.control.profile import Profile
from umo.cycle.connect import connect
from umo.errors import UmoError
from umo.objects import Quality, atoms
from umo.process.station import find
from umo.testing import VirtualTimer

pytestmark = needs_a_compiler
PERIODS = 2_000


def act_on_axes(m: Any, random: Random) -> None:
    """What the host does with an axis: it enables it, plans a motion, tunes it."""
    for axis in (m.z, m.theta):
        assert isinstance(axis, Axis)
        axis._accept = Quality.OUT_OF_RANGE if axis.encoder.quality < Quality.UNREFERENCED else HOMING
        what = random.randrange(4)
        if what == 0:
            axis._state = AxisState.DISABLED if axis.enabled else AxisState.STANDSTILL
            axis._interrupted = Interruption.NONE
            axis._stand()
        elif what == 1:
            Profile.to(axis.profile, axis.profile.setpoint.position + random.uniform(-3.0, 3.0) * axis.window)
        elif what == 2:
            axis.profile.at(random.uniform(-1.0, 1.0) * axis.velocity / 50)
        else:
            axis.following_error = 1e9 if random.random() < 0.9 else 100.0 * axis.window


def act_on_reactors(m: Any, random: Random) -> None:
    """What the recipes of the batch plant do."""
    reactor = random.choice(m.reactors)
    reactor.setpoint = random.choice((nan, random.uniform(20.0, 90.0)))
    reactor.stirring = random.uniform(reactor.stirrer.minimum, reactor.stirrer.maximum)
    reactor.heating.gain = random.uniform(0.0, 50.0)


def act_on_belt(m: Any, random: Random) -> None:
    """What an operator tunes."""
    m.sorter.belt.deviation = random.uniform(0.0, 100.0)


def act_on_zones(m: Any, random: Random) -> None:
    """What heating up does, and an operator who tunes."""
    if random.random() < 0.1:
        m._clear()
    m.targets = np.array([random.uniform(20.0, 900.0) for _ in m.zones])
    m.ramp, m.most_faulted = random.uniform(0.1, 4.0), 1.0
    m.setpoints = np.nan_to_num(m.temperatures.read())
    m.heating.gain, m.heating.integral_time = random.uniform(0.0, 20.0), random.uniform(5.0, 400.0)
    m.following_error, m.margin, m.frozen_after = 1e9, 1e9, random.randint(2, 300)
    m.soaking, m.soak_errors = random.random() < 0.5, np.zeros(len(m.zones))


ACTS = {"ztheta": act_on_axes, "batch": act_on_reactors, "conveyor": act_on_belt, "furnace": act_on_zones}


@pytest.mark.parametrize("station", first(1, ACTS))
@pytest.mark.parametrize("late", [False, pytest.param(True, marks=pytest.mark.full)])
def test_a_station_is_equal_to_the_bit(station: str, late: bool, tmp_path: Path) -> None:
    random, box, act = Random(2), Fragile(), ACTS[station]
    missed = [random.choice((0, 0, 0, 0, 2, 5)) if late else 0 for _ in range(PERIODS)]
    machine = find(station).machine()
    running = connect(machine, wired(machine, box, VirtualTimer(missed)))
    inputs = [each.path for each in atoms(machine) if each.path != "timer"]
    set_inputs(box, inputs, [0] * len(inputs), [False] * len(inputs))
    with running as m:
        both = Beside.translated(running, box, tmp_path)
        without_host(m)
        following = random_inputs(both.model, random)
        for number in range(PERIODS):
            raws, failed = following()
            both.step(max(missed[number], 1), raws, failed, [False] * len(both.outputs))
            assert (number, both.difference()) == (number, "")
            if random.random() < 0.05:
                with suppress(UmoError):
                    act(m, random)
                if both.c.clear():
                    running.machine.equipment.clear(m)
                both.push()
        assert both.told[None] > PERIODS / 4
