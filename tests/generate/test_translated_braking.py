"""An axis on a controller that cannot plan: after missed periods it brakes, in C and in Python equal to the bit."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from helpers.generating import Beside, Fragile, needs_a_compiler, set_inputs, wired, without_host
from helpers.machines import timer
from helpers.slide import DT, Slide, servo, stepper
from helpers.tiers import first
from umo import Compound, DigitalSensor
from umo.control import Axis
from umo.control.inputs import HOMING
from umo.control.profile import Profile, Setpoint
from umo.cycle.connect import connect
from umo.testing import VirtualTimer

pytestmark = needs_a_compiler
PERIODS, MISSED = 700, 40
GENTLE: dict[str, Any] = {"velocity": 200.0, "acceleration": 1_000.0, "jerk": 50_000.0, "following_error": 50.0}
"""A servo that is late, and keeps its limits then."""


class Rail(Compound):
    x: Axis
    timer: DigitalSensor


class SlideBeside:
    """An axis on a slide, which the C moves, and the Python beside it."""

    def __init__(self, both: Beside, slide: Slide) -> None:
        self._both, self._slide, self.x = both, slide, both.running.root.x
        self._outputs = {text: slide.channel(text.rpartition(".")[2]) for text in both.outputs}

    def step(self, ticks: int) -> Setpoint:
        """One period of both, equal to the bit; the setpoint."""
        both, slide = self._both, self._slide
        for text, raw in zip(self._outputs, both.c.raws_out, strict=False):
            slide.write(self._outputs[text], raw)
        for _ in range(ticks):
            slide.advance()
        both.step(ticks, [slide.read(slide.channel("counter"))], [False], [False] * len(both.outputs))
        assert both.difference() == ""
        found: Setpoint = self.x.profile.setpoint
        return found


def travelled(
    axis: Axis, folder: Path, late: dict[int, int], then: Callable[[Beside, int], object] = lambda *_: None
) -> list[Setpoint]:
    """The setpoints of a motion to 70 mm on a controller without a host; `late` are ticks, by period."""
    machine, box, slide = Rail(x=axis, timer=timer()), Fragile(), Slide(10.0)
    running = connect(machine, wired(machine, box, VirtualTimer([late.get(n, 0) for n in range(PERIODS)])))
    set_inputs(box, ["x.encoder"], [0], [False])
    with running as m:
        both = Beside.translated(running, box, folder)
        without_host(m)
        m.x._accept = HOMING
        m.x.enable()
        without_host(m)
        Profile.to(m.x.profile, 60.0)
        both.push()
        beside, found = SlideBeside(both, slide), []
        for number in range(PERIODS):
            found.append(beside.step(late.get(number, 1)))
            then(both, number)
        return found


def steps(numbers: list[float]) -> list[float]:
    return [after - before for before, after in pairwise(numbers)]


@pytest.mark.full
def test_without_missed_periods_the_axis_arrives(tmp_path: Path) -> None:
    assert travelled(servo(**GENTLE), tmp_path, {})[-1] == pytest.approx((60.0, 0.0, 0.0))


@pytest.mark.parametrize("at", [150, *(pytest.param(at, marks=pytest.mark.full) for at in (50, 300, 470))])
def test_a_servo_axis_that_moves_brakes_within_its_limits_and_stands(at: int, tmp_path: Path) -> None:
    found = travelled(servo(**GENTLE), tmp_path, {at: MISSED})
    before, after = found[at - 1], found[at:]
    stop = before.velocity / 1_000.0 + 2.5 * 1_000.0 / 50_000.0
    assert before.velocity > 1.0
    stands = after[round(stop / DT) + 2]
    assert stands[1:] == (0.0, 0.0)
    assert found[-1] == stands
    speeds = [before.velocity, *(each.velocity for each in after)]
    assert min(speeds) >= -1e-9
    assert max(map(abs, steps(speeds))) <= 1_000.0 * DT * 1.001
    assert max(map(abs, steps([before.acceleration, *(each.acceleration for each in after)]))) <= 50_000.0 * DT * 1.001


@pytest.mark.full
def test_a_stepper_axis_stays_where_it_was_stopped(tmp_path: Path) -> None:
    found = travelled(stepper(), tmp_path, {500: MISSED})
    assert found[499].velocity > 10.0
    assert found[-1] == found[500]
    assert found[-1][1:] == (0.0, 0.0)


@pytest.mark.parametrize("make", first(1, [servo, stepper]))
@pytest.mark.full
def test_the_whole_controller_is_told_to_brake_and_says_when_it_stands(
    make: Callable[[], Axis], tmp_path: Path
) -> None:
    moved: list[bool] = []

    def brake(both: Beside, number: int) -> None:
        if number == 150:
            both.c.brake()
            both.running.root.x._brake()
        assert both.c.moves() is both.running.root.x._moves()
        moved.append(both.c.moves())

    found = travelled(make(), tmp_path, {}, brake)
    assert found[150].velocity > 1.0
    assert all(moved[:150])
    stands = moved.index(False)
    assert 150 < stands < 400
    assert not any(moved[stands:])
    assert found[-1].position < 50.0
