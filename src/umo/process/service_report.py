"""The messages of a guardian to the service manager: start, state, heartbeats and stop of the machine.

The guardian sends these messages, or the standby guardian when it has taken over. A heartbeat for the manager's
watchdog is sent only after a new heartbeat of the control process.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from umo.cycle.stage import Stage
from umo.process.frames import RunReader
from umo.process.frames.run_reader import progress_of
from umo.process.run_state import RunState
from umo.system import calls, notify
from umo.system.notify import ServiceManager

STATUS_INTERVAL = 1.0
"""The shortest time in s between two checks of the state of the machine."""
SHOWN = ("mode", "progress", "in fault", "alarms")
"""The facts of a run in the status line."""


class ServiceReport:
    """The reports of one run to the service manager. `reader` returns the reader of the run's frames, or None while
    there are none. Without a service manager nothing is done. `clock` is in s."""

    def __init__(
        self,
        manager: ServiceManager,
        run_state: RunState,
        reader: Callable[[], RunReader | None],
        clock: Callable[[], float] | None = None,
    ) -> None:
        self._manager = manager
        self._run_state = run_state
        self._reader = reader
        self._clock = clock or calls.now
        self._is_ready = self._is_stopping = False
        self._beat = -1
        """The heartbeat that was passed on last."""
        self._next_alive = self._next_status = 0.0
        self._status = ""
        self._seen: tuple[object, ...] = ()
        """The facts from which the last status was made."""

    @classmethod
    def of_this_process(cls, run_state: RunState, reader: Callable[[], RunReader | None]) -> ServiceReport:
        """Return the report to the service manager that has started the parent of this process, if there is one. Its
        environment variables are removed."""
        manager = ServiceManager.of_environment(os.environ, (os.getpid(), os.getppid()))
        notify.without(os.environ)
        return cls(manager, run_state, reader)

    def look(self) -> None:
        """Check once. The guardian calls this every 20 ms while the control process runs."""
        if not self._manager.listens or self._is_stopping:
            return
        stage, now = self._run_state.stage, self._clock()
        if stage is Stage.STARTING:
            return
        if stage is not Stage.RUNNING:
            self.stopping("every actuator goes to its default")
            return
        self._ready()
        self._pass_on_life(now)
        if now >= self._next_status:
            self._next_status = now + STATUS_INTERVAL
            self._tell_status()

    def take_over(self) -> None:
        """Begin in the process that takes the guardian's place. The guardian has passed on the last heartbeat."""
        self._beat = self._run_state.last_beat

    def stopping(self, why: str) -> None:
        """Report once that the machine stops. Then the manager's watchdog ends, and its timeout of the stop begins. If
        the manager has no room for the message, nothing is reported, and a further call reports it."""
        if self._manager.listens and not self._is_stopping:
            if self._has_run():  # a run may be over between two looks; one that was never ready counts as failed
                self._ready()
            self._is_stopping = self._manager.tell(notify.STOPPING, notify.status(f"stopping: {why}"))

    def _has_run(self) -> bool:
        with suppress(Exception):
            return (reader := self._reader()) is not None and reader.latest() is not None
        return False

    def _ready(self) -> None:
        if not self._is_ready:
            self._is_ready = self._manager.tell(notify.READY)

    def _pass_on_life(self, now: float) -> None:
        beat = self._run_state.last_beat
        due = self._manager.watchdog and now >= self._next_alive and beat != self._beat
        if due and self._manager.tell(notify.ALIVE):
            self._beat, self._next_alive = beat, now + self._manager.watchdog / 2

    def _tell_status(self) -> None:
        reader = self._reader()
        frame = None if reader is None else reader.latest()
        seen = _told_by(reader, frame)
        if seen == self._seen:
            return
        facts = {} if reader is None else reader.facts(frame)
        text = "; ".join(filter(None, (facts.get(name, "") for name in SHOWN))) or "running"
        if text == self._status or self._manager.tell(notify.status(text)):
            self._status, self._seen = text, seen


def _told_by(reader: RunReader | None, frame: Any) -> tuple[object, ...]:
    """Return the facts on which the status depends. Formatting them reads all events, which is too much for each
    second."""
    if reader is None or frame is None:
        return (reader is None,)
    columns = frame["equipment"].tobytes(), frame["alarms"].tobytes()
    now = reader.now()
    return now.mode, progress_of(frame), now.next_event, *columns
