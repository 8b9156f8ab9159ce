"""A period of a connected machine: its phases in their order (`PHASES`), and the calls that a machine binds to them.

`sample`, `control` and `update` are the interface of programs with loops of their own. In `sample` and `update` a
DriverError of one phase does not stop the next; one error lists the failures of all. In `control` an error that no
equipment contains ends the call. What a machine does not have is not called: each machine binds its own calls once.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from functools import partial
from math import inf
from time import monotonic_ns
from types import FunctionType, MethodType
from typing import Any, NamedTuple, NoReturn, TypeVar, cast

from umo.cycle.acting_laws import ActingLaws
from umo.cycle.clock import Clock, WallClock
from umo.cycle.columns import Block
from umo.cycle.command_stage import CommandStage
from umo.cycle.events import Events
from umo.cycle.frame import Observer
from umo.cycle.image import Image
from umo.cycle.not_awaited import expects_errors
from umo.cycle.rate_groups import PartGroup, RateGroups
from umo.cycle.sequences import Sequences
from umo.drivers.contract import Direction
from umo.drivers.wrapping import bare
from umo.errors import DriverError, Failure
from umo.text import count_of
from umo.wiring.wired import AT_NEXT_TICK, AT_ONCE

T = TypeVar("T")


class PeriodPhase(NamedTuple):
    """A part of each period."""

    call: str
    """The call of a program's own loop to which it belongs."""
    name: str
    does: str
    error: str
    """What an error in it means."""


TICK, SAMPLE, CONTROL, UPDATE = "timer.read()", "sample()", "control()", "update()"
CONTAINED = "a fault of its equipment; of the machine: raised"
LISTED = "a fault of its equipment; of the machine: raised after the other phases"
UNREAD = f"BAD objects, {LISTED}"
PHASES = (
    PeriodPhase(TICK, "BEFORE TICK", "finish an unfinished period; exchange with drivers off the cycle", "raised"),
    PeriodPhase(TICK, "TICK", "wait; the clock goes on; drivers that are away are looked for", "raised"),
    PeriodPhase(SAMPLE, "SEND LATE", 'of `outputs = "at next tick"`: expire commands, then send what waits', LISTED),
    PeriodPhase(SAMPLE, "RECEIVE", "judge the ages of what drivers off the cycle have brought", UNREAD),
    PeriodPhase(SAMPLE, "SAMPLE", "read the sensors of the whole; of all groups, where nobody calls `update`", UNREAD),
    PeriodPhase(SAMPLE, "GUARD", "interlocks, expiries, defaults that asynchronous actuators owe", LISTED),
    PeriodPhase(CONTROL, "COMMANDS", "what clients ask for, then the laws that look after sequences", CONTAINED),
    PeriodPhase(CONTROL, "SEQUENCES", "a step of each of the whole", CONTAINED),
    PeriodPhase(CONTROL, "LAWS", "those of the whole, a parent's before those of its parts", CONTAINED),
    PeriodPhase(CONTROL, "SETTLE", "on demand: what nobody is in charge of goes to its default", "raised"),
    PeriodPhase(UPDATE, "SEND", 'the outputs of the whole; only noted with `outputs = "at next tick"`', LISTED),
    PeriodPhase(UPDATE, "GROUPS", "parts with rates of their own that are due: SAMPLE and GUARD of all together, then "
        "SEQUENCES, LAWS and SEND of each, the fastest first", "as in the phase of the whole"),
    PeriodPhase(UPDATE, "OWED", "what does not wait for its group's period", LISTED),
    PeriodPhase(UPDATE, "SHOW", "alarms, then events and logs, then frames, observers", "raised, after all outputs"),
)  # fmt: skip
"""The phases in their order."""


class Period:
    """The calls of one machine's period. `show` is called at its end where somebody observes it."""

    def __init__(
        self,
        image: Image,
        commands: CommandStage,
        sequences: Sequences,
        laws: ActingLaws,
        groups: RateGroups,
        show: Callable[[], object],
        outputs: str = AT_ONCE,
    ) -> None:
        self._image, self._commands, self._sequences = image, commands, sequences
        self._laws, self._groups, self._show = laws, groups, show
        self._clock: Clock = image.clock
        self._events: Events = image.events
        self.observers: list[Observer] = []
        """Called after every period with its frame."""
        self.before_tick: list[Callable[[], object]] = []
        """What is called in BEFORE TICK; like `receiving` and `before_send` to be added before the calls are bound."""
        self.receiving: list[Callable[[], object]] = []
        """What is called in RECEIVE."""
        self.before_send: list[Callable[[], object]] = []
        """What is called before SEND."""
        self.commanding: list[Callable[[], object]] = []
        """What is called in COMMANDS, in this order."""
        self.before_laws: Callable[[], object] | None = None
        """Called before the laws of the whole machine; it may replace them."""
        self.showing: list[Callable[[], object]] = []
        """What is called in SHOW, before events are told."""
        self._settling: list[Callable[[], object]] = []
        """What is called in the next SETTLE, once."""
        self.open = False
        """Whether a period has begun and was not finished yet."""
        self.began = 0
        """Time in ns of its tick (`time.monotonic_ns`)."""
        self._unsent = False
        """Whether outputs wait for the next tick."""
        self._sampled = False
        """Whether a period was sampled and not updated yet."""
        self._clock.on_tick = self._tick
        self._late = outputs == AT_NEXT_TICK
        self._send: Callable[[], bool] = image.update
        self.sample_all: Callable[[], bool]
        """RECEIVE to GUARD of all groups, for the first sample."""
        self.sample: Callable[[], bool]
        self.update: Callable[[], bool]

    def bind(self) -> None:
        """Choose the calls that this machine needs; to be called when everything is attached."""
        self._image.before_tick = preceded(self.before_tick, self.finish)
        if self._groups.parts:
            self._send = partial(self._image.update, self._groups.whole.outputs)
        self._send = preceded(self.before_send, self._send)
        self.sample_all = self._guarded(self._image.sample)
        sample = self._begun(self._guarded(self._sample_groups) if self._groups.parts else self.sample_all)
        self.sample = partial(self._send_and_sample, sample) if self._late else sample
        if self._groups.parts:
            self.update = self._update_groups
        else:
            self.update = self._update_later if self._late else self._update

    def bound(self) -> dict[str, list[str]]:
        """Who has something to do in each phase, in words, by its name."""
        whole, items = self._groups.whole, self._image.items
        asked = sum(not item.synchronous for item in items if item.direction is Direction.OUTPUT)
        expiring = sum(command.expires < inf for command in self._commands.by_slot.values())
        interlocks = len(self._commands.inhibitions)
        guards = [(interlocks, "interlock"), (expiring, "expiring command"), (asked, "asynchronous actuator")]
        return {
            "BEFORE TICK": [*map(_called, self.before_tick)],
            "TICK": ["the timer" if self._image.timer >= 0 else "no timer: the wall clock"],
            "SEND LATE": ["the outputs of the period before"] if self._late else [],
            "RECEIVE": [*map(_called, self.receiving)],
            "SAMPLE": [_moved(block, "sensor") for block in whole.inputs],
            "GUARD": [count_of(number, noun) for number, noun in guards if number],
            "COMMANDS": [*map(_called, self.commanding)],
            "SEQUENCES": ["the application, actions, what these start"],
            "LAWS": [*map(_called, filter(None, [self.before_laws])), *map(_acting, whole.laws)],
            "SETTLE": [*map(_called, self._settling)],
            "SEND": [*map(_called, self.before_send), *(_moved(block, "actuator") for block in whole.outputs)],
            "GROUPS": [f"{part.path}, every {count_of(part.every, 'period')}" for part in self._groups.parts],
            "OWED": ["parts with rates of their own"] if self._groups.parts else [],
            "SHOW": [*map(_called, self.showing), "events", *map(_called, self.observers)],
        }

    # timer.read() --------------------------------------------------------------------------------------

    def _tick(self) -> None:
        self.open = True
        self.began = monotonic_ns()

    def finish(self) -> None:
        """Before the wait for the next tick: SHOW a period that was not shown, since it failed or nobody called
        `update`."""
        if self.open:
            self._finish()

    def skip_ticks(self) -> None:
        """Read the timer before the first period: the ticks until here belong to no period, and none is missed."""
        if self._image.timer >= 0:
            self._image.read_now(self._image.timer)
            self.open, self._clock.missed_in_all = False, 0
        self._groups.restart()

    # sample() ------------------------------------------------------------------------------------------

    def _guarded(self, sample: Callable[[], bool]) -> Callable[[], bool]:
        """RECEIVE and GUARD around a SAMPLE, as far as the machine has them."""
        asynchronous = (item for item in self._image.items if not item.synchronous)
        guarded = self._commands.by_slot or any(item.direction is Direction.OUTPUT for item in asynchronous)
        sample = preceded(self.receiving, sample)
        return partial(self._then_guard, sample) if guarded else sample

    def _begun(self, sample: Callable[[], bool]) -> Callable[[], bool]:
        """The `sample` of a machine without a timer: with it the period begins."""
        if self._image.timer >= 0:
            return sample
        look = cast(WallClock, self._clock).look

        def timeless() -> bool:
            self.finish()
            look()
            return sample()

        return timeless

    def _sample_groups(self) -> bool:
        """Where nobody calls `update`, those of parts are read all the same."""
        blocks = self._image.inputs if self._sampled else self._groups.whole.inputs
        self._sampled = True
        return self._image.sample(blocks)

    def _then_guard(self, sample: Callable[[], bool]) -> bool:
        """Guards are evaluated even if sensors failed."""
        try:
            good = sample()
        except DriverError as unread:
            go_on(unread, self._commands.evaluate, "could not be read or reset")
        self._commands.evaluate()
        return good

    def _send_and_sample(self, sample: Callable[[], bool]) -> bool:
        """Send what the period before has computed and has not expired since, then read the sensors."""
        if not self._unsent:
            return sample()
        self._unsent = False
        self._commands.expire()
        try:
            self._send()
        except DriverError as unsent:
            go_on(unsent, sample, "could not be written or read")
        return sample()

    # control() -----------------------------------------------------------------------------------------

    @expects_errors
    def control(self) -> None:
        """COMMANDS to SETTLE of the whole machine."""
        if self.commanding:
            for call in self.commanding:
                call()
        self._sequences.advance(self._clock)
        if self.before_laws is not None:
            self.before_laws()
        if self._laws.stale:
            self._laws.choose()
        self._laws.act(self._groups.whole)
        if self._settling and not self._groups.parts:
            self._settle()

    def settle_once(self, call: Callable[[], object]) -> None:
        """Call it once, after the laws of this period: those of all groups act in it, also out of turn."""
        if call not in self._settling:
            self._settling.append(call)

    def _settle(self) -> None:
        calls, self._settling = self._settling, []
        for call in calls:
            call()

    # update() ------------------------------------------------------------------------------------------

    def _update(self) -> bool:
        try:
            accepted = self._send()
        except BaseException:
            self.open = True  # also where this is not the first time in the period
            raise
        if self.observers or self.showing or self._events.untold:
            self._finish()
        else:
            self.open = False  # as `_finish` does, of which a call is 3 % of the period of a small machine
        return accepted

    def _update_later(self) -> bool:
        """The next `sample` sends what this period has computed. If there was none since the last `update`, it is sent
        now."""
        waiting, self._unsent = self._unsent, True
        self.open = True
        accepted = not waiting or self._send()
        self._finish()
        return accepted

    def _update_groups(self) -> bool:
        """The outputs of parts are sent at once all the same."""
        sends, self._unsent = not self._late or self._unsent, self._late
        self.open = True
        accepted = True
        if sends:
            try:
                accepted = self._send()
            except DriverError as unsent:
                go_on(unsent, self._carry_out, "could not be written or read")
        accepted = self._carry_out() and accepted
        self._finish()
        return accepted

    def _carry_out(self) -> bool:
        """GROUPS and OWED. A part that does not accept its outputs does not stop the others."""
        self._sampled = False
        if not (self._settling or self._groups.any_due):
            return self._send_urgent()
        due = self._groups.take_due()
        late = [part for part in self._groups.parts if part not in due] if self._settling else []
        for part in late:
            part.clock.measure()
        if self._laws.stale:
            self._laws.choose()
        sample = partial(self._image.sample, [block for part in (*due, *late) for block in part.inputs])
        if self._commands.by_slot:
            self._then_guard(sample)
        else:
            sample()
        accepted = True
        failed: list[Failure] = []
        for part in (*due, *late):
            self._control_part(part, in_turn=part not in late)
            try:
                accepted &= self._image.update(part.outputs, 0.0)  # a slew rate counts from the last step
            except DriverError as error:
                failed += error.failures
        if self._settling:
            self._settle()
        if failed:
            raise DriverError("could not be written", failed)
        return self._send_urgent() and accepted

    def _control_part(self, part: PartGroup, in_turn: bool) -> None:
        """Its sequences, in its own periods only, then its laws."""
        began = monotonic_ns()
        try:
            if in_turn:
                self._sequences.advance(part.clock, part.clock)
            self._laws.act(part)
        finally:
            part.took(monotonic_ns() - began)

    def _send_urgent(self) -> bool:
        """What does not wait for its part's period: defaults, and what an application had before it was suspended."""
        image = self._image
        if not image.urgent:
            return True
        image.urgent = {slot for slot in image.urgent if image.values[slot] != image.pending[slot]}
        return not image.urgent or image.update_some([slot for slot in self._commands.order if slot in image.urgent])

    def _finish(self) -> None:
        """SHOW: the outputs of the period are sent, and what has happened in it is told. A period in which sending
        fails is finished when the machine has been reset, or before the next one."""
        self.open = False
        for call in self.showing:
            call()
        if self._events.untold:
            self._events.tell()
        if self.observers:
            self._show()


def _called(call: Callable[..., object]) -> str:
    """The first sentence of what says itself what it is: the class of an object, or the function."""
    owner = getattr(call, "__self__", call)
    about = owner if isinstance(owner, FunctionType | type) else type(owner)
    return (inspect.getdoc(about) or about.__qualname__).partition(". ")[0].partition("\n")[0].rstrip(".")


def _moved(block: Block, kind: str) -> str:
    return f"{count_of(block.count, kind)} on {type(bare(block.driver)).__name__}"


def _acting(law: MethodType) -> str:
    owner: Any = law.__self__
    return f"{owner._path or 'the machine'} ({type(owner).__name__})"


def preceded(calls: Sequence[Callable[[], object]], last: Callable[[], T]) -> Callable[[], T]:
    """A function that makes these calls and then the last one; that one itself where there are none."""
    if not calls:
        return last

    def in_turn() -> T:
        for call in calls:
            call()
        return last()

    return in_turn


def go_on(failed: DriverError, then: Callable[[], object], what: str) -> NoReturn:
    """One phase of a period has failed: take the next one all the same, and raise what failed of both."""
    try:
        then()
    except DriverError as error:
        raise DriverError(what, [*failed.failures, *error.failures]) from failed
    raise failed
