"""The followers of the guardian: a standby guardian, and after it the process that waits to reset the machine.

The guardian forks the standby guardian in a new session before anything is driven. The standby guardian waits until the
guardian dies or gives no heartbeat. The reserve, the child process that waits to reset for the guardian, takes the
place of both when they are dead, or when neither gives a heartbeat. The process that takes over is the only guardian:
it has killed its predecessors and their child that resets, and has waited for their end (up to 5 s, because a process
that is blocked in a kernel call cannot be killed)."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable

from umo.errors import text_of
from umo.process.messages import MessageSocket
from umo.process.reset import DEATH_TIMEOUT, FORK_PAUSE, STOP_SIGNALS
from umo.process.run_state import RunState, Who
from umo.system import calls
from umo.system.processes import Child, ProcessHandle, carry_out, identity, name_process

LOOK_INTERVAL = 0.1
"""The time in s between two checks of the guardian's heartbeats. The death of the guardian is detected immediately."""
CONCLUDING_LIMIT = 30.0
"""The timeout in s for the guardian's heartbeats while it resets, records and reports. It is long because drivers and
disks may be slow."""
RESERVE_GRACE = 1.0
"""The time in s after these limits for which the reserve still waits for the standby guardian."""


class Silence:
    """The measurement of the time for which no guardian has given a heartbeat. It counts looks that are `LOOK_INTERVAL`
    s apart, because the whole computer may have been suspended. `limit` is in s."""

    def __init__(self, run_state: RunState, limit: float) -> None:
        self._run_state, self._limit = run_state, limit
        self._last = self._looks = 0

    def look(self) -> float:
        """Return the time in s by which the silence exceeds its limit; below 0 if it does not."""
        run_state = self._run_state
        self._looks = self._looks + 1 if run_state.last_watch == self._last else 0
        self._last = run_state.last_watch
        return self._looks * LOOK_INTERVAL - (CONCLUDING_LIMIT if run_state.concluding else self._limit)


class Standby:
    """The standby guardian, and the reserve, of the process that makes this object. `limit`: the timeout in s for a
    guardian's heartbeats. `take_over` is carried out in the process that takes over. The starter gets the pid of the
    standby guardian. `say` prints failures."""

    def __init__(
        self,
        run_state: RunState,
        limit: float,
        take_over: Callable[[], object],
        channel: MessageSocket,
        say: Callable[[str], object],
    ) -> None:
        self._run_state = run_state
        self._take_over = take_over
        self._channel = channel
        self._say = say
        self._guardian = ProcessHandle(os.getpid())
        self._silence = Silence(run_state, limit)
        self._child: Child | None = None
        self._next_fork = 0.0
        """The time at which another standby guardian is forked, if there is none."""

    def appoint(self) -> None:
        """Fork the standby guardian, and wait until it watches. If the standby guardian cannot be forked, a notice is
        printed."""
        try:
            pid = self._run_state.fork(Who.STANDBY)
        except OSError as error:
            self._next_fork = calls.now() + FORK_PAUSE
            self._say(f"no standby guardian: {text_of(error)}; umo tries again")
            return
        if pid == 0:
            carry_out(self._stand_by)
        self._child = Child(pid)
        tell_who(self._channel, "standby", pid)

    def look(self) -> None:
        """Fork another standby guardian if it has died or was stopped by a signal."""
        if self._child is not None:
            if not (self._child.ended or self._child.was_stopped):
                return
            self.dismiss()
            self._say("the standby guardian was killed or stopped; another one takes its place")
        if calls.now() >= self._next_fork:
            self._next_fork = calls.now() + FORK_PAUSE
            self.appoint()

    def dismiss(self) -> None:
        """End the standby guardian, after the run was recorded and reported."""
        child, self._child = self._child, None
        if child is not None:
            self._run_state.end_process(child, DEATH_TIMEOUT)

    # The standby guardian ------------------------------------------------------------------------------

    def _stand_by(self) -> int:
        if not self._run_state.holds(Who.STANDBY):  # the reserve has taken this place meanwhile
            return 1
        name_process("umo standby")
        for number in STOP_SIGNALS:
            calls.handle_signal(number, signal.SIG_IGN)
        while not self._run_state.gone(LOOK_INTERVAL, Who.GUARDIAN) and self._silence.look() <= 0:
            pass
        self._follow()
        return 0

    def _follow(self) -> None:
        """Become the only guardian. The starter is told which process this is, as the guardian may have died before it
        told."""
        tell_who(self._channel, "standby", os.getpid())
        self._make_sure()
        self._take_over()

    def _make_sure(self) -> None:
        """End the guardian, and wait for the end of the guardian and its child. Then only the control process can still
        write to a device."""
        until = calls.now() + DEATH_TIMEOUT
        self._run_state.end_process(self._guardian, DEATH_TIMEOUT)
        self._run_state.wait(lambda: self._run_state.gone(0.0, Who.RESET), until - calls.now())

    # The reserve ---------------------------------------------------------------------------------------

    def follow_both(self) -> bool:
        """Check once. The reserve calls this every `LOOK_INTERVAL` s. Return True if the run has ended, by itself or by
        the reserve."""
        run_state = self._run_state
        both_dead = run_state.gone(0.0, Who.GUARDIAN) and self._standby_is_out()
        if run_state.told or (both_dead and not run_state.admitted):  # nothing was driven
            return True
        if not both_dead and self._silence.look() <= RESERVE_GRACE:
            return False
        self._guardian.send(signal.SIGKILL)
        if not (run_state.end(Who.STANDBY, DEATH_TIMEOUT) and run_state.hold(Who.STANDBY)):
            return False  # one that the guardian had just forked
        name_process("umo standby")
        self._follow()
        return True

    def _standby_is_out(self) -> bool:
        """True if the standby guardian is dead, or was killed or stopped by a signal when it is its turn."""
        if self._run_state.gone(0.0, Who.STANDBY):
            return True
        process = self._run_state.process(Who.STANDBY)
        return process is not None and (process.is_stopped or process.is_killed)


def tell_who(channel: MessageSocket, kind: str, pid: int) -> None:
    """Send the starter the identity of this process, which cannot be confused with the identity of another process."""
    channel.send(kind, pid=pid, identity=identity(pid))
