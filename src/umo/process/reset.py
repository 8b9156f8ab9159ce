"""The reset of a machine to its defaults from another process, after its control process has died.

Each attempt is made in a separate child process, which opens the drivers again. So a driver that hangs or crashes
affects only this attempt. The first child process is forked before the control process and waits, so it works even if a
limit on processes or descriptors is reached later. If a later child cannot be forked, the guardian does the work
itself. All calls go through the transfer stage.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Sequence
from contextlib import suppress
from math import inf
from types import FrameType
from typing import Literal

from umo.cycle.attempts import Attempts
from umo.cycle.segments import UNCONTROLLED_TIMEOUT, DriverSegments, settling, wait_for
from umo.cycle.transfer import Transfer
from umo.drivers.off_cycle import OffCycle
from umo.errors import DeviceTimeout, text_of
from umo.objects import Compound
from umo.objects.stop_order import stop_sequence
from umo.process.reset_state import Reached, ResetState
from umo.system import calls
from umo.system.processes import Child, carry_out, name_process
from umo.system.signal_handling import SIGNALS, signal_name
from umo.text import some
from umo.wiring import Wired

CALL_MARGIN = 1.0
"""The time in s that a call of a driver may take in addition to twice its timeout."""
RESERVE_INTERVAL = 0.1
"""Time in s between two looks of the child on standby for a guardian."""
FORK_PAUSE = 1.0
"""The time in s until the next attempt after a process could not be forked."""
ATTEMPT_PAUSE = 0.2
"""Time in s between two attempts."""
LOOK_INTERVAL = 0.0005
"""The time in s between two checks of a process."""
DEATH_TIMEOUT = 5.0
"""Time in s that a killed process may take to end."""
SPARE_DESCRIPTORS = 16
"""Number of descriptors that the child on standby keeps free for the drivers."""
NO_TIME = "no time was left"
"""The cause of the failure if the time of an attempt was over."""
STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""The signals that request a run to stop. A process that resets, or waits to do so, ignores them."""


class _TimeIsOver(Exception):
    """The time of an attempt in this process is over: no further call begins."""


class Resetter:
    """The resetter of one machine, which brings its actuators to their defaults in stop order."""

    def __init__(
        self,
        machine: Compound,
        wired: Wired,
        guard: Callable[[], object] = lambda: None,
        give_up: Callable[[Sequence[str]], object] = lambda paths: None,
        fork: Callable[[bool], int] = lambda first: calls.fork(),
        end: Callable[[Child, float], object] = Child.end,
    ) -> None:
        """`guard` is called in the child that resets. `give_up` is called with the paths that an attempt has not
        reached; it ends a worker process that serves one of them, so that the next attempt can open its device. `fork`
        forks the child on standby: the first child, or a child that replaces one that has begun to work. `end` ends the
        child, and waits at most the given time in s for its end."""
        by_item = {id(wire.item): wire for wire in wired.wires}
        self._names = {id(driver): name for name, driver in wired.drivers.items()}
        self._wires = [by_item[id(item)] for item in stop_sequence(machine)]
        self._wired = wired
        self._segments = DriverSegments(Transfer(self._wires, wired), wired)
        self._guard, self._give_up, self._fork_reserve, self._end = guard, give_up, fork, end
        self.in_reserve: Callable[[], bool] = lambda: False
        """The function that is called in the child on standby every `RESERVE_INTERVAL` s while the child waits. It
        returns True if the child must not wait any longer."""
        self.takes_place: Callable[[float], bool] = lambda within: True
        """The function that is called in the child on standby until it returns True. It waits at most the given time in
        s for the previous child to begin its work."""
        self._timeouts = {name: driver.timeout for name, driver in wired.drivers.items()}
        self.paths = [wire.path for wire in self._wires]
        self._state = ResetState(self.paths)
        self._attempt_number = 0
        self._attempts = Attempts()
        self._is_last = False
        """True if the time is over: the timeouts are those of the wiring."""
        self._tries_all = False
        """True if every actuator is tried, even after a timeout of its driver."""
        self._results: dict[int, tuple[Reached, str]] = {}
        """The result of the last attempt for each actuator, with the cause."""
        self._untried_cause = "its driver did not answer in time"
        self._stuck_drivers: set[int] = set()
        """The drivers (by id) that hung or crashed."""
        self._misses = [0] * len(self._wires)
        self._child: Child | None = None
        """The child that works."""
        self._reserve: Child | None = None
        """The child that waits."""
        self._next_fork = inf
        """The time at which another child is forked to wait, if there is none; inf if none is needed."""
        self._start_pipe = self._waiting_pipe = -1

    def stand_by(self, first: bool = True) -> None:
        """Fork the child of the first attempt now, or of the next one. Raises OSError if it cannot be forked."""
        pipe = self._waiting_pipe, self._start_pipe = calls.pipe()
        try:
            self._reserve = self._fork(self._wait_for_work, lambda: self._fork_reserve(first))
        except OSError:
            for file in pipe:
                calls.close(file)
            raise

    @property
    def reserve(self) -> int:
        """The pid of the child on standby, or 0 if there is none."""
        return 0 if self._reserve is None else self._reserve.pid

    def look(self) -> bool:
        """Return True if another child has replaced one that was killed or stopped by a signal. Raises OSError if the
        child cannot be forked; this is tried again `FORK_PAUSE` s later. If the previous child has failed by itself,
        the next child would fail, too. Then a child is forked only when it is needed."""
        child = self._reserve
        if child is not None and (child.ended or child.was_stopped):
            self.dismiss()
            for file in (self._waiting_pipe, self._start_pipe):
                calls.close(file)
            has_failed = child.status is not None and os.WIFEXITED(child.status)
            self._next_fork = inf if has_failed else 0.0
        if calls.now() < self._next_fork:
            return False
        self._next_fork = calls.now() + FORK_PAUSE
        self.stand_by()
        self._next_fork = inf
        return True

    def hand_over(self) -> None:
        """Work from now on for the guardian that calls this. The child belonged to the previous guardian."""
        self._reserve, self._next_fork = None, inf

    def dismiss(self) -> None:
        """Dismiss the child, because the machine ended safely and needs no reset."""
        child, self._reserve, self._next_fork = self._reserve, None, inf
        if child is not None:
            self._end(child, DEATH_TIMEOUT)

    def reset(
        self,
        lasting: float,
        *,
        is_dead: Callable[[], bool] = lambda: True,
        said: Callable[[str], object] = lambda text: None,
    ) -> dict[str, str]:
        """Bring every actuator to its default, in stop order. Return the actuators that were not reached, with the
        causes.

        Attempts are made for `lasting` s, and then as long as an attempt reaches an actuator that no attempt has
        reached before. Actuators that no attempt has tried are tried for up to the same time again. The last attempt
        uses the timeouts of the wiring, and is repeated as long as it reaches further actuators. So no output stays
        driven on a device that answers when the last attempt begins, or during a part of this attempt. `is_dead`
        returns whether the old process has certainly ended: then everything is reset once more, and a last time when
        pending requests have been carried out."""
        until = calls.now() + lasting
        told = False
        while due := self._due():
            progress = self._run(due, is_dead)
            if calls.now() >= until and not progress:
                break
            if (left := self._left()) and not told:
                told = True
                said(f"not reached yet, retrying for up to {lasting:g} s: {summary(left)}")
            self._prepare_next(is_dead)
        self._try_last(lasting, is_dead)
        return self._left()

    def _try_last(self, lasting: float, is_dead: Callable[[], bool]) -> None:
        """Make the attempts when the time is over. Actuators that no attempt has tried, because others of their driver
        timed out, are tried one by one, for at most `lasting` s."""
        self._is_last = progress = True
        until = inf
        while progress and self._due():
            self._prepare_next(is_dead)
            until = min(until, calls.now() + lasting)
            untried = [number for number in self._due() if number not in self._results]
            self._tries_all = True
            progress = bool(untried) and self._run(untried, is_dead, until)
            self._tries_all = False
            progress |= self._run(self._due(), is_dead)

    def _prepare_next(self, is_dead: Callable[[], bool]) -> None:
        """Prepare the next attempt: end the workers of the actuators that are left, and wait."""
        if left := self._left():
            self._give_up(list(left))
        until = calls.now() + ATTEMPT_PAUSE
        while calls.now() < until:
            is_dead()
            calls.sleep(0.01)

    def _due(self) -> list[int]:
        """Return the numbers of the actuators that must be reset."""
        return [number for number in range(len(self.paths)) if self._result(number)[0] is not Reached.YES]

    def _left(self) -> dict[str, str]:
        """Return the actuators that are not at their defaults, each with the cause."""
        results = ((path, *self._result(number)) for number, path in enumerate(self.paths))
        return {path: cause for path, reached, cause in results if reached in (Reached.UNTRIED, Reached.NO)}

    def _result(self, number: int) -> tuple[Reached, str]:
        """Return the result of the last attempt that has tried this actuator, with the cause."""
        return self._results.get(number, (Reached.UNTRIED, f"not tried: {self._untried_cause}"))

    # The guardian's side -------------------------------------------------------------------------------

    def _run(self, numbers: list[int], is_dead: Callable[[], bool], until: float = inf) -> bool:
        """Make one attempt, in one child and in a further child for each driver that hung or crashed earlier. Return
        True if it has reached an actuator that no earlier attempt had reached."""
        self._state.clear()
        limit = CALL_MARGIN + 2 * max(map(self._timeout, self._timeouts), default=0.0)
        for group in self._groups(numbers):
            self._state.begin(-1)
            if self._begin(group):
                self._follow(is_dead, limit, until)
            else:
                self._work_here(group, is_dead, limit, until)
        self._attempt_number += 1
        for number in numbers:
            reached = self._state.reached(number)
            if reached is not Reached.UNTRIED:
                self._results[number] = reached, self._state.cause(number)
                self._misses[number] += reached is Reached.NO
        return self._attempts.add(n for n in numbers if self._result(n)[0] in (Reached.ONCE, Reached.YES))

    def _groups(self, numbers: list[int]) -> list[list[int]]:
        """Return the groups in stop order. Those that failed before come last, so that they do not delay the others."""
        groups: dict[int, list[int]] = {0: []}
        for number in sorted(numbers, key=lambda number: (self._misses[number], number)):
            driver = id(self._wires[number].driver)
            groups.setdefault(driver if driver in self._stuck_drivers else 0, []).append(number)
        return [group for group in groups.values() if group]

    def _begin(self, numbers: list[int]) -> bool:
        """Let the child on standby work, or fork another child. Return False if no child can be forked."""
        try:
            if self._reserve is not None and len(numbers) == len(self._wires):
                self._let_reserve_work(self._reserve)
                return True
            self._child = self._fork(lambda guardian: self._work(guardian, numbers))
        except OSError:
            self._child = None
            return False
        return True

    def _let_reserve_work(self, child: Child) -> None:
        """Let the child on standby work. Another child is first put on standby, if possible, so that one remains
        whenever this guardian is killed."""
        pipe = self._start_pipe, self._waiting_pipe
        self._reserve = None
        with suppress(OSError):
            self.stand_by(first=False)
        self._child = child
        calls.write(pipe[0], b"!")
        for file in pipe:
            calls.close(file)

    def _fork(self, work: Callable[[int], int], fork: Callable[[], int] = lambda: calls.fork()) -> Child:
        """Fork a child that does this work. It gets the pid of this process."""
        guardian = os.getpid()
        pid = fork()
        if pid == 0:
            carry_out(lambda: self._as_child(guardian, work))
        return Child(pid)

    def _follow(self, is_dead: Callable[[], bool], limit: float, until: float) -> None:
        """Wait until the child ends. End it if one of its calls does not return, or at the time `until`."""
        assert self._child is not None
        child, self._child = self._child, None
        why = ""
        while not child.ended and not why:
            if is_dead():
                self._state.declare_dead()
            silent = self._state.silence > limit
            if silent or calls.now() > until:
                why = f"a call did not return within {limit:g} s" if silent else NO_TIME
            else:
                calls.sleep(LOOK_INTERVAL)
        if why:
            self._end(child, DEATH_TIMEOUT)
        status = child.status or 0
        if status and not why:
            why = _ending(os.WTERMSIG(status)) if os.WIFSIGNALED(status) else "the reset failed"
        if why:
            self._blame(why)

    def _blame(self, why: str) -> None:
        """Attribute the failure to the call in progress; calls after it were not tried."""
        self._untried_cause = why
        if self._state.at >= 0:
            self._stuck_drivers.add(id(self._wires[self._state.at].driver))
            self._state.note(self._state.at, Reached.NO, why)

    def _work_here(self, numbers: list[int], is_dead: Callable[[], bool], limit: float, until: float) -> None:
        """Reset in this process, until `until`, because no child can be forked. A call that does not return, or is
        still running then, is interrupted by an alarm."""

        def interrupt(number: int, frame: FrameType | None) -> None:
            silent = f"a call did not return within {limit:g} s"
            raise DeviceTimeout(silent if calls.now() < until else NO_TIME)

        def look() -> None:
            left = until - calls.now()
            calls.set_alarm(min(limit, left) if left > 0 else limit, limit)
            if is_dead():
                self._state.declare_dead()

        before = calls.handle_signal(signal.SIGALRM, interrupt)
        try:
            self._bring_to_defaults(numbers, look, until)
        except _TimeIsOver:
            self._untried_cause = NO_TIME
        except BaseException as error:
            self._blame(text_of(error))
        finally:
            calls.set_alarm(0)
            calls.handle_signal(signal.SIGALRM, before)

    def _timeout(self, name: str) -> float:
        """Return the timeout of a driver in this attempt, in s. It grows with each attempt, up to
        UNCONTROLLED_TIMEOUT."""
        timeout = self._timeouts[name]
        return (
            timeout if self._is_last else max(timeout, min(timeout * 4.0**self._attempt_number, UNCONTROLLED_TIMEOUT))
        )

    # In the child --------------------------------------------------------------------------------------

    def _as_child(self, guardian: int, work: Callable[[int], int]) -> int:
        """Do this work in a child that ignores the signals that request the run to stop. Return the exit status."""
        name_process("umo reset")
        for number in STOP_SIGNALS:
            calls.handle_signal(number, signal.SIG_IGN)
        return work(guardian)

    def _wait_for_work(self, guardian: int) -> int:
        """Wait, in the child on standby, until the guardian lets it begin. The child survives the guardian, in case no
        other process does."""
        calls.close(self._start_pipe)
        spares = [calls.open(os.devnull, os.O_RDONLY) for _ in range(SPARE_DESCRIPTORS)]
        while not self.takes_place(RESERVE_INTERVAL):  # one that was stopped may never begin
            if self.in_reserve():
                return 0
        while not calls.ready(self._waiting_pipe, RESERVE_INTERVAL):
            if self.in_reserve():
                return 0
        if not calls.read(self._waiting_pipe, 1):  # the guardian is gone
            calls.sleep(RESERVE_INTERVAL)
            while not self.in_reserve():
                calls.sleep(RESERVE_INTERVAL)
            return 0
        for file in spares:
            calls.close(file)
        return self._work(guardian, range(len(self._wires)))

    def _work(self, guardian: int, numbers: Sequence[int]) -> int:
        """Reset in the child. The child is killed when the guardian ends, because another process then resets."""
        calls.die_with_parent(guardian, signal.SIGKILL)
        with suppress(Exception):
            self._guard()
        self._bring_to_defaults(numbers, lambda: None)
        return 0

    def _bring_to_defaults(self, numbers: Sequence[int], look: Callable[[], object], until: float = inf) -> None:
        """Open the drivers, bring the actuators to their defaults, and close the drivers. From the time `until` on, no
        call begins except those that close."""
        segments = self._segments
        for driver in self._wired.drivers.values():
            if isinstance(driver, OffCycle):
                driver.call_here_if_alone()
                driver.end()  # its worker sends nothing by itself any more, even if the old process cannot be killed

        def call() -> None:
            self._state.beat()
            look()

        segments.on_call = call
        opened: list[str] = []
        reached: list[int] = []
        try:
            self._open(numbers, opened, until)
            reached = self._reset_opened([n for n in numbers if self._driver_of(n) in opened], call, until)
        finally:
            for number in reversed(reached):
                segments.finalize(number)
            for name in reversed(opened):
                with suppress(BaseException):
                    segments.close(name)

    def _reset_opened(self, numbers: list[int], call: Callable[[], object], until: float) -> list[int]:
        """Initialise the outputs, reset them when the old process is dead, and reset them again when operations in
        progress are over. Return the outputs that were reached."""
        reached = self._pass(numbers, "initialize", until)
        while not self._state.dead:
            call()
            _look_at_time(until)
            calls.sleep(LOOK_INTERVAL)
        reached = self._pass(reached, "reset", until)
        if reached:
            wait_for(settling(self._wired), calls.sleep, call)
            reached = self._pass(reached, "reset", until, Reached.YES)
        self._state.begin(-1)  # whatever happens from here on, they are at their defaults
        return reached

    def _driver_of(self, number: int) -> str:
        return self._names[id(self._wires[number].driver)]

    def _open(self, numbers: Sequence[int], opened: list[str], until: float) -> None:
        """Open the drivers, and add those that could be opened to `opened`. The actuators of the others are recorded as
        not reached."""
        for name in dict.fromkeys(map(self._driver_of, numbers)):
            mine = [number for number in numbers if self._driver_of(number) == name]
            self._wired.drivers[name].timeout = self._timeout(name)
            _look_at_time(until)
            self._state.begin(mine[0])
            try:
                self._segments.open(name)
            except BaseException as error:
                for number in mine:
                    self._state.note(number, Reached.NO, text_of(error))
                with suppress(BaseException):
                    self._segments.close(name)
                continue
            opened.append(name)

    def _pass(
        self,
        numbers: list[int],
        segment: Literal["initialize", "reset"],
        until: float,
        reached: Reached = Reached.ONCE,
    ) -> list[int]:
        """Carry out one segment for each output, and return those that were reached. This counts only if the old
        process is dead. An output that was not tried, because its driver had timed out, counts as not reached."""
        done = []

        def begin(number: int) -> None:
            _look_at_time(until)
            self._state.begin(number)

        moved = self._segments.bring_to_default(numbers, segment, begin, patient=self._tries_all)
        for number, failure in moved:
            if failure is not None:
                self._state.note(number, Reached.NO, f"{failure.driver}: {failure.cause}")
                continue
            done.append(number)
            if self._state.dead:
                self._state.note(number, reached)
        return done


def _look_at_time(until: float) -> None:
    if calls.now() > until:
        raise _TimeIsOver


def _ending(number: int) -> str:
    """Return how a signal ended the process that resets, as text: it was sent, or a driver crashed."""
    what = "the process that resets was killed" if number in (signal.SIGKILL, *SIGNALS) else "the driver crashed"
    return f"{what} ({signal_name(number)})"


def summary(left: dict[str, str]) -> str:
    """Return failures as text, each cause after the first objects that share it: `z.motor, theta.step: connection
    refused`."""
    causes: dict[str, list[str]] = {}
    for path, cause in left.items():
        causes.setdefault(cause, []).append(path)
    return "; ".join(f"{some(paths)}: {cause}" for cause, paths in causes.items())
