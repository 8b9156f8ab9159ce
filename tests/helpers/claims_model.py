"""Who drives an output, and what becomes of a write: the table of claims as a model of one actuator.

The greatest rank that is in force has the output: FAULT > INTERLOCK > CLIENT > PROGRAM. FAULT has a level for each
equipment around the actuator, INTERLOCK one for each interlock that names it; with any of these only the default is
sent. CLIENT is exclusive. PROGRAM is the last write of whoever else. Resting and expiry are no ranks: they move the
output, and yield to every later write.

One function an event, which gives the answer of the machine. Values are whole numbers, times are whole ticks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from operator import and_
from typing import Any, NamedTuple

DEFAULT = 1
"""Another one than what a circuit has that was never written."""
STOPS, REFUSED, FAILED = "Interlocked", "refused", "failed"
"""Answers beside True, False and None: an interlock stops the program, a client is refused, a device did not accept."""
ENOUGH = 32
"""Ticks in which a rate leads everywhere."""
GOOD, STALE, BAD = 0, 1, 2
"""What is known of the last transfer: accepted, to be sent again by on_error="retry", failed."""
Answer = bool | str | None


class Rank(IntEnum):
    PROGRAM = 0
    CLIENT = 1
    INTERLOCK = 2
    FAULT = 3


class Lock(NamedTuple):
    """An interlock that names the actuator."""

    latched: bool = False
    stops: bool = False
    """Whether its effect is "stop"."""


@dataclass(frozen=True)
class Kind:
    """An actuator as it is declared; 0: not."""

    synchronous: bool = True
    expires: int = 0
    retries: int = 0
    """`max_age` with on_error="retry"."""
    rate: int = 0
    """Units a tick."""
    locks: tuple[Lock, ...] = ()
    levels: int = 0
    """Number of the equipment around it, one within another."""
    every: int = 0
    """The rate of its part: every so many ticks."""
    late: bool = False
    """Whether outputs are sent at the next tick."""

    def __str__(self) -> str:
        words = ["synchronous" if self.synchronous else "asynchronous"]
        words += [
            f"{name}-{getattr(self, name)}" for name in ("expires", "retries", "rate", "every") if getattr(self, name)
        ]
        words += [f"lock{'-latched' * each.latched}{'-stops' * each.stops}" for each in self.locks]
        words += [f"levels-{self.levels}"] * (self.levels > 0) + ["late"] * self.late
        return "-".join(words)


class Seen(NamedTuple):
    """What can be seen of an actuator after each event."""

    answer: Answer
    pending: float
    rank: Rank
    reason: str
    """Why the program cannot write another value than the default."""
    at: float
    """The level at the circuit."""
    sure: int
    told: list[str]


@dataclass
class Output:
    """One actuator."""

    kind: Kind
    # What holds it
    faults: tuple[bool, ...] = ()
    """Of the equipment around it, the outer first."""
    holds: tuple[bool, ...] = ()
    """The conditions of its interlocks when they were last asked."""
    latched: tuple[bool, ...] = ()
    """Whether each interlock inhibits until it is acknowledged."""
    client: bool = False
    # What is to be sent
    pending: int = DEFAULT
    armed: int | None = None
    """Ticks since the last write that was admitted; None: there is none that could expire."""
    left: int | None = None
    """What resting work has left."""
    # What the device has
    at: int = DEFAULT
    broken: bool = False
    """Whether its device refuses every call."""
    sure: int = GOOD
    owed: bool = False
    """Whether a default was not accepted: an asynchronous one is reset in each period, a rate does not count for it."""
    tried: int | None = None
    """Asynchronous: ticks since the first attempt that was not confirmed."""
    confirmed: int = 0
    """Synchronous: ticks since the last confirmation."""
    sent: int = DEFAULT
    moved: bool = True
    """With a rate: whether it has had its step since the last tick; `ticks`: how long that took."""
    ticks: int = 1
    due: int = 0
    """Ticks until its part is due."""
    urgent: bool = False
    """Whether it is sent although its part is not due."""
    # What is told
    waits: bool = False
    """Whether an `update` waits for the next tick."""
    in_period: bool = False
    """Whether the first tick has come: nothing latches before."""
    untold: tuple[bool, ...] = ()
    """The interlocks that have begun during a fault."""
    told: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        self.faults = (False,) * self.kind.levels
        self.due = self.kind.every
        self.holds = self.latched = self.untold = (False,) * len(self.kind.locks)

    # The table -----------------------------------------------------------------------------------------

    @property
    def inhibits(self) -> list[bool]:
        """Whether each interlock is in force."""
        return [holds or latched for holds, latched in zip(self.holds, self.latched, strict=True)]

    @property
    def rank(self) -> Rank:
        if any(self.faults):
            return Rank.FAULT
        return Rank.INTERLOCK if any(self.inhibits) else Rank.CLIENT if self.client else Rank.PROGRAM

    def write(self, value: int) -> Answer:
        """The program, a law, a sequence or an action writes."""
        answer = self._admits(value)
        return self._take(value) if answer is True else answer

    def write_vector(self, value: int) -> Answer:
        """The same by a Vector."""
        return self.write(value)

    def client_writes(self, value: int) -> Answer:
        if self.rank >= Rank.INTERLOCK:
            return REFUSED
        self.client = True
        if (answer := self._take(value)) is True:
            return True
        self.client = False
        self._send_default()
        return answer or REFUSED

    def let_go(self) -> Answer:
        """Also the dead man's end, the end of a lease and a change of the mode."""
        if not self.client:
            return REFUSED
        self.client = False
        self._send_default()
        return True

    def dead_man(self) -> Answer:
        self.let_go()
        return None

    def equipment_fails(self, level: int) -> Answer:
        if not any(self.faults[: level + 1]):  # else it is an error in the cleaning up of the fault
            self.faults = _with(self.faults, level, True)
            self.client, self.left = False, None
            self._reset()
        return None

    def clear(self) -> Answer:
        if not any(self.faults):
            return None
        if not self._initialize():
            return FAILED
        self.faults = (False,) * self.kind.levels
        for number, (untold, inhibits) in enumerate(zip(self.untold, self.inhibits, strict=True)):
            self._tell("inhibited", f"lock {number}", untold and inhibits)
        self.untold = (False,) * len(self.untold)
        return None

    def reset(self) -> Answer:
        """By the program: no client has it any longer."""
        self.client = False
        return self._reset_due()

    def _reset_due(self) -> Answer:
        if self._reset():
            return None
        if self._will_be_sent_again():
            self.owed = self.owed and self.kind.synchronous
            return None
        return self._fail()

    def acknowledge(self) -> Answer:
        self.latched = tuple(map(and_, self.latched, self.holds))
        return self.rank <= Rank.CLIENT

    def rest(self) -> Answer:
        """The work waits; its reaction is "default". What a client has is not the work's."""
        if self.pending != DEFAULT and not self.client:
            self.left = self.pending
            self._send_default()
        return None

    def go_on(self) -> Answer:
        """What was left is lost if it is refused: that is told, and raises nothing."""
        left, self.left = self.left, None
        if left is None or self.pending != DEFAULT:
            return None
        answer, self.urgent = self.write(left), True
        self._tell("not restored", "", answer in (False, STOPS))
        return FAILED if answer == FAILED else None

    def initialized_again(self) -> Answer:
        """The device was away, and is at its default. A client keeps the output where its value is sent again."""
        if self.broken:
            return FAILED
        self._accepted(DEFAULT)
        self.moved = self.urgent = True
        if not (self.kind.synchronous or self.kind.retries):
            self.pending, self.armed, self.client = DEFAULT, None, False
        elif not self.kind.synchronous and self.pending != DEFAULT:
            self.tried, self.sure = 0, STALE
        return None

    def breaks(self, broken: bool) -> Answer:
        self.broken = broken
        return None

    # A period ------------------------------------------------------------------------------------------

    def begin(self, ticks: int, conditions: Sequence[int]) -> Answer:
        """The tick, then `sample`: late outputs are sent, and what was not confirmed again; the guards are asked."""
        self._pass(ticks)
        answer = self._send_late() if self.waits else None
        if self.tried is not None and self.sure == STALE and not self._send():
            answer = self._fail() or answer
        return self._guard(conditions) or answer

    def _send_late(self) -> Answer:
        self.waits = False
        if self.kind.synchronous:
            self._expire()
        return FAILED if self._send_period() == FAILED else None

    def _guard(self, conditions: Sequence[int]) -> Answer:
        due = self.owed and not self.kind.synchronous
        for number, (lock, condition) in enumerate(zip(self.kind.locks, conditions, strict=True)):
            due = self._ask(number, lock, bool(condition)) or due
        if not due and self._expire():
            due = not self.kind.synchronous
        return self._reset_due() if due else None

    def _expire(self) -> bool:
        """Whether the last write has expired. The default of a synchronous one is sent with the period."""
        if self.client or self.armed is None or self.armed < self.kind.expires:
            return False
        self._tell("expired", "", self.pending != DEFAULT)
        self._at_default()
        return True

    def _ask(self, number: int, lock: Lock, condition: bool) -> bool:
        """Whether an interlock begins."""
        begins, in_fault = condition and not self.inhibits[number], any(self.faults)
        self.holds = _with(self.holds, number, condition)
        if condition and lock.latched and self.in_period:
            self.latched = _with(self.latched, number, True)
        if begins:
            self.client = False
            self._tell("inhibited", f"lock {number}", not in_fault)
            self.untold = _with(self.untold, number, self.untold[number] or in_fault)
        return begins

    def update(self) -> Answer:
        """The period's outputs are sent, or wait for the next tick."""
        waiting, self.waits = self.waits, self.kind.late
        if self.kind.every:
            return self._send_part()
        return self._send_period() if waiting or not self.kind.late else True

    def _send_part(self) -> Answer:
        """What is urgent does not wait until the part is due."""
        accepted: Answer = True
        if self.due <= 0:
            self.due += self.kind.every
            if self._guard(self.holds) == FAILED:
                return FAILED
            accepted = self._send_period()
        self.urgent = self.urgent and self.at != self.pending
        sent = self._send_period() if self.urgent else True
        return FAILED if FAILED in (accepted, sent) else accepted and sent

    def _send_period(self) -> Answer:
        if not self.kind.synchronous:
            return True
        if not self.kind.rate:
            self.sent = self.pending
        elif self.owed:
            self.sent, self.moved = DEFAULT, True
        elif not self.moved:
            step = self.kind.rate * self.ticks
            self.sent, self.moved = self.at + max(-step, min(step, self.pending - self.at)), True
        if self._transfer(self.sent) or self._will_be_sent_again():
            return True
        return self._fail() or False

    # The ways to a default, all of which disarm the expiry ------------------------------------------------

    def _reset(self) -> bool:
        """RESET: by the driver's `reset`, now, without a rate."""
        self._at_default()
        self.moved, self.sent = True, DEFAULT
        if self._transfer(DEFAULT):
            return True
        self.sure = BAD
        self.owed = not self.kind.synchronous or (self.kind.rate > 0 and self.at != DEFAULT)
        return False

    def _initialize(self) -> bool:
        """INITIALIZE: the same by the driver's `initialize`."""
        return self._reset()

    def _send_default(self) -> None:
        """SEND: with the period's outputs, within the rate; asynchronous: now. Not accepted, it is owed."""
        self._at_default()
        if not self.kind.synchronous:
            self._send()

    def _at_default(self) -> None:
        self.pending, self.armed, self.urgent = DEFAULT, None, True

    # What the events share --------------------------------------------------------------------------------

    def _admits(self, value: int) -> Answer:
        if self.client:
            return False
        if value == DEFAULT:
            return True
        if any(self.faults):  # asked before any interlock, and never raises
            return False
        inhibiting = [lock for lock, inhibits in zip(self.kind.locks, self.inhibits, strict=True) if inhibits]
        return STOPS if any(lock.stops for lock in inhibiting) else not inhibiting

    def _write(self, value: int) -> None:
        self.pending, self.armed = value, 0 if self.kind.expires else None

    def _take(self, value: int) -> Answer:
        self._write(value)
        if self.kind.synchronous or self._send():
            return True
        return self._fail() or False

    def _send(self) -> bool:
        """What is pending goes to an asynchronous device, now. False: it has failed."""
        if self._transfer(self.pending) or self._will_be_sent_again():
            return True
        self.owed = self.pending == DEFAULT
        return False

    def _transfer(self, value: int) -> bool:
        if not self.broken:
            self._accepted(value)
        return not self.broken

    def _accepted(self, value: int) -> None:
        self.at = self.sent = value
        self.sure, self.owed, self.tried, self.confirmed = GOOD, False, None, 0

    def _will_be_sent_again(self) -> bool:
        """Whether what was not accepted has not failed yet, by on_error="retry"."""
        self.sure = BAD
        if not self.kind.retries:
            return False
        if not self.kind.synchronous and self.tried is None:
            self.tried = 0
        since = self.confirmed if self.kind.synchronous else self.tried
        if since is None or since > self.kind.retries:
            return False
        self.sure = STALE
        return True

    def _fail(self) -> Answer:
        """The device did not accept: a fault of the innermost equipment, else a failure of the machine."""
        if not self.kind.levels:
            return FAILED
        if not any(self.faults):
            self.equipment_fails(self.kind.levels - 1)
        return None

    def _pass(self, ticks: int) -> None:
        """Time passes. Beyond its limit no age counts."""
        if ticks:
            since = self.ticks if self.kind.every and self.kind.rate and not self.moved else 0
            self.ticks = min(ticks + since, ENOUGH)
            self.moved, self.in_period = False, True
            self.due = self.kind.every and _beyond(self.due - ticks, self.kind.every)
            self.armed = None if self.armed is None else min(self.armed + ticks, self.kind.expires)
            self.tried = None if self.tried is None else min(self.tried + ticks, self.kind.retries + 1)
            self.confirmed = min(self.confirmed + ticks, self.kind.retries + 1)

    def _tell(self, what: str, why: str, yes: bool) -> None:
        if yes:
            self.told = (*self.told, f"{what} {why}".rstrip())

    # Seen from outside ------------------------------------------------------------------------------------

    def apply(self, event: str, *arguments: Any) -> Seen:
        answer = getattr(self, event)(*arguments)
        told, self.told = sorted(self.told), ()
        return Seen(answer, self.pending, self.rank, self.reason, self.at, self.sure, told)

    @property
    def reason(self) -> str:
        if self.rank is Rank.FAULT:
            return f"level {self.faults.index(True)}"
        if self.rank is Rank.INTERLOCK:
            number = self.inhibits.index(True)
            return f"lock {number}{'' if self.holds[number] else ' (latched)'}"
        return "ann" if self.client else ""

    def after(self, event: str, *arguments: Any) -> Output:
        """Another one, to which this has happened."""
        other = object.__new__(Output)  # quicker than a copy
        vars(other).update(vars(self))
        getattr(other, event)(*arguments)
        other.told = ()
        return other

    @property
    def key(self) -> tuple[Any, ...]:
        """All of its state."""
        return tuple(vars(self).values())[1:]


def _beyond(due: int, every: int) -> int:
    """When a part is due, the periods that it has missed left out."""
    return due if due > 0 else -(-due % every)


def _with(flags: tuple[bool, ...], number: int, flag: bool) -> tuple[bool, ...]:
    return (*flags[:number], flag, *flags[number + 1 :])
