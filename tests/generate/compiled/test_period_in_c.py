"""The period in C, beside the same machine whose periods are carried out by Python: equal in all that can be seen."""

from __future__ import annotations

from contextlib import ExitStack
from functools import partial
from random import Random
from typing import Any

import pytest

from helpers.controllers import MACHINES, Tried
from helpers.conversions import BUILT
from helpers.generating import Fragile, needs_a_compiler, random_inputs, set_inputs, told_by
from helpers.in_c import FragileInC, TimerInC
from helpers.publishing import without_times
from helpers.tiers import first
from umo import published
from umo.cycle.connect import connect
from umo.cycle.part_periods import PartPeriods
from umo.drivers import DeviceTimeout
from umo.generate.compiled_laws import CompiledLaws, prepare
from umo.generate.controller_model import laid_out
from umo.generate.period_in_c import PeriodInC
from umo.objects import Actuator, atoms
from umo.objects.sensors import Sensor
from umo.process.frames import Reader
from umo.testing import VirtualTimer
from umo.wiring import resolve

pytestmark = [needs_a_compiler, BUILT]


class Side:
    """One of the two machines, with compiled laws. `drivers_in_c`: whether its drivers have transfers in C; else they
    fail now and then as whole drivers, and so do their outputs."""

    def __init__(
        self,
        tried: Tried,
        missed: list[int],
        in_c: bool,
        stack: ExitStack,
        shown: bool = False,
        drivers_in_c: bool = True,
    ) -> None:
        self.m: Any = tried.make()
        self.box: Any = FragileInC() if drivers_in_c else Fragile()
        self.timer = (TimerInC if drivers_in_c else VirtualTimer)(missed, on_period=self._begin)
        self.drivers_in_c = drivers_in_c
        if in_c and drivers_in_c:
            self.box.declined = self.timer.declined = 0.02
        wired = resolve(self.m, tried.wiring(self.m, self.box, self.timer))
        prepared = prepare(self.m, wired)
        with laid_out(self.m, wired) as self.model:
            pass
        self.inputs = [each.path for each in self.model.objects[: self.model.inputs]]
        self.outputs = [each.path for each in atoms(self.m) if isinstance(each, Actuator)]
        sensors = [each.path for each in atoms(self.m) if isinstance(each, Sensor) and each.path != "timer"]
        set_inputs(self.box, sensors, [0] * len(sensors), [False] * len(sensors))
        self.plan: list[tuple[list[int], list[bool]]] = []
        """What the inputs are in each period, and which of them fail."""
        self.connection = connect(self.m, wired)
        stack.enter_context(self.connection)
        self.machine = self.connection.machine
        self.laws = self.machine.attach(CompiledLaws(prepared))
        self.period: Any = self.machine.attach(PeriodInC()) if in_c else None
        if shown:
            ring = stack.enter_context(published(self.connection, "tried"))
            self.reader = stack.enter_context(Reader(ring.path))

    def _begin(self, number: int) -> None:
        raws, failed = self.plan[number - 1]
        set_inputs(self.box, self.inputs, raws, failed)
        if number % 700 > 690:
            self.box.set(self.inputs[0], DeviceTimeout("gone"))
        if not self.drivers_in_c:
            self.box.deaf = frozenset(self.outputs[:1] if number % 90 == 45 else ())
            if number % 110 == 55:
                raise OSError("the timer is cut")

    def begin_again(self) -> None:
        """After an error, which ends the standard loop: in Python alone a program may have a loop of its own, where the
        sensors of all parts are read in the next period."""
        for parts in filter(None, [self.machine.find(PartPeriods)]):
            parts.sampled = False

    def one(self) -> None:
        """As the standard loop."""
        self.m.timer.read()
        self.m.sample()
        self.m.control()
        self.m.update()

    def facts(self) -> dict[str, Any]:
        columns, clock = self.machine.image.columns, self.machine.clock
        parts = [(each.due, each.clock.number, each.clock.dt, each.clock.ticks) for each in self.machine.groups.parts]
        names = (
            "values",
            "quality",
            "pending",
            "raws",
            "restrictions",
            "equipment",
            "axes",
            "times",
            "sent",
            "written",
        )
        return {
            **{name: getattr(columns, name).tobytes() for name in names},
            "clock": (clock.number, clock.now, clock.dt, clock.ticks, clock.missed, clock.missed_in_all),
            "parts": parts,
            "period": (self.machine.phases.open, self.machine.image.sampled_good, self.timer.reads),
            "laws": (self.laws.state, self.machine.sequences.current.law),
            "calls": [] if self.drivers_in_c else [len(self.box.calls), self.box.calls[-8:]],
            "fields": [
                repr(getattr(each.owner, name)) for each in self.laws._translation.structs for name in each.fields
            ],
            "events": [each.text for each in self.machine.events if not each.text.startswith("the period is")],
        }


NAMES = ["converter", "rates", "equipment", "batch", "conveyor", "objects"]


@pytest.mark.parametrize("name", first(2, NAMES))
def test_random_periods_are_the_same_in_c_and_in_python(name: str) -> None:
    """Inputs that fail, leave their ranges and trip interlocks; missed ticks; transfers that C leaves to Python. Of the
    converter nothing else needs Python."""
    c, carried, steps = _same_periods(name)
    assert c.box.moved_in_c > steps / 2 or name == "objects"
    assert carried > steps / 20 or name != "converter"


@pytest.mark.parametrize("name", first(2, NAMES))
def test_random_periods_that_call_drivers_in_python_are_the_same(name: str) -> None:
    """Each transfer is made once, also where it fails: of some channels, of the whole driver, of the timer."""
    c, carried, steps = _same_periods(name, drivers_in_c=False)
    assert c.period.drivers == {"box": "it has no transfers in C"} or name == "objects"
    assert "TICK" not in c.period.reasons
    assert carried > steps / 40 or name != "converter"


def _same_periods(name: str, drivers_in_c: bool = True) -> tuple[Side, int, int]:
    """Periods of both machines, which are compared; the one in C, how often it has carried out several at once, and
    how many they were."""
    random, steps = Random(name), {"converter": 600, "rates": 1_500}.get(name, 3_000)
    missed = [random.choice((0, 0, 0, 0, 0, 0, 2, 5)) for _ in range(steps)]
    with ExitStack() as stack:
        sides = [Side(MACHINES[name], missed, in_c, stack, drivers_in_c=drivers_in_c) for in_c in (False, True)]
        python, c = sides
        following = random_inputs(python.model, random)
        python.plan = c.plan = [following() for _ in range(steps)]
        carried = 0
        while c.timer.reads < steps:
            assert c.period is not None
            before = c.timer.reads
            error = told_by(partial(c.period.run, random.randint(1, min(50, steps - before)), None))
            told = None
            while python.timer.reads < c.timer.reads and told is None:
                told = told_by(python.one)
            assert (before, told) == (before, error)
            for side in sides if error else ():
                side.begin_again()
            assert _differences(python, c) == {}, before
            carried += c.timer.reads - before > 1
            if random.random() < 0.1:
                for side in sides:
                    told_by(partial(side.machine.equipment.clear, side.m))
                    side.m.acknowledge()
        assert c.laws.state == "compiled"
        return c, carried, steps


def _differences(python: Side, c: Side) -> dict[str, Any]:
    one, other = python.facts(), c.facts()
    return {name: (one[name], other[name]) for name in one if one[name] != other[name]}


def test_the_frames_of_periods_in_c_are_those_of_python() -> None:
    """And their journals: which transfers were made, and in which order; transfers that fail and are repeated too."""
    random, steps = Random(5), 400
    missed = [random.choice((0, 0, 0, 3)) for _ in range(steps)]
    with ExitStack() as stack:
        python, c = (Side(MACHINES["converter"], missed, in_c, stack, shown=True) for in_c in (False, True))
        following = random_inputs(python.model, random)
        python.plan = c.plan = [following() for _ in range(steps)]
        for _ in range(steps):
            assert told_by(python.one) == told_by(partial(c.period.run, 1, None))
            assert _shown(python) == _shown(c)
        assert c.laws.state == "compiled"
        assert c.box.moved_in_c > steps


SHOWN = ("number", "time", "missed", "sampled", "updated", "entries", "values", "raws", "quality", "restrictions")


def _shown(side: Side) -> list[object]:
    """The last frame with its journal, without the times of this computer."""
    side.machine.phases.finish()  # of a period that has failed
    frame = side.reader.latest()
    assert frame["phases"][0] > 0  # the timer
    return [*(frame[name].tobytes() for name in SHOWN), without_times(side.reader.journal(frame))]
