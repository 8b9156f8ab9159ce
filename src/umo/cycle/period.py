"""A period of a connected machine: its phases in their order (`PHASES`), and the calls that a machine binds to them.

`sample`, `control` and `update` are the interface of programs with loops of their own. In `sample` and `update` a
DriverError of one phase does not stop the next; one error lists the failures of all. In `control` an error that no
equipment contains ends the call. What a machine does not have is not called: each machine binds its own calls once.
Whichever phase writes an actuator: who drives it is decided by the claims (`claim_table`, `umo.objects.claims`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from time import monotonic_ns
from typing import Any, NamedTuple, NoReturn, TypeVar, cast

from umo.cycle.acting_laws import ActingLaws
from umo.cycle.clock import Clock, WallClock
from umo.cycle.events import Events
from umo.cycle.guards import Guards
from umo.cycle.image import Image
from umo.cycle.not_awaited import expects_errors
from umo.cycle.sequences import Sequences
from umo.errors import DriverError
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
    where: str
    """The modules of umo in which it stands."""


TICK, SAMPLE, CONTROL, UPDATE = "timer.read()", "sample()", "control()", "update()"
CONTAINED = "a fault of its equipment; of the machine: raised"
LISTED = "a fault of its equipment; of the machine: raised after the other phases of its call"
UNREAD = f"BAD objects, {LISTED}"
PHASES = (
    PeriodPhase(TICK, "BEFORE TICK", "finish an unfinished period; exchange with drivers off the cycle", "raised",
        "cycle/off_cycle"),
    PeriodPhase(TICK, "TICK", "wait; the clock goes on; drivers that are away are looked for", "raised",
        "cycle/clock, drivers_away"),
    PeriodPhase(SAMPLE, "SEND LATE", 'of `outputs = "at next tick"`: expire commands, then send what waits', LISTED,
        "cycle/guards, image"),
    PeriodPhase(SAMPLE, "RECEIVE", "judge the ages of what drivers off the cycle have brought", UNREAD,
        "cycle/off_cycle"),
    PeriodPhase(SAMPLE, "SAMPLE", "read the sensors of the whole; of all groups, where nobody calls `update`", UNREAD,
        "cycle/image, readings"),
    PeriodPhase(SAMPLE, "GUARD", "interlocks (a condition that raises holds), expiries, defaults that asynchronous "
        "actuators owe", LISTED, "cycle/guards, inhibition"),
    PeriodPhase(CONTROL, "COMMANDS", "what clients ask for, then the laws that look after sequences", CONTAINED,
        "operation/commands, operation/supervisors"),
    PeriodPhase(CONTROL, "SEQUENCES", "a step of each of the whole", CONTAINED, "cycle/sequences"),
    PeriodPhase(CONTROL, "LAWS", "those of the whole, a parent's before those of its parts", CONTAINED,
        "cycle/acting_laws"),
    PeriodPhase(CONTROL, "SETTLE", "on demand: what nobody is in charge of goes to its default", "raised",
        "operation/commands/suspension"),
    PeriodPhase(UPDATE, "SEND", 'the outputs of the whole; only noted with `outputs = "at next tick"`', LISTED,
        "cycle/image, deliveries"),
    PeriodPhase(UPDATE, "GROUPS", "parts with rates of their own that are due: SAMPLE and GUARD of all together, then "
        "SEQUENCES, LAWS and SEND of each, the fastest first", "as in the phase of the whole",
        "cycle/rate_groups, part_periods"),
    PeriodPhase(UPDATE, "OWED", "what does not wait for its group's period", LISTED, "cycle/part_periods"),
    PeriodPhase(UPDATE, "SHOW", "alarms, then events and logs, then frames, observers", "raised, after all outputs",
        "operation/alarms, cycle/events, showing"),
)  # fmt: skip
"""The phases in their order."""


class Period:
    """The calls of one machine's period."""

    def __init__(
        self,
        image: Image,
        guards: Guards,
        sequences: Sequences,
        laws: ActingLaws,
        outputs: str = AT_ONCE,
    ) -> None:
        self._image, self.guards, self._sequences, self._laws = image, guards, sequences, laws
        self._clock: Clock = image.clock
        self._events: Events = image.events
        self.observers: list[Callable[[Any], object]] = []
        """Called at the end of SHOW, by `show`."""
        self.show: Callable[[], object] = bool
        """Calls the observers, where there are any."""
        self.before_tick: list[Callable[[], object]] = []
        """What is called in BEFORE TICK; like `receiving` and `before_send` to be added before the calls are bound."""
        self.receiving: list[Callable[[], object]] = []
        """What is called in RECEIVE."""
        self.before_send: list[Callable[[], object]] = []
        """What is called before SEND."""
        self.commanding: list[Callable[[], object]] = []
        """What is called in COMMANDS, in this order."""
        self.before_laws: list[Callable[[], object]] = []
        """What is called before the laws of each group; it may replace them."""
        self.showing: list[Callable[[], object]] = []
        """Functions that are called in SHOW, before events are made."""
        self.settling: list[Callable[[], object]] = []
        """Functions that are called once, in the next SETTLE."""
        self.open = False
        """True if a period has begun and was not finished yet."""
        self.began = 0
        """Time in ns of its tick (`time.monotonic_ns`)."""
        self.late = outputs == AT_NEXT_TICK
        """True if outputs wait for the next tick."""
        self.read: Callable[[], bool] = image.sample
        """SAMPLE."""
        self.send: Callable[[], bool] = image.update
        """SEND."""
        self.carry_out: Callable[[], bool] | None = None
        """GROUPS and OWED, where parts have rates of their own (`umo.cycle.part_periods`)."""
        self.several: Callable[[], int] | None = None
        """Carries out the next period, or several of which nothing needs Python; how many, 0: a stop has ended the wait
        for a tick. It takes the place of the calls of the standard loop."""
        self._clock.on_tick = self.on_tick
        self._send: Callable[[], bool]
        """SEND to OWED."""
        self.sample_all: Callable[[], bool]
        """RECEIVE to GUARD of all groups, for the first sample."""
        self.sample: Callable[[], bool]

    def bind(self) -> None:
        """Choose the calls that this machine needs; to be called when everything is attached."""
        self._image.before_tick = preceded(self.before_tick, self.finish)
        send = preceded(self.before_send, self.send)
        self.sample_all = self._guarded(self._image.sample)
        sample = self._guarded(self.read)
        if self._image.timer < 0:
            sample = partial(begun, self.finish, cast(WallClock, self._clock).look, sample)
        if self.late:
            waiting = LateOutputs(send, self.guards.expire)
            send, sample = waiting.note, partial(waiting.send_and_sample, sample)
        self._send = send if self.carry_out is None else partial(both, send, self.carry_out)
        self.sample = sample

    # timer.read() --------------------------------------------------------------------------------------

    def on_tick(self) -> None:
        """The timer has been read."""
        self.open = True
        self.began = monotonic_ns()

    def finish(self) -> None:
        """SHOW a period that was not shown before the wait for the next tick, because it failed or `update` was not
        called."""
        if self.open:
            self._finish()

    # sample() ------------------------------------------------------------------------------------------

    def _guarded(self, sample: Callable[[], bool]) -> Callable[[], bool]:
        """Return RECEIVE and GUARD around a SAMPLE, if the machine has them."""
        sample = preceded(self.receiving, sample)
        return partial(then_guard, sample, self.guards.evaluate) if self.guards.any else sample

    # control() -----------------------------------------------------------------------------------------

    @expects_errors
    def control(self) -> None:
        """COMMANDS to SETTLE of the whole machine."""
        if self.commanding:
            for call in self.commanding:
                call()
        self._sequences.advance(self._clock)
        if self.before_laws:
            for call in self.before_laws:
                call()
        self.act()

    @expects_errors
    def act(self) -> None:
        """LAWS and SETTLE of the whole machine."""
        if self._laws.stale:
            self._laws.choose()
        self._laws.act(self._laws.whole.laws)
        if self.settling and self.carry_out is None:
            self.settle()

    def settle_once(self, call: Callable[[], object]) -> None:
        """Call it once, after the laws of this period: those of all groups act in it, also out of turn."""
        if call not in self.settling:
            self.settling.append(call)

    def settle(self) -> None:
        """SETTLE."""
        calls, self.settling = self.settling, []
        for call in calls:
            call()

    # update() ------------------------------------------------------------------------------------------

    def update(self) -> bool:
        """Carry out SEND to SHOW. Return True if every output was accepted."""
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

    def update_by(self, send: Callable[[], bool]) -> bool:
        """Carry out the same if a part of the outputs was sent already: this sends the rest."""
        usual = self._send
        self._send = send if self.carry_out is None else partial(both, send, self.carry_out)
        try:
            return self.update()
        finally:
            self._send = usual

    def _finish(self) -> None:
        """SHOW: the outputs of the period were sent; make the events of the period. A period in which sending fails is
        finished when the machine has been reset, or before the next one."""
        self.open = False
        for call in self.showing:
            call()
        if self._events.untold:
            self._events.tell()
        if self.observers:
            self.show()


class LateOutputs:
    """`outputs = "at next tick"`: what a period has computed is sent with the next `sample`."""

    def __init__(self, send: Callable[[], bool], expire: Callable[[], object]) -> None:
        self._send, self._expire = send, expire
        self._waiting = False
        """True if there is any."""

    def note(self) -> bool:
        """A period has computed its outputs. What waits already, with no `sample` since, is sent now."""
        waiting, self._waiting = self._waiting, True
        return not waiting or self._send()

    def send_and_sample(self, sample: Callable[[], bool]) -> bool:
        """Send what has not expired since, then read the sensors."""
        if not self._waiting:
            return sample()
        self._waiting = False
        self._expire()
        try:
            self._send()
        except DriverError as unsent:
            go_on(unsent, sample, "could not be written or read")
        return sample()


def preceded(calls: Sequence[Callable[[], object]], last: Callable[[], T]) -> Callable[[], T]:
    """A function that makes these calls and then the last one; that one itself where there are none."""
    if not calls:
        return last

    def in_turn() -> T:
        for call in calls:
            call()
        return last()

    return in_turn


def begun(finish: Callable[[], object], look: Callable[[], object], sample: Callable[[], bool]) -> bool:
    """The `sample` of a machine without a timer: with it the period begins."""
    finish()
    look()
    return sample()


def then_guard(sample: Callable[[], bool], evaluate: Callable[[], object]) -> bool:
    """Guards are evaluated even if sensors failed."""
    good = or_guard(sample, evaluate)
    evaluate()
    return good


def or_guard(sample: Callable[[], bool], evaluate: Callable[[], object]) -> bool:
    """Guards are evaluated if sensors failed."""
    try:
        return sample()
    except DriverError as unread:
        go_on(unread, evaluate, "could not be read or reset")


def both(first: Callable[[], bool], second: Callable[[], bool]) -> bool:
    """Return a function that carries out two phases and returns True if both are good."""
    try:
        good = first()
    except DriverError as unsent:
        go_on(unsent, second, "could not be written or read")
    return second() and good


def go_on(failed: DriverError, then: Callable[[], object], what: str) -> NoReturn:
    """Carry out the next phase of a period after one has failed, and raise the failures of both."""
    try:
        then()
    except DriverError as error:
        raise DriverError(what, [*failed.failures, *error.failures]) from failed
    raise failed
