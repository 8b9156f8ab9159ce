"""A period of a connected machine: its phases in their order (`PHASES`), and the calls that a machine binds to them.

`sample`, `control` and `update` are the interface for programs with their own loops. In `sample` and `update` a
DriverError of one phase does not stop the next phase; one error lists the failures of all phases. In `control` an error
that no equipment contains ends the call. Phases without work are not called: each machine binds its calls once. In
every phase the claims decide who drives an actuator (`claim_table`, `umo.objects.claims`).
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
    """A phase of each period."""

    call: str
    """The call (`sample`, `control` or `update`) to which the phase belongs in a program with its own loop."""
    name: str
    does: str
    error: str
    """The consequence of an error in the phase."""
    where: str
    """The modules of umo that implement the phase."""


TICK, SAMPLE, CONTROL, UPDATE = "timer.read()", "sample()", "control()", "update()"
CONTAINED = "in equipment: a fault of it; elsewhere: raised"
LISTED = "in equipment: a fault of it; elsewhere: raised after the other phases of its call"
UNREAD = f"objects become BAD; {LISTED}"
PHASES = (
    PeriodPhase(TICK, "BEFORE TICK", "finish an unfinished period; exchange with drivers off the cycle", "raised",
        "cycle/off_cycle"),
    PeriodPhase(TICK, "TICK", "wait for the tick; advance the clock; look for drivers that are away", "raised",
        "cycle/clock, drivers_away"),
    PeriodPhase(SAMPLE, "SEND LATE", 'with `outputs = "at next tick"`: expire commands, send the outputs that wait',
        LISTED, "cycle/guards, image"),
    PeriodPhase(SAMPLE, "RECEIVE", "check the ages of the values from drivers off the cycle", UNREAD,
        "cycle/off_cycle"),
    PeriodPhase(SAMPLE, "SAMPLE", "read the sensors of the machine; those of all rates, if nothing calls `update`",
        UNREAD, "cycle/image, readings"),
    PeriodPhase(SAMPLE, "GUARD", "evaluate interlocks (a condition that raises an error holds) and expiries; send "
        "the defaults that asynchronous actuators still need", LISTED, "cycle/guards, inhibition"),
    PeriodPhase(CONTROL, "COMMANDS", "carry out commands of clients, then the laws that supervise sequences", CONTAINED,
        "operation/commands, operation/supervisors"),
    PeriodPhase(CONTROL, "SEQUENCES", "advance each sequence of the machine by one step", CONTAINED, "cycle/sequences"),
    PeriodPhase(CONTROL, "LAWS", "call the laws of the machine, a parent's before those of its parts", CONTAINED,
        "cycle/acting_laws"),
    PeriodPhase(CONTROL, "SETTLE", "on demand: reset the actuators that nobody drives", "raised",
        "operation/commands/suspension"),
    PeriodPhase(UPDATE, "SEND", 'send the outputs of the machine; only note them with `outputs = "at next tick"`',
        LISTED, "cycle/image, deliveries"),
    PeriodPhase(UPDATE, "GROUPS", "parts with rates of their own that are due: SAMPLE and GUARD for all together, then "
        "SEQUENCES, LAWS and SEND for each, the fastest first", "as in the same phase of the machine",
        "cycle/rate_groups, part_periods"),
    PeriodPhase(UPDATE, "OWED", "send the outputs that do not wait for the period of their part", LISTED,
        "cycle/part_periods"),
    PeriodPhase(UPDATE, "SHOW", "evaluate alarms, then write events and logs, then frames, then call observers",
        "raised, after all outputs", "operation/alarms, cycle/events, showing"),
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
        """The functions that `show` calls at the end of SHOW."""
        self.show: Callable[[], object] = bool
        """The function that calls the observers, if there are any."""
        self.before_tick: list[Callable[[], object]] = []
        """The functions that are called in BEFORE TICK. Functions of `before_tick`, `receiving` and `before_send` must
        be added before the calls are bound."""
        self.receiving: list[Callable[[], object]] = []
        """Functions that are called in RECEIVE."""
        self.before_send: list[Callable[[], object]] = []
        """Functions that are called before SEND."""
        self.commanding: list[Callable[[], object]] = []
        """Functions that are called in COMMANDS, in this order."""
        self.before_laws: list[Callable[[], object]] = []
        """Functions that are called before the laws of each group, and may replace them."""
        self.showing: list[Callable[[], object]] = []
        """Functions that are called in SHOW, before events are formatted."""
        self.settling: list[Callable[[], object]] = []
        """Functions that are called once, in the next SETTLE."""
        self.open = False
        """True if a period has begun and was not finished yet."""
        self.began = 0
        """The time in ns of the period's tick (`time.monotonic_ns`)."""
        self.late = outputs == AT_NEXT_TICK
        """True if outputs wait for the next tick."""
        self.read: Callable[[], bool] = image.sample
        """The call of the phase SAMPLE."""
        self.send: Callable[[], bool] = image.update
        """The call of the phase SEND."""
        self.carry_out: Callable[[], bool] | None = None
        """The call of the phases GROUPS and OWED, if parts do not have the machine's rate
        (`umo.cycle.part_periods`)."""
        self.several: Callable[[], int] | None = None
        """The function that carries out the next period, or several periods if none of them needs Python. It returns
        the number of periods, or 0 if a stop has ended the wait for a tick. It replaces the calls of the standard
        loop."""
        self._clock.on_tick = self.on_tick
        self._send: Callable[[], bool]
        """The call of the phases SEND to OWED."""
        self.sample_all: Callable[[], bool]
        """The call of the phases RECEIVE to GUARD of all groups, for the first sample."""
        self.sample: Callable[[], bool]

    def bind(self) -> None:
        """Choose the calls that this machine needs. Call this function when everything is attached."""
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
        """Begin a period after the timer has been read."""
        self.open = True
        self.began = monotonic_ns()

    def finish(self) -> None:
        """Carry out SHOW for a period that failed or whose `update` was not called. This happens before the wait for
        the next tick."""
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
        """Carry out COMMANDS to SETTLE for the whole machine."""
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
        """Carry out LAWS and SETTLE for the whole machine."""
        if self._laws.stale:
            self._laws.choose()
        self._laws.act(self._laws.whole.laws)
        if self.settling and self.carry_out is None:
            self.settle()

    def settle_once(self, call: Callable[[], object]) -> None:
        """Call a function once after the laws of this period. In this period the laws of all groups act, even if they
        are not due."""
        if call not in self.settling:
            self.settling.append(call)

    def settle(self) -> None:
        """Carry out SETTLE."""
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
        """Carry out SEND to SHOW after some of the outputs were sent. The given function sends the other outputs."""
        usual = self._send
        self._send = send if self.carry_out is None else partial(both, send, self.carry_out)
        try:
            return self.update()
        finally:
            self._send = usual

    def _finish(self) -> None:
        """Carry out SHOW after the outputs of the period were sent. A period in which sending fails is finished when
        the machine has been reset, or before the next period."""
        self.open = False
        for call in self.showing:
            call()
        if self._events.untold:
            self._events.tell()
        if self.observers:
            self.show()


class LateOutputs:
    """`outputs = "at next tick"`: the outputs of a period are sent with the next `sample`."""

    def __init__(self, send: Callable[[], bool], expire: Callable[[], object]) -> None:
        self._send, self._expire = send, expire
        self._waiting = False
        """True if outputs are waiting."""

    def note(self) -> bool:
        """Record that a period has computed its outputs. If outputs already wait because there was no `sample`, send
        them now."""
        waiting, self._waiting = self._waiting, True
        return not waiting or self._send()

    def send_and_sample(self, sample: Callable[[], bool]) -> bool:
        """Send the waiting outputs that have not expired, then read the sensors."""
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
    """Return a function that makes these calls and then the last call. If there are no other calls, return the last one
    itself."""
    if not calls:
        return last

    def in_turn() -> T:
        for call in calls:
            call()
        return last()

    return in_turn


def begun(finish: Callable[[], object], look: Callable[[], object], sample: Callable[[], bool]) -> bool:
    """Carry out the `sample` of a machine without a timer: finish the last period, begin a new one, and sample."""
    finish()
    look()
    return sample()


def then_guard(sample: Callable[[], bool], evaluate: Callable[[], object]) -> bool:
    """Carry out a phase, then evaluate the guards, even if sensors failed. Return the result of the phase."""
    good = or_guard(sample, evaluate)
    evaluate()
    return good


def or_guard(sample: Callable[[], bool], evaluate: Callable[[], object]) -> bool:
    """Carry out a phase, and evaluate the guards if sensors failed. Return the result of the phase."""
    try:
        return sample()
    except DriverError as unread:
        go_on(unread, evaluate, "could not be read or reset")


def both(first: Callable[[], bool], second: Callable[[], bool]) -> bool:
    """Carry out two phases, the second one even if the first fails. Return True if both are good."""
    try:
        good = first()
    except DriverError as unsent:
        go_on(unsent, second, "could not be written or read")
    return second() and good


def go_on(failed: DriverError, then: Callable[[], object], what: str) -> NoReturn:
    """Carry out the next phase of a period after a phase has failed, and raise the failures of both."""
    try:
        then()
    except DriverError as error:
        raise DriverError(what, [*failed.failures, *error.failures]) from failed
    raise failed
