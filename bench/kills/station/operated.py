"""A machine with all that is kept over a restart, moving at random: numbers and counts, a tunable one, alarms of each
kind with an operator, a part with the states of PackML, and one with those of ISA-88."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import KW_ONLY
from random import Random
from typing import Annotated, Any

from umo import BinaryActuator, Compound, DigitalActuator, Number
from umo.control import next_period
from umo.errors import CommandRefused, TaskFailed
from umo.operation import PackML, Procedure, UnitMode
from umo.operation.alarms import Alarm, High
from umo.operation.alarms.alarm_states import Operation
from umo.operation.alarms.alarming import engine_of
from umo.operation.alarms.engine import AlarmRequest
from umo.operation.model import ABORT, STOP
from umo.operation.unit_states import UnitStates
from umo.states import OnOff

from .journal import Journal
from .objects import Keeping

MANY = 24
"""Alarms whose conditions take turns, beside the others."""
OPERATIONS = (Operation.ACKNOWLEDGE, Operation.RESET, Operation.SHELVE, Operation.UNSHELVE, Operation.REMOVE)
FLIPPED, OPERATED, COMMANDED, SHIFTED = 0.01, 0.3, 0.1, 0.01
"""Chance in each period that a condition changes, an alarm is operated, a unit is commanded, its mode is changed."""
SHELF = 0.1
"""s."""


class Work:
    """The sequences of both kinds of part: some periods each, now and then an error."""

    chance: Random
    produced: int
    rejected: int

    async def _some_periods(self) -> None:
        for _ in range(self.chance.randrange(8)):
            await next_period()
        if self.chance.random() < 0.02:
            raise TaskFailed("it has failed at random")

    async def execute(self) -> None:
        while self.chance.random() < 0.95:
            await self._some_periods()
            await next_period()
            if self.chance.random() < 0.2:
                self.rejected += 1
            else:
                self.produced += 1

    async def holding(self) -> None:
        await self._some_periods()

    async def stopping(self) -> None:
        await self._some_periods()

    async def aborting(self) -> None:
        await self._some_periods()


class Filling(Work, PackML):
    async def starting(self) -> None:
        await self._some_periods()

    async def suspending(self) -> None:
        await self._some_periods()

    async def completing(self) -> None:
        await self._some_periods()


class Brewing(Work, Procedure):
    async def pausing(self) -> None:
        await self._some_periods()


class Part(Compound, equipment=True, alarms={"fast": Alarm(High("speed", 7.0, deadband=3.0), "it is fast")}):
    valve: BinaryActuator[OnOff]
    speed: DigitalActuator
    unit: Any = None


class Filler(Part):
    def setup(self) -> None:
        self.unit = Filling(self)


class Brewer(Part):
    def setup(self) -> None:
        self.unit = Brewing(self)


def _is(name: str) -> Callable[[Any], bool]:
    return lambda m: m.conditions[name]


def _fails(m: Any) -> bool:
    if m.conditions["odd"]:
        raise ValueError("it cannot be evaluated")
    return bool(m.conditions["plain"])


CONDITIONS = ("plain", "latched", "quiet", "delayed", "odd", *(f"many{i}" for i in range(MANY)))


class Operated(
    Keeping,
    alarms={
        "plain": Alarm(_is("plain"), "plain"),
        "latched": Alarm(_is("latched"), "latched", latch=True),
        "quiet": Alarm(_is("quiet"), "needs no acknowledgement", latch=True, acknowledge=False),
        "delayed": Alarm(_is("delayed"), "delayed", on_delay="50 ms", off_delay="30 ms"),
        "odd": Alarm(_fails, "cannot be evaluated at times"),
        **{f"many{i}": Alarm(_is(f"many{i}"), "one of many", latch=i % 2 == 0) for i in range(MANY)},
    },
):
    """Everything moves in each period, and `Journal` has what there was."""

    _: KW_ONLY
    filler: Filler
    brewer: Brewer
    target: Annotated[float, Number("mm", -1e6, 1e6, kept=True, tunable=True)] = 0.0

    def setup(self) -> None:
        self.conditions = dict.fromkeys(CONDITIONS, False)
        self.chance = Random()
        self.filler.unit.chance = self.brewer.unit.chance = self.chance

    def begin(self) -> None:
        self._machine.whole.observers.insert(0, Journal(self))  # before the frame: none is without its row
        self.cycle.start(self._operate())

    async def _operate(self) -> None:
        chance = self.chance
        while True:
            await next_period()
            for name in CONDITIONS:
                self.conditions[name] ^= chance.random() < FLIPPED
            for part in (self.filler, self.brewer):
                if not part.cycle.fault:
                    part.speed.write(chance.uniform(0.0, 10.0))
                    part.valve.write(chance.choice(list(OnOff)))
                self._command(part.unit)
            if chance.random() < OPERATED:
                self._operate_an_alarm()
            if chance.random() < FLIPPED:
                self.target = chance.uniform(-1e6, 1e6)

    def _command(self, unit: UnitStates) -> None:
        chance = self.chance
        try:
            if chance.random() < COMMANDED:
                forward = [name for name in unit.possible if name not in (STOP, ABORT)]
                unit.command(chance.choice(forward or list(unit.model.commands)))
            if chance.random() < SHIFTED:
                unit.command(chance.choice(list(unit.model.commands)))
            if chance.random() < SHIFTED:
                unit.change_mode(chance.choice(list(UnitMode)))
            if chance.random() < SHIFTED:
                unit.reset_counters()
        except CommandRefused:
            pass

    def _operate_an_alarm(self) -> None:
        alarms = engine_of(self._machine.whole)  # type: ignore[attr-defined]
        assert alarms is not None
        row = self.chance.randrange(len(alarms.paths))
        wanted = self.chance.choice(OPERATIONS)
        operation = Operation.RETURN if alarms.able([row], Operation.RETURN) else wanted
        if alarms.able([row], operation):
            alarms.request([row], AlarmRequest(operation, "operator", SHELF, "at random"))


def operated(parts: dict[str, Any]) -> Operated:
    return Operated(**parts, filler=Filler(**_part()), brewer=Brewer(**_part()))


def _part() -> dict[str, Any]:
    return {
        "valve": BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF),
        "speed": DigitalActuator("rpm", default=0.0, minimum=0.0, maximum=10.0, resolution=0.1),
    }
