"""When the outputs of a world have to be at their defaults: which rows of the table of ends apply (`ends`), and the sum
of their times."""

from __future__ import annotations

from collections.abc import Iterator

from tools.schedules.ends import BY_KEY, Times
from tools.schedules.faults import What
from tools.schedules.machine import HANG_TIMEOUT, PERIOD
from tools.schedules.scheduler import RESETTING, Scheduler, State, kind_of
from tools.schedules.shared import LATEST, START

TIMES = Times(period=PERIOD, hang_timeout=HANG_TIMEOUT, timeout=10 * PERIOD)
"""The longest timeout is that of the timer."""
BESIDE = 0.032
"""Time in s beside those of the table: the worker's look at what it is asked for, the look of who asks it at its answer
(20 and 10 ms in a world), and 2000 steps."""
BEST = (State.ABLE, State.STOPPED, State.KILLED, State.ENDED)
"""Of several processes of a kind the first of these counts."""


class Due:
    """`from_` and `at`: from when, and by when, all are at their defaults, ns; `LATEST` where the table has no time."""

    def __init__(self, scheduler: Scheduler) -> None:
        self._scheduler = scheduler
        self._faults = {fault.what for fault in scheduler.came}
        self._asked = {fault.who or "starter" for fault in scheduler.came if fault.what is What.ASK}
        """Who was asked to stop the machine."""
        self._states = scheduler.at_last_fault | self._hung()
        self.rows, self.delays = [*self._cause()], [*self._delays()]
        self.from_ = self._begin()
        self.at = self._at()

    def _hung(self) -> dict[str, State]:
        """A control process that was held up for so long that it was killed as one that is stopped."""
        is_held = any(fault.what is What.HOLD and fault.who == "control" for fault in self._scheduler.came)
        control = self._scheduler.named("control")
        return {"control": State.STOPPED} if is_held and control and control.ended_by == "signal" else {}

    @property
    def limit(self) -> float:
        """ms."""
        return (self.at - self.from_) / 1e6

    @property
    def took(self) -> float:
        """ms; below 0: all were at their defaults before."""
        return (max(self._scheduler.falls.values(), default=0) - self.from_) / 1e6

    def __str__(self) -> str:
        return " + ".join([*self.rows, *self.delays])

    def _at(self) -> int:
        times = [BY_KEY[key].within for key in [*self.rows, *self.delays]]
        if "" in times or self.from_ == LATEST:
            return LATEST
        seconds = BESIDE + sum(map(TIMES.seconds, times))
        return self.from_ + round(seconds * 1e9)

    def _begin(self) -> int:
        """From when on: the last fault, the end of the last delay, when the last device answers again; where the run
        goes on, its end."""
        scheduler = self._scheduler
        answers = [at for at in scheduler.answers_from.values() if at < LATEST]
        begin = max(scheduler.last_fault, scheduler.held_until, *answers, START)
        if self.rows == ["application ends"]:
            begin = max(begin, scheduler.left_at or LATEST)
        return begin

    def _best(self, kind: str) -> State:
        """Of the processes of a kind; one that was not forked yet can do what it will."""
        found = [state for name, state in self._states.items() if kind_of(name) == kind]
        return min(found, key=BEST.index, default=State.ABLE)

    def _cause(self) -> Iterator[str]:
        """The rows that say who resets."""
        control, guardian = self._best("control"), self._best("guardian")
        if control is State.ABLE and guardian is State.ABLE:
            yield self._going_on()
        elif control is State.ABLE:
            follower = "" if self._best("worker") is State.ABLE else self._follower(guardian)  # resets the worker's
            yield follower or ("guardian stopped" if guardian is State.STOPPED else "guardian killed")
        elif guardian is State.ABLE or (follows := self._follower(guardian)):
            yield from () if guardian is State.ABLE else (follows,)
            yield "control stopped" if control is State.STOPPED else "control killed"
        elif State.STOPPED not in (self._best(kind) for kind in RESETTING):
            yield "all killed"
        else:
            yield "all stopped"

    def _going_on(self) -> str:
        if not self._scheduler.driven_at_last_fault:
            return "application ends"
        if any(self._best(who) is State.ABLE for who in self._asked):
            return "asked to stop"
        return "starter killed" if self._best("starter") is State.KILLED else "application ends"

    def _follower(self, guardian: State) -> str:
        """Who takes the place of a guardian; "": nobody."""
        if guardian is State.STOPPED and self._scheduler.was_concluding:
            return "stopped within a reset"
        followed = "stopped" if guardian is State.STOPPED else "dead"
        if self._best("standby") is State.ABLE:
            return f"standby follows a {followed} one"
        return f"reserve follows {followed} ones" if self._best("reserve") is State.ABLE else ""

    def _delays(self) -> Iterator[str]:
        """The rows of processes that were to reset, or whose outputs were to be reset."""
        states = {(kind_of(name), state) for name, state in self._states.items()}
        if ("worker", State.ENDED) in states:  # one that was stopped; the next one takes its place
            states.add(("worker", State.KILLED))
        lost = states & {("worker", State.KILLED), ("worker", State.STOPPED)}
        resets_itself = self._best("control") is State.ABLE and not lost
        for kind, name in (("worker", "worker"), ("reserve", "resetter"), ("reset", "resetter")):
            for state in (State.KILLED, State.STOPPED):
                if (kind, state) in states and not (resets_itself and name == "resetter"):
                    yield f"{name} {state}"
        if What.SILENT in self._faults:
            yield "silent"
