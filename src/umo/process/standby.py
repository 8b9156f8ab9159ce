"""The standby guardian: a second guardian that waits until the first one dies or gives no sign of life.

It is forked by the guardian before anything is driven, in a session of its own, and does nothing else meanwhile. When
it takes over it is the only guardian: it has killed the first one and its child that resets, and waited for their end
(up to 5 s: what is blocked in a kernel call cannot be killed).
"""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from time import monotonic, sleep

from umo.errors import text_of
from umo.process.messages import MessageSocket
from umo.process.reset import DEATH_TIMEOUT, STOP_SIGNALS
from umo.process.run_state import RunState, Who
from umo.system.processes import ProcessHandle, carry_out, end_child, name_process

LOOK_INTERVAL = 0.1
"""Time in s between two looks at the guardian's signs of life; its death is seen at once."""
CONCLUDING_LIMIT = 30.0
"""Timeout in s for the guardian's signs of life while it resets, records and tells: drivers and disks may be slow."""
FORK_PAUSE = 1.0
"""Time in s from one standby guardian that could not be forked to the next try."""


class Standby:
    """The standby guardian of the process that makes this. `limit`: timeout in s for that one's signs of life.
    `take_over` is carried out in the standby guardian. The starter is told its pid; `say` tells the user what went
    wrong."""

    def __init__(
        self,
        run_state: RunState,
        limit: float,
        take_over: Callable[[], object],
        channel: MessageSocket,
        say: Callable[[str], object],
    ) -> None:
        self._run_state = run_state
        self._limit = limit
        self._take_over = take_over
        self._channel = channel
        self._say = say
        self._guardian = ProcessHandle(os.getpid())
        self._pid = 0
        self._next_fork = 0.0
        """Time at which another one is forked, if there is none."""

    def appoint(self) -> None:
        """Fork it. When this returns it is on its guard; if it cannot be forked the user is told."""
        try:
            self._pid = self._run_state.fork(Who.STANDBY)
        except OSError as error:
            self._next_fork = monotonic() + FORK_PAUSE
            self._say(
                f"no standby guardian: {text_of(error)}; if the guardian is killed too, nothing resets the machine"
            )
            return
        if self._pid == 0:
            carry_out(self._stand_by)
        self._channel.send("standby", pid=self._pid)

    def look(self) -> None:
        """Fork another one if it has died or was stopped by a signal."""
        if self._pid:
            pid, status = os.waitpid(self._pid, os.WNOHANG | os.WUNTRACED)
            if not pid:
                return
            if os.WIFSTOPPED(status):
                self.dismiss()
            self._pid = 0
            self._say("the standby guardian was killed or stopped; another one takes its place")
        if monotonic() >= self._next_fork:
            self._next_fork = monotonic() + FORK_PAUSE
            self.appoint()

    def dismiss(self) -> None:
        """End it: the run is over, recorded and told."""
        if self._pid:
            end_child(self._pid, DEATH_TIMEOUT)
            self._pid = 0

    # The standby guardian ------------------------------------------------------------------------------

    def _stand_by(self) -> int:
        name_process("umo standby")
        for number in STOP_SIGNALS:
            signal.signal(number, signal.SIG_IGN)
        self._wait()
        self._make_sure()
        self._take_over()
        return 0

    def _wait(self) -> None:
        """Wait until the guardian is dead, or silent for so many looks: the whole computer may stand still."""
        last = looks = 0
        while not self._run_state.gone(LOOK_INTERVAL, Who.GUARDIAN):
            looks = looks + 1 if self._run_state.last_watch == last else 0
            last = self._run_state.last_watch
            if looks * LOOK_INTERVAL > (CONCLUDING_LIMIT if self._run_state.concluding else self._limit):
                return

    def _make_sure(self) -> None:
        """End the guardian, and wait for it and its child: only the control process may still write to a device."""
        self._guardian.send(signal.SIGKILL)
        until = monotonic() + DEATH_TIMEOUT
        while not (self._guardian.ended and self._run_state.gone(0.0, Who.RESET)) and monotonic() < until:
            sleep(0.0005)
