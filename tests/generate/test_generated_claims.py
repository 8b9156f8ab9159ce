"""Who drives an output of a generated controller: the table of claims (`helpers/claims_model.py`) beside its C.

The C takes the steps of the model that a controller has: a period begins with its conditions, the control code writes
or fails, the outputs are sent and perhaps not accepted, somebody acknowledges or clears. Clients, resting work and
devices that come back are the host's.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product
from pathlib import Path
from random import Random
from typing import Any, NamedTuple

import pytest

from helpers.claims_model import BAD, DEFAULT, FAILED, GOOD, STALE, STOPS, Answer, Kind, Lock, Output, Rank
from helpers.generating import KINDS as FAULTS
from helpers.generating import Fragile, needs_a_compiler, wired
from helpers.machines import actuator, sensor, timer
from helpers.tiers import some
from tools.compiled_machine import CompiledMachine, compiled
from umo import Compound, DigitalActuator, DigitalSensor, Interlock
from umo.control import value_of
from umo.generate.controller_folder import TARGETS, files_of, write_folder
from umo.generate.controller_model import laid_out
from umo.generate.translator import translate
from umo.objects import Quality
from umo.testing import VirtualTimer

pytestmark = needs_a_compiler
PERIOD = 2.0**-10
"""s; sums are exact."""
NOTHING = -99
"""An order to write nothing."""
LOCKS = ((), (Lock(),), (Lock(latched=True),), (Lock(stops=True), Lock(latched=True)))
ALL = [
    Kind(*each)
    for each in product((True, False), (0, 2), (0, 2), (0, 1), LOCKS, (0, 1, 2))
    if each[0] or each[2:4] == (0, 0)
]
FEW = (
    Kind(expires=2, rate=1, locks=(Lock(stops=True), Lock(latched=True)), levels=2),
    Kind(retries=2, locks=(Lock(latched=True),), levels=1),
    Kind(synchronous=False, expires=2, locks=(Lock(),)),
)
"""What is compared in each run of the tests."""


class Part(Compound):
    """What writes the actuator: what it is ordered to."""

    valve: DigitalActuator
    order: DigitalSensor
    fails: DigitalSensor

    def control(self) -> None:
        if value_of(self.fails) > 0.5:
            raise RuntimeError("it was asked to")
        order = value_of(self.order)
        if order > -50.0:
            self.valve.write(order)


class Inner(Part, equipment=True):
    pass


class Outer(Compound, equipment=True):
    inner: Inner
    fails: DigitalSensor

    def control(self) -> None:
        if value_of(self.fails) > 0.5:
            raise RuntimeError("it was asked to")


class Machine(Compound):
    timer: DigitalSensor
    around: Compound
    first: DigitalSensor
    second: DigitalSensor
    locks: tuple[Lock, ...] = ()

    def interlocks(self) -> Iterator[Interlock]:
        conditions = (lambda: value_of(self.first) > 0.5), (lambda: value_of(self.second) > 0.5)
        for number, (lock, condition) in enumerate(zip(self.locks, conditions, strict=False)):
            effect: Any = "stop" if lock.stops else "inhibit"
            yield Interlock(condition, [self.around], f"lock {number}", latched=lock.latched, effect=effect)


def machine_of(kind: Kind) -> Machine:
    limits: dict[str, Any] = {"expires": kind.expires * PERIOD} if kind.expires else {}
    limits |= {"slew_rate": kind.rate / PERIOD} if kind.rate else {}
    limits |= {"on_error": "retry", "max_age": kind.retries * PERIOD} if kind.retries else {}
    valve = actuator(default=float(DEFAULT), resolution=1.0, synchronous=kind.synchronous, **limits)

    def told(**more: Any) -> DigitalSensor:
        return sensor(minimum=-100.0, maximum=100.0, resolution=1.0, **more)

    around: Compound = (Inner if kind.levels else Part)(valve=valve, order=told(), fails=told())
    if kind.levels > 1:
        around = Outer(inner=around, fails=told())
    locks = [told(on_error="mark") for _ in range(2)]
    return Machine(timer=timer(), around=around, first=locks[0], second=locks[1], locks=kind.locks)


class Period(NamedTuple):
    """What happens in one period."""

    ticks: int
    conditions: Sequence[int]
    """Of each interlock: 0 or 1; 2: it cannot be evaluated."""
    order: int = NOTHING
    fails: int | None = None
    """The level of the equipment whose control code fails."""
    deaf: bool = False
    after: str = ""
    """What is done then: "acknowledge", "clear"."""
    reset: bool = False
    """Whether the actuator goes to its default before the outputs are sent."""


class Model(Output):
    """The circuit refuses values, and takes every default. Of a controller a reset goes with the outputs of its
    period."""

    def _reset(self) -> bool:
        self.broken, self.was_reset = False, True
        return super()._reset()

    def act(self, period: Period) -> Answer:
        """Until the outputs are sent; what the control code is answered."""
        self.was_reset = False
        self.begin(period.ticks, period.conditions)
        if period.fails is not None:
            return self.equipment_fails(period.fails)
        if period.order == NOTHING or any(self.faults):
            return None
        answer = self.write(period.order)
        if answer == STOPS and self.kind.levels:
            return self.equipment_fails(self.kind.levels - 1)
        return answer

    def end(self, period: Period, answer: Answer) -> tuple[Any, ...]:
        """What can be seen after a period."""
        self.broken = period.deaf
        sent = None if answer == STOPS else self.update()
        self.broken = False
        if period.after:
            getattr(self, period.after)()
        told = "Interlocked" if answer == STOPS else "DriverError" if sent == FAILED else None
        sure = {GOOD: Quality.GOOD, STALE: Quality.STALE, BAD: Quality.BAD}[self.sure]
        return told, self.pending, self.rank >= Rank.INTERLOCK, self.at, sure, self.faults


def at_random(kind: Kind, random: Random, count: int) -> Iterator[Period]:
    conditions = (0,) * len(kind.locks)
    for _ in range(count):
        if random.random() < 0.3:
            conditions = tuple(random.choice((0, 0, 0, 1, 2)) for _ in kind.locks)
        fails = random.randrange(kind.levels) if kind.levels and random.random() < 0.1 else None
        order = random.choice((NOTHING, NOTHING, DEFAULT, 3, -9)) if fails is None else NOTHING
        deaf = kind.synchronous and random.random() < 0.15
        after = random.choice(("", "", "acknowledge", "clear"))
        yield Period(random.choice((1, 1, 1, 2, 3)), conditions, order, fails, deaf, after)


class Controller:
    """The C of a machine."""

    def __init__(self, kind: Kind, folder: Path, *planted: str) -> None:
        """`planted`: a file of the runtime, what stands in it once, and what in its place."""
        machine, self.kind = machine_of(kind), kind
        wiring = wired(machine, Fragile(), VirtualTimer())
        wiring["wire"]["timer"]["period"] = PERIOD
        with laid_out(machine, wiring) as model:
            translation = translate(machine, model.conditions, model.steps, TARGETS["host"])
            write_folder(files_of(model, translation, TARGETS["host"]), folder)
        if planted:
            name, right, wrong = planted
            text = (folder / name).read_text("utf-8")
            assert text.count(right) == 1, f"{name} has not {right!r} once"
            (folder / name).write_text(text.replace(right, wrong), "utf-8")
        self.inputs = [each.path for each in model.objects[: model.inputs]]
        (self.slot,) = model.outputs
        self.library, self.faults = compiled(folder), FAULTS | {each.number: each.kind for each in translation.faults}
        self.fails = ["around.fails"] if kind.levels < 2 else ["around.fails", "around.inner.fails"]
        self.order = "around.inner.order" if kind.levels > 1 else "around.order"

    def begin(self, conditions: Sequence[int]) -> None:
        """The first reading, before any period."""
        self.c, self.level = CompiledMachine(self.library, len(self.inputs), 1), DEFAULT
        assert self.c.begin(self._raws(Period(0, conditions))) == 0

    def _raws(self, period: Period) -> list[int]:
        given = dict.fromkeys(self.inputs, 0) | {self.order: period.order}
        given |= dict(zip(("first", "second"), period.conditions, strict=False))
        given |= {} if period.fails is None else {self.fails[period.fails]: 1}
        return list(given.values())

    def step(self, period: Period) -> tuple[Any, ...]:
        """What can be seen after a period."""
        raws = self._raws(period)
        stopped = self.c.step(period.ticks, raws, [raw == 2 for raw in raws])
        fault = stopped or self.c.sent([period.deaf])
        if period.reset or self.c.changed or not (stopped or period.deaf):
            (self.level,) = self.c.raws_out
        while self.c.changed:
            self.c.sent()
        if period.after == "acknowledge":
            self.c.acknowledge()
        elif period.after == "clear" and any(self.in_fault):
            assert self.c.clear()
            (self.level,) = self.c.raws_out
        c, quality = self.c, Quality(self.c.quality(self.slot))
        return self.faults[fault], c.pending(0), c.inhibited(0), self.level, quality, self.in_fault

    @property
    def in_fault(self) -> tuple[bool, ...]:
        """Of the equipment around the actuator, the outer first."""
        return tuple(self.c.equipment_fault(level) != 0 for level in range(self.kind.levels))


def difference(controller: Controller, seed: int, count: int) -> str:
    """What the C does otherwise than the table, and when; "" if nothing."""
    model, before, conditions = Model(controller.kind), list[Period](), [1] * len(controller.kind.locks)
    controller.begin(conditions)
    model.begin(0, conditions)
    for number, period in enumerate(at_random(controller.kind, Random(seed), count)):
        answer = model.act(period)
        reset = model.was_reset
        before.append(period := period._replace(deaf=period.deaf and not reset, reset=reset))
        seen, expected = controller.step(period), model.end(period, answer)
        if seen != expected:
            return f"period {number}: {seen}, expected {expected}, after {before[-4:]}"
    return ""


@pytest.mark.parametrize(
    "kind", some(lambda kind: kind in FEW, (*FEW, *(each for each in ALL if each not in FEW))), ids=str
)
def test_a_generated_controller_does_what_the_table_says(kind: Kind, tmp_path: Path) -> None:
    controller = Controller(kind, tmp_path)
    for seed in range(2):
        assert difference(controller, seed, 1000) == ""


# Planted faults -----------------------------------------------------------------------------------------

OUTPUTS, EQUIPMENT = "umo_outputs.c", "umo_equipment.c"
UNKNOWN = "        holds = true;\n"
CLEARED = "        c->equipment[i].fault = UMO_OK;\n    }\n    umo_restrict"
ENTERED = "            umo_rest(o);\n    }\n    c->changed"
PLANTED = {
    "an interlock does not latch": (OUTPUTS, "(holds && of->latches", "(false && of->latches"),
    "it latches before the first period": (OUTPUTS, "of->latches && c->number > 0", "of->latches"),
    "an interlock resets nothing": (OUTPUTS, "if (output->due)\n", "if (false)\n"),
    "an interlock does not stop the program": (OUTPUTS, "output->stopping || of->stops", "output->stopping"),
    "a condition that cannot be evaluated is passed over": (OUTPUTS, UNKNOWN, UNKNOWN.replace("true", "false")),
    "what holds is acknowledged": (OUTPUTS, "if (!c->interlocks[i].held)", "if (true)"),
    "a write does not expire": (OUTPUTS, "output->pending = o->traits->rest; /*", "/*"),
    "a rate does not count": (OUTPUTS, "way = rate * step_time(o)", "way = 2 * rate * step_time(o)"),
    "it is sent again for a shorter time": (OUTPUTS, "since(o)) <= max_age", "since(o)) < max_age"),
    "a fault resets nothing": (EQUIPMENT, ENTERED, ENTERED.replace("umo_rest(o)", "(void)o")),
    "a fault inhibits nothing": (OUTPUTS, "if (umo_in_fault(c, object_at(c, i)->traits->equipment)) {", "if (false) {"),
    "a fault within a fault begins": (EQUIPMENT, "equipment->raised && !umo_in_fault(c, number)", "equipment->raised"),
    "the inner is not cleared": (EQUIPMENT, CLEARED, CLEARED.replace("UMO_OK", "i ? c->equipment[i].fault : UMO_OK")),
}
"""What the runtime would do otherwise."""
OFTEN = ("a fault resets nothing",)
WIDE = (FEW[0], Kind(retries=2, rate=1, locks=(Lock(latched=True),), levels=0), Kind(locks=LOCKS[3]), Kind(levels=2))


@pytest.mark.parametrize("name", some(lambda name: name in OFTEN, PLANTED))
def test_a_planted_fault_is_found(name: str, tmp_path: Path) -> None:
    found = ""
    for number, kind in enumerate(WIDE if name not in OFTEN else WIDE[:1]):
        (folder := tmp_path / f"{number}").mkdir()
        controller = Controller(kind, folder, *PLANTED[name])
        found = found or difference(controller, 0, 1000)
    assert found
