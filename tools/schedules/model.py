"""A model of the stop: what guardian, standby guardian, control process, reset processes and worker do to one another,
and every order in which they can.

    python -m tools.schedules.model                      all states, with two faults; then each mutant of the model
    python -m tools.schedules.model --without CHECK      one mutant, with the path that is wrong

A state has where each process stands, the two outputs, and what the processes share: admission, report, outcome that
was settled, record, the lock of each. Time is left out: a limit may be over wherever its process does not go on, and
only there. Faults are SIGKILL, SIGSTOP, and a process that gets no processor for a while (it goes on at any time). In
every state the promises hold (`broken`), which are those of `tools.schedules.promises`. A mutant is the model without
one of its checks, or without two that do the same work: it breaks a promise, else the model says nothing of that check.
`traces.follow` says whether a play of the real processes is a path of the model.
"""

from __future__ import annotations

import argparse
import sys
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from enum import IntEnum
from itertools import chain
from typing import NamedTuple


class Is(IntEnum):
    """What a process can do. One that is new was forked, and does not hold its lock yet."""

    GONE = 0
    NEW = 1
    NEW_STOPPED = 2
    NEW_HELD = 3
    ABLE = 4
    STOPPED = 5
    HELD = 6
    """It gets no processor for a while."""
    DYING = 7
    """It was killed, and its last call is still under way."""


LIVING = (Is.NEW, Is.ABLE)
WITHOUT_LOCK = (Is.GONE, Is.NEW, Is.NEW_STOPPED, Is.NEW_HELD)
UNABLE = (Is.STOPPED, Is.HELD, Is.NEW_STOPPED, Is.NEW_HELD)
SIGSTOPPED = (Is.STOPPED, Is.NEW_STOPPED)


class Does(IntEnum):
    """Where a guardian stands, or who does its work; and the others."""

    # a guardian
    FORK_WORKER, AWAIT_WORKER, FORK_CONTROL, AWAIT_CONTROL, FORK_RESERVE, AWAIT_RESERVE = range(6)
    FORK_STANDBY, AWAIT_STANDBY, ADMIT = range(6, 9)
    WATCH, RENEW_STANDBY, RENEW_RESERVE, RENEW_WORKER = range(9, 13)
    END, CONCLUDE, AWAIT_RESET, BEGIN, FOLLOW, SETTLE, DISMISS_WORKER, RECORD = range(13, 21)
    DISMISS_RESERVE, TELL, NOTE_TOLD, LEAVE, FAIL = range(21, 26)
    # a standby guardian
    WAIT, MAKE_SURE = range(26, 28)
    # control
    UNADMITTED, INITIALIZE, DRIVE, RESET_SLOW, RESET_FAST, REPORT, LEFT, STANDS_IN = range(28, 36)
    # a process that resets
    BEGUN, HOLDS, SLOW_DOWN, FAST_DOWN, SLOW_AGAIN, FAST_AGAIN, DONE = range(36, 43)


class State(NamedTuple):
    # fmt: off
    control: Is = Is.GONE; guardian: Is = Is.ABLE; standby: Is = Is.GONE  # noqa: E702
    reserve: Is = Is.GONE; resetter: Is = Is.GONE; worker: Is = Is.GONE  # noqa: E702
    # fmt: on
    at_control: Does = Does.UNADMITTED
    at_guardian: Does = Does.FORK_WORKER
    at_standby: Does = Does.WAIT
    at_resetter: Does = Does.BEGUN
    parent: str = ""
    """Whose child the process that resets is; "": an orphan, which ends as soon as it begins."""
    fast: bool = False
    """Whether the output on the cycle is driven."""
    slow: bool = False
    """The one behind the worker."""
    missed: bool = False
    """Whether a reset has not reached it."""
    calls: bool = False
    """Whether the worker lived when the reset began: it may die in the middle of a call."""
    ordered: bool = False
    """Whether the worker has an order to drive it."""
    anew: bool = False
    """Whether the worker takes the place of another one: it brings its output to the default first."""
    ends: bool = False
    """Whether the application ends; else it goes on until somebody asks it to stop."""
    admitted: bool = False
    concluding: bool = False
    asked: bool = False
    report: int = 0
    """Of control: 1: all was reached, 2: not all; 0: none."""
    done: bool = False
    """Whether a reset has reached all."""
    tries: int = 0
    """Attempts that have not."""
    settled: int = 0
    """1: a safe end, 2: an unsafe one; 0: none."""
    recorded: int = 1
    """1: running, 2: stopped; 0: no record."""
    outcome: int = 0
    """What the starter was told, as `settled`."""
    told: bool = False
    two: bool = False
    """Whether control drove an output after a reset had begun, or two have reset at one time."""
    left: bool = True
    """Whether anybody was able at the last fault who can reset all."""
    left_worker: bool = True
    """Or the worker."""
    kills: int = 0
    """Faults that may still come."""
    stops: int = 0
    holds: int = 0
    plan: tuple[str, ...] = ()
    """Those that come in this order; then no others do."""


Step = tuple[str, State]
"""What others see of it, and the state after it. "": nothing."""
MOST_TRIES = 5
"""Attempts of a reset: more than there are faults."""
ASKED = "ask"
"""What nobody sees but the run: the starter asks it to stop."""
KINDS = ("control", "guardian", "standby", "reserve", "resetter", "worker")


class Model:
    """`without`: the checks that it leaves out."""

    def __init__(self, *without: str) -> None:
        if unknown := {*without} - CHECKS:
            raise ValueError(f"no such check: {', '.join(unknown)}")
        self._without = {*without}

    def checks(self, name: str) -> bool:
        """Whether this check is made."""
        return name not in self._without

    def steps(self, s: State) -> Iterator[Step]:
        """What the processes can do, without faults."""
        if s.guardian is Is.ABLE:
            yield from self._guard(s, "guardian", s.at_guardian)
        if s.standby is Is.NEW:
            yield "", s._replace(standby=Is.ABLE, at_standby=Does.WAIT)
        elif s.standby is Is.ABLE:
            yield from self._standby(s) if s.at_standby >= Does.WAIT else self._guard(s, "standby", s.at_standby)
        if s.control is Is.NEW:
            yield "", s._replace(control=Is.ABLE)
        elif s.control is Is.ABLE:
            yield from self._control(s)
        elif s.control is Is.DYING:
            yield from self._dying(s)
        if s.reserve in LIVING:
            yield from self._reserve(s)
        if s.resetter is not Is.GONE and self._is_orphan(s):
            yield "", s._replace(resetter=Is.GONE)
        elif s.resetter is Is.ABLE:
            yield from self._reset(s)
        if s.worker is Is.NEW:
            yield "", s._replace(worker=Is.ABLE)
        elif s.worker is Is.ABLE:
            yield from self._worker(s)
        for kind in KINDS:
            if getattr(s, kind) is Is.HELD:
                yield "", s._replace(**{kind: Is.ABLE})
            elif getattr(s, kind) is Is.NEW_HELD:
                yield "", s._replace(**{kind: Is.NEW})

    def faults(self, s: State) -> Iterator[Step]:
        if s.plan:
            one = {"kill": "kills", "stop": "stops", "hold": "holds"}[s.plan[0].partition(" ")[0]]
            for seen, after in self._any_fault(s._replace(**{one: 1})):
                if seen == s.plan[0]:
                    yield seen, after._replace(plan=s.plan[1:])
        else:
            yield from self._any_fault(s)

    def _any_fault(self, s: State) -> Iterator[Step]:
        for kind in KINDS:
            now = getattr(s, kind)
            if now is Is.GONE:
                continue
            if s.kills:
                yield f"kill {kind}", self._after_fault(s, kind, Is.GONE)._replace(kills=s.kills - 1)
            is_new = now in WITHOUT_LOCK
            if s.stops and now not in (*SIGSTOPPED, Is.DYING):
                state = Is.NEW_STOPPED if is_new else Is.STOPPED
                yield f"stop {kind}", self._after_fault(s, kind, state)._replace(stops=s.stops - 1)
            if s.holds and now in LIVING:
                state = Is.NEW_HELD if is_new else Is.HELD
                yield f"hold {kind}", self._after_fault(s, kind, state)._replace(holds=s.holds - 1)

    def _after_fault(self, s: State, kind: str, state: Is) -> State:
        s = self._gone(s, kind) if state is Is.GONE else s._replace(**{kind: state})
        who = [s.control, s.guardian, *([s.resetter] if s.parent else [])]
        left = any(each in (Is.ABLE, Is.HELD) for each in who) or self._somebody_follows(s)
        return s._replace(left=left, left_worker=left or s.worker in (Is.ABLE, Is.HELD))

    def _gone(self, s: State, kind: str) -> State:
        """A process has ended, and the one that resets for it is killed."""
        s = s._replace(**{kind: Is.GONE})
        if kind == "worker":
            s = s._replace(ordered=False, anew=False)
        if kind == s.parent and self.checks("the reset ends with its guardian"):
            s = s._replace(parent="")
        return s

    def _is_orphan(self, s: State) -> bool:
        """Whether the process that resets is killed, as its guardian is dead; its end may come later."""
        return not s.parent and s.at_resetter is not Does.BEGUN

    def _killed_control(self, s: State) -> State:
        """A guardian has killed it. A call to a device that is under way comes to its end."""
        if s.control in (Is.ABLE, Is.HELD) and s.at_control is Does.DRIVE:
            return s._replace(control=Is.DYING)
        return self._gone(s, "control")

    def _may_reset(self, s: State) -> bool:
        """Whether no other process resets. One that has not begun ends when it sees that its guardian is dead."""
        return s.resetter is Is.GONE or s.at_resetter is Does.BEGUN

    # A guardian ---------------------------------------------------------------------------------------------

    def _guard(self, s: State, me: str, at: Does) -> Iterator[Step]:
        """What the guardian does, or who has taken its place."""
        place = f"at_{me}"

        def to(where: Does, state: State = s, seen: str = "") -> Step:
            return seen, state._replace(**{place: where})

        def forked(kind: str, then: Does) -> Step:
            return to(then, s._replace(**{kind: Is.NEW}), f"fork {kind}")

        def awaited(kind: str, then: Does, failed: Does) -> Iterator[Step]:
            """The handshake of a fork."""
            now = getattr(s, kind)
            if now not in (Is.NEW, Is.NEW_STOPPED, Is.NEW_HELD) or not self.checks("a fork is waited for"):
                yield to(then)
            elif now in UNABLE and self.checks("a child that does not begin is ended"):
                yield to(failed, self._gone(s, kind))

        if at is Does.FORK_WORKER:
            yield forked("worker", Does.AWAIT_WORKER)
        elif at is Does.AWAIT_WORKER:
            yield from awaited("worker", Does.FORK_CONTROL, Does.FAIL)
        elif at is Does.FORK_CONTROL:
            yield forked("control", Does.AWAIT_CONTROL)
        elif at is Does.AWAIT_CONTROL:
            yield from awaited("control", Does.FORK_RESERVE, Does.FAIL)
        elif at is Does.FORK_RESERVE:
            yield forked("reserve", Does.AWAIT_RESERVE)
        elif at is Does.AWAIT_RESERVE:
            yield from awaited("reserve", Does.FORK_STANDBY, Does.FAIL)
        elif at is Does.FORK_STANDBY:
            if not self.checks("admission comes last") and not s.admitted:
                yield "admit", s._replace(admitted=True)
            yield forked("standby", Does.AWAIT_STANDBY)
        elif at is Does.AWAIT_STANDBY:
            yield from awaited("standby", Does.ADMIT, Does.ADMIT)
        elif at is Does.ADMIT:
            yield to(Does.WATCH, s._replace(admitted=True), "admit")
        elif at is Does.WATCH:
            yield from self._watch(s, me, to)
        elif at is Does.RENEW_STANDBY:
            yield from awaited("standby", Does.WATCH, Does.WATCH)
        elif at is Does.RENEW_RESERVE:
            yield from awaited("reserve", Does.WATCH, Does.WATCH)
        elif at is Does.RENEW_WORKER:
            yield from awaited("worker", Does.WATCH, Does.WATCH)
        elif at is Does.FAIL:  # nothing is driven
            yield "", self._gone(s._replace(recorded=0, outcome=1), me)
        else:
            yield from self._end(s, me, at, to)

    def _watch(self, s: State, me: str, to: Callable[..., Step]) -> Iterator[Step]:
        if not s.asked:  # the starter asks for a stop
            yield to(Does.WATCH, s._replace(asked=True), ASKED)
        if s.control in WITHOUT_LOCK and self.checks("the guardian sees the death of control"):
            yield to(Does.END)
        elif s.control in UNABLE and self.checks("the guardian sees a silent control"):
            # with a report it has left the machine, and is only late
            if s.report:
                yield to(Does.END, self._gone(s, "control") if self.checks("a hung control is killed") else s)
            else:
                yield to(Does.CONCLUDE)
        if me == "standby":
            return
        lost = (Is.GONE, *SIGSTOPPED) if self.checks("a stopped standby is replaced") else (Is.GONE,)
        if s.standby in lost and self.checks("a dead standby is replaced"):
            yield to(Does.RENEW_STANDBY, s._replace(standby=Is.NEW, at_standby=Does.WAIT), "fork standby")
        if s.reserve in (Is.GONE, *SIGSTOPPED) and self.checks("a dead reserve is replaced"):
            yield to(Does.RENEW_RESERVE, s._replace(reserve=Is.NEW), "fork reserve")
        if s.worker in SIGSTOPPED:  # it is ended first
            yield to(Does.WATCH, self._gone(s, "worker"))
        elif s.worker is Is.GONE:
            yield to(Does.RENEW_WORKER, s._replace(worker=Is.NEW, ordered=False, anew=True), "fork worker")

    def _end(self, s: State, me: str, at: Does, to: Callable[..., Step]) -> Iterator[Step]:
        how = s.settled or (1 if s.report == 1 and not s.concluding else 2)
        if at is Does.END:
            if s.report == 1:
                yield to(Does.SETTLE, s._replace(done=True))
            elif s.report == 2 and not self.checks("what control could not reset is reset"):
                yield to(Does.SETTLE)
            else:
                yield to(Does.CONCLUDE)
        elif at is Does.CONCLUDE:
            killed = self._killed_control(s) if self.checks("control is killed before the reset") else s
            yield to(Does.AWAIT_RESET, killed._replace(concluding=True))
        elif at is Does.AWAIT_RESET:
            if self._may_reset(s) or not self.checks("the reset of another is waited for"):
                yield to(Does.BEGIN)
        elif at is Does.BEGIN:
            yield from self._begin(s, me, to)
        elif at is Does.FOLLOW:
            if s.resetter is Is.GONE:
                ends = s.done or s.tries == MOST_TRIES
                yield to(Does.SETTLE if ends else Does.BEGIN, self._retried(s))
            elif s.resetter in UNABLE and self.checks("a reset that does not go on is ended"):
                yield to(Does.FOLLOW, self._gone(s, "resetter"))
        elif at is Does.SETTLE:
            settled = s._replace(settled=how) if self.checks("an outcome is settled before it is told") else s
            yield to(Does.DISMISS_WORKER, settled)
        elif at is Does.DISMISS_WORKER:
            yield to(Does.RECORD, self._gone(s, "worker"))
        elif at is Does.RECORD:
            unsafe = 2 if self.checks("an unsafe end is recorded") else 0
            yield to(Does.DISMISS_RESERVE, s._replace(recorded=0 if how == 1 else unsafe))
        elif at is Does.DISMISS_RESERVE:
            yield to(Does.TELL, self._gone(s, "reserve") if me == "guardian" else s)
        elif at is Does.TELL:
            yield to(Does.NOTE_TOLD, s._replace(outcome=s.outcome or how))
        elif at is Does.NOTE_TOLD:
            yield to(Does.LEAVE, s._replace(told=True), "told")
        elif at is Does.LEAVE:
            s = self._gone(s, "reserve") if self.checks("a reserve that is left is ended") else s
            yield "", self._gone(self._gone(s, "standby") if me == "guardian" else s, me)

    def _begin(self, s: State, me: str, to: Callable[..., Step]) -> Iterator[Step]:
        """Let the reserve work, another one waits; or fork a child."""
        if s.resetter is not Is.GONE and not (self._may_reset(s) and self.checks("the reset ends with its guardian")):
            s = s._replace(two=True)
        begun = s._replace(resetter=Is.ABLE, at_resetter=Does.BEGUN, parent=me)
        if me == "guardian" and s.reserve not in (Is.NEW, Is.NEW_STOPPED, Is.NEW_HELD):
            # where the reserve is dead, the guardian works itself
            works = Is.ABLE if s.reserve is Is.GONE else s.reserve
            yield to(Does.FOLLOW, begun._replace(resetter=works, reserve=Is.NEW), "fork reserve")
        if me != "guardian" or s.reserve in WITHOUT_LOCK:
            yield to(Does.FOLLOW, begun, "fork resetter")

    def _retried(self, s: State) -> State:
        """Between two attempts: a worker that did not answer is ended."""
        s = s._replace(tries=min(s.tries + 1, MOST_TRIES))
        if not s.done and s.worker in UNABLE and self.checks("a worker that does not answer is ended"):
            return self._gone(s, "worker")
        return s

    # Those who follow ---------------------------------------------------------------------------------------

    def _standby(self, s: State) -> Iterator[Step]:
        if s.at_standby is Does.WAIT:
            is_silent = s.guardian in UNABLE and self.checks("the standby sees a silent guardian")
            if s.guardian is Is.GONE or is_silent:
                ended = self._gone(s, "guardian") if self.checks("the standby ends the guardian") else s
                yield "", ended._replace(at_standby=Does.MAKE_SURE)
        elif self._may_reset(s) or not self.checks("the standby waits for the reset of the guardian"):
            yield from self._take_over(s)

    def _take_over(self, s: State) -> Iterator[Step]:
        if s.settled and self.checks("what was settled is only told"):
            yield "", s._replace(at_standby=Does.DISMISS_WORKER)
        else:
            yield "", s._replace(at_standby=Does.WATCH, asked=True)

    def _reserve(self, s: State) -> Iterator[Step]:
        """The child that waits to reset, also while it waits for its place."""
        if s.reserve is Is.NEW and (s.resetter is Is.GONE or s.at_resetter is not Does.BEGUN):
            yield "", s._replace(reserve=Is.ABLE)
        if s.reserve is Is.NEW and not self.checks("the reserve looks while it waits for its place"):
            return
        if s.told:
            yield "", s._replace(reserve=Is.GONE)
            return
        out = (Is.GONE, *SIGSTOPPED) if self.checks("a stopped standby counts as out") else (Is.GONE,)
        both = s.guardian is Is.GONE and (s.standby in WITHOUT_LOCK or s.standby in out)
        if both and not s.admitted:
            yield "", s._replace(reserve=Is.GONE)
            return
        unable = (Is.GONE, *UNABLE)
        silent = s.guardian in unable and s.standby in unable and self.checks("the reserve sees silent guardians")
        if (both or silent) and self.checks("the reserve follows both"):
            s = self._gone(s, "guardian")
            if s.standby is not Is.GONE and self.checks("the reserve ends the standby"):
                s = self._gone(s, "standby")
            if s.standby is Is.GONE:  # it takes its place
                yield "", s._replace(standby=s.reserve if s.reserve is Is.ABLE else Is.ABLE, reserve=Is.GONE,
                                     at_standby=Does.MAKE_SURE)  # fmt: skip

    # The others ---------------------------------------------------------------------------------------------

    def _control(self, s: State) -> Iterator[Step]:
        at = s.at_control
        lost = s.guardian is Is.GONE and self.checks("control is told of its guardian's death")
        lost |= s.guardian in UNABLE and self.checks("control sees a silent guardian")
        if at is Does.UNADMITTED:
            if s.admitted or not self.checks("control waits for admission"):
                yield "", s._replace(at_control=Does.INITIALIZE)
            alone = s.guardian is Is.GONE or s.guardian in UNABLE
            if alone and (s.admitted or self.checks("control ends without admission")):  # it may have looked before
                yield "", s._replace(control=Is.GONE)
        elif at is Does.INITIALIZE:
            yield "", s._replace(at_control=Does.DRIVE)
            if s.worker is not Is.ABLE:  # it fails, and nothing was driven
                yield "", s._replace(at_control=Does.REPORT)
                yield "", s._replace(at_control=Does.RESET_SLOW)
        elif at is Does.DRIVE:
            is_late = s.resetter in (Is.ABLE, Is.HELD) and s.at_resetter >= Does.SLOW_DOWN
            if not s.fast:
                yield "up fast", s._replace(fast=True, two=s.two or is_late)
            if not (s.slow or s.ordered) and s.worker is Is.ABLE:
                yield "", s._replace(ordered=True, two=s.two or is_late)
            if s.ends or lost or (s.asked and self.checks("control stops when it is asked to")):
                yield "", s._replace(at_control=Does.RESET_SLOW)
        elif at is Does.RESET_SLOW:
            yield self._down_by_worker(s, "at_control", Does.RESET_FAST)
        elif at is Does.RESET_FAST:
            fast = s.fast and not self.checks("control resets before it leaves")
            yield "down fast" if s.fast else "", s._replace(at_control=Does.REPORT, fast=fast)
        elif at is Does.REPORT:
            missed = s.missed and self.checks("control reports what it has not reached")
            yield "", s._replace(at_control=Does.LEFT, report=2 if missed else 1)
        elif at is Does.STANDS_IN:
            if s.resetter is Is.GONE:
                yield "", s._replace(at_control=Does.LEFT, report=1 if s.done else 2)
            elif s.resetter in UNABLE:
                yield "", self._gone(s, "resetter")
        elif s.report == 2 and s.guardian is not Is.ABLE and self.checks("control retries when it is alone"):
            yield from self._stand_in(s)
        else:
            yield self._say(s)

    def _dying(self, s: State) -> Iterator[Step]:
        yield "", self._gone(s, "control")
        if not s.fast:
            yield "up fast", self._gone(s, "control")._replace(fast=True)

    def _somebody_follows(self, s: State) -> bool:
        return any(each in (Is.ABLE, Is.NEW, Is.HELD, Is.NEW_HELD) for each in (s.standby, s.reserve))

    def _stand_in(self, s: State) -> Iterator[Step]:
        """Control does the work of a guardian, if nobody else does."""
        s = self._gone(s, "guardian")
        if self._somebody_follows(s):
            yield self._say(s)
            return
        for kind in ("standby", "reserve"):
            s = self._gone(s, kind)
        s = self._gone(s, "worker") if s.worker in UNABLE else s
        if not self._may_reset(s):
            yield "", s
        else:
            yield (
                "fork resetter",
                s._replace(
                    resetter=Is.ABLE,
                    at_resetter=Does.BEGUN,
                    parent="control",
                    concluding=True,
                    at_control=Does.STANDS_IN,
                ),
            )

    def _say(self, s: State) -> Step:
        """The end of control. Without a guardian it is unsafe, and recorded."""
        if s.guardian is Is.ABLE:
            return "", self._gone(s, "control")
        s = self._gone(s, "guardian")._replace(recorded=2, concluding=True)
        if self._somebody_follows(s):
            return "", self._gone(s, "control")
        for kind in ("standby", "reserve"):
            s = self._gone(s, kind)
        return "told", self._gone(s, "control")._replace(told=True)

    def _down_by_worker(self, s: State, place: str, then: Does) -> Step:
        """The output behind the worker, through it. One that is dead or does not answer: not reached."""
        if s.worker is Is.ABLE:
            return "down slow" if s.slow else "", s._replace(**{place: then, "slow": False, "ordered": False})
        return "", s._replace(**{place: then, "missed": True})

    def _reset(self, s: State) -> Iterator[Step]:
        """The process that resets, which a guardian lets begin."""
        at = s.at_resetter
        if at is Does.BEGUN:
            yield "", s._replace(at_resetter=Does.HOLDS) if s.parent else s._replace(resetter=Is.GONE)
        elif at is Does.HOLDS:
            yield "", s._replace(at_resetter=Does.SLOW_DOWN, missed=False, calls=s.worker in (Is.ABLE, Is.HELD))
        elif at in (Does.SLOW_DOWN, Does.SLOW_AGAIN):
            then = Does(at + 1)
            if s.tries % 2:  # a driver in whose call one was killed has a child of its own
                yield "", s._replace(at_resetter=then, missed=True)
            if s.calls and s.worker is Is.GONE:  # in the middle of a call
                yield "", s._replace(at_resetter=then, missed=True)
            if s.worker in WITHOUT_LOCK and self.checks("a device whose worker is dead is opened"):
                yield "down slow" if s.slow else "", s._replace(slow=False, at_resetter=then)
            else:
                yield self._down_by_worker(s, "at_resetter", then)
        elif at is Does.FAST_DOWN:
            is_dead = s.control is Is.GONE or s.parent == "control"
            if is_dead or not self.checks("the reset waits for the end of control") or s.fast:
                then = Does.SLOW_AGAIN if is_dead or not self.checks("the reset waits for the end of control") else at
                yield "down fast" if s.fast else "", s._replace(fast=False, at_resetter=then)
        elif at is Does.FAST_AGAIN:
            yield "down fast" if s.fast else "", s._replace(fast=False, at_resetter=Does.DONE)
        else:
            yield "", s._replace(resetter=Is.GONE, done=not s.missed)

    def _worker(self, s: State) -> Iterator[Step]:
        if s.anew:
            yield "down slow" if s.slow else "", s._replace(anew=False, slow=False)
        if s.ordered:
            yield "up slow", s._replace(slow=True, ordered=False)
        if s.slow and s.at_control is Does.RESET_SLOW and s.control is not Is.ABLE:  # control has asked it for that
            yield "down slow", s._replace(slow=False, ordered=False)
        alone = s.control in WITHOUT_LOCK or (s.control in UNABLE and s.at_control is Does.DRIVE)
        if s.ordered and alone:
            yield "", s._replace(ordered=False)
        free = [kind for kind in ("guardian", "standby", "reserve") if getattr(s, kind) in WITHOUT_LOCK]
        if alone and len(free) == 3 and self.checks("a worker that is left alone resets"):
            yield "down slow" if s.slow else "", self._gone(s._replace(slow=False), "worker")


def broken(s: State, is_end: bool) -> str:
    """The promise that is broken in this state, in words; "": none. `is_end`: whether nobody can go on, unless
    somebody asks for a stop."""
    if s.two:
        return "two processes wrote to the outputs"
    if (s.fast or s.slow) and s.guardian is not Is.GONE and s.at_guardian < Does.ADMIT:
        return "an output is driven before everybody is there who can reset it"
    if s.outcome == 1 and (s.fast or s.slow):
        return "told as safe, and an output is driven"
    if s.outcome and s.parent and s.resetter is not Is.GONE:
        return "all was told, and a process resets"
    if is_end and s.guardian is Is.ABLE and s.at_guardian is Does.WATCH and not s.asked:
        lost = [kind for kind in KINDS[2:4] if getattr(s, kind) is Is.GONE or getattr(s, kind) in SIGSTOPPED]
        return f"in the place of a lost one there is no other: {', '.join(lost)}" if lost else ""
    if not is_end:
        return ""
    stopped = any(getattr(s, kind) in SIGSTOPPED for kind in KINDS)
    if (s.fast and s.left) or (s.slow and (s.left or (s.left_worker and not stopped))):
        return "an output is driven at the end, and somebody was left who can reset"
    if (s.fast or s.slow or s.outcome == 2) and not s.recorded:
        return "an unsafe end, and no record"
    if s.outcome == 1 and s.recorded:
        return "a safe end, and a record"
    if s.outcome and s.left and (s.reserve in SIGSTOPPED or (s.standby in SIGSTOPPED and s.at_standby is Does.WAIT)):
        return "all was told, and a process that is stopped is left behind"
    waiting = [kind for kind in KINDS if getattr(s, kind) in LIVING and not (kind == "worker" and stopped)]
    if waiting:
        return f"for ever: {', '.join(waiting)}"
    return ""


class Explored(NamedTuple):
    states: int
    wrong: str
    """The promise that is broken first."""
    path: list[str]
    """What leads there: where each process stands, step by step."""


def explore(model: Model, kills: int = 0, stops: int = 0, holds: int = 0, plan: Sequence[str] = ()) -> Explored:
    """All states with so many faults at most, or with those of the plan, to the first that breaks a promise."""
    begin = [State(ends=ends, kills=kills, stops=stops, holds=holds, plan=tuple(plan)) for ends in (True, False)]
    before: dict[State, State | None] = dict.fromkeys(begin)
    coming = deque(begin)
    while coming:
        state = coming.popleft()
        steps = [*model.steps(state)]
        if wrong := broken(state, all(seen == ASKED for seen, _ in steps)):
            return Explored(len(before), wrong, _path(state, before))
        for _, after in (*steps, *model.faults(state)):
            if after not in before:
                before[after] = state
                coming.append(after)
    return Explored(len(before), "", [])


def _path(state: State | None, before: dict[State, State | None]) -> list[str]:
    """What changes from each state to the next."""
    found: list[str] = []
    while state is not None:
        former = before[state]
        if former is not None:
            fields = zip(state._fields, state, former, strict=True)
            found.append(", ".join(f"{name}={_shown(value)}" for name, value, old in fields if value != old))
        state = former
    return found[::-1]


def _shown(value: object) -> str:
    return value.name.lower() if isinstance(value, IntEnum) else str(value)


FAULTS = ((1, 0, 0), (0, 1, 0), (0, 0, 1), (2, 0, 0), (1, 1, 0), (1, 0, 1), (0, 1, 1), (0, 2, 0), (0, 0, 2))
"""Kills, stops and delays of at most two faults."""
MUTANTS: dict[str, Sequence[str]] = {
    "a fork is waited for": ["kill control"],
    "a child that does not begin is ended": ["stop standby"],
    "admission comes last": [],
    "the guardian sees the death of control": ["kill control"],
    "the guardian sees a silent control": ["stop control"],
    "a hung control is killed": ["hold control"],
    "a dead standby is replaced": ["kill standby"],
    "a stopped standby is replaced": ["stop standby"],
    "a dead reserve is replaced": ["kill reserve"],
    "what control could not reset is reset": ["kill worker"],
    "control is killed before the reset": ["hold control"],
    "a reset that does not go on is ended": ["kill control", "stop resetter"],
    "an unsafe end is recorded": ["kill control"],
    "a worker that does not answer is ended": ["stop worker", "kill control"],
    "the standby sees a silent guardian": ["kill control", "stop guardian", "kill reserve"],
    "the standby ends the guardian": ["hold guardian"],
    "the reserve looks while it waits for its place": [
        "stop reserve", "kill control", "kill guardian", "kill standby"],
    "the reserve sees silent guardians": ["kill control", "stop guardian", "stop standby"],
    "the reserve follows both": ["kill control", "kill guardian", "kill standby"],
    "the reserve ends the standby": ["stop standby", "kill guardian"],
    "control is told of its guardian's death": ["kill guardian", "kill standby", "kill reserve"],
    "control sees a silent guardian": ["stop guardian", "kill standby", "kill reserve"],
    "control waits for admission": ["stop guardian"],
    "control ends without admission": ["kill guardian"],
    "control stops when it is asked to": ["kill standby"],
    "control retries when it is alone": ["kill worker", "kill guardian", "kill standby", "kill reserve"],
    "the reset ends with its guardian": ["kill control", "kill guardian"],
    "a device whose worker is dead is opened": ["kill worker", "kill control"],
    "control reports what it has not reached": ["kill worker"],
    "control resets before it leaves": [],
    "a worker that is left alone resets": ["kill guardian", "kill standby", "kill reserve", "kill control"],
    "an outcome is settled before it is told": ["kill control", "kill guardian"],
    "what was settled is only told": ["kill control", "kill guardian"],
    "a reserve that is left is ended": ["stop reserve", "kill guardian"],
    "the reset waits for the end of control": ["hold control"],
}  # fmt: skip
"""The faults, in this order, by which the model without a check breaks a promise."""
PAIRS: dict[tuple[str, str], Sequence[str]] = {
    ("the reset of another is waited for", "the standby waits for the reset of the guardian"): [
        "kill control", "kill guardian"],
    ("a stopped standby counts as out", "the reserve sees silent guardians"): [
        "kill control", "stop standby", "kill guardian"],
}  # fmt: skip
"""Two checks, either of which does the work of the other, and the faults by which the model without both breaks a
promise."""
CHECKS = {*MUTANTS, *chain.from_iterable(PAIRS)}


def main() -> int:
    parser = argparse.ArgumentParser("python -m tools.schedules.model")
    parser.add_argument(
        "--without", choices=sorted(CHECKS), metavar="CHECK", help="this mutant, with the path that is wrong"
    )
    given = parser.parse_args()
    if given.without:
        found = explore(Model(given.without), plan=MUTANTS.get(given.without, ()))
        print("\n".join([*found.path, found.wrong or "not caught"]))
        return int(not found.wrong)
    wrong = missed = 0
    for faults in FAULTS:
        whole = explore(Model(), *faults)
        wrong += bool(whole.wrong)
        print(f"{faults}: {whole.states} states, {whole.wrong or 'all promises are kept'}", flush=True)
    mutants = [*(((check,), plan) for check, plan in MUTANTS.items()), *PAIRS.items()]
    for without, plan in mutants:
        found = explore(Model(*without), plan=plan)
        missed += not found.wrong
        print(f"without {' and '.join(without)!r}: {found.wrong or 'NOT CAUGHT'} ({', '.join(plan)})", flush=True)
    print(f"{len(mutants) - missed} of {len(mutants)} mutants are caught")
    return int(bool(wrong or missed))


if __name__ == "__main__":
    sys.exit(main())
