"""A running station, seen from another program: values, actions, tunable numbers."""

from __future__ import annotations

import json
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from umo.cycle.client_control import DEAD_MAN_TIME
from umo.cycle.events import CommandState, Event
from umo.cycle.stage import Progress, Stage
from umo.errors import FramesError, TaskFailed, UmoError
from umo.frames import Reader
from umo.frames.client_memory import ClientMemory
from umo.frames.reader import progress_of
from umo.remote.answers import Answers
from umo.remote.held_lease import HeldLease
from umo.remote.live_view import LiveView
from umo.remote.members import RemotePart, Tree
from umo.remote.queue import Sender
from umo.remote.search import find_running
from umo.scope.history import samples
from umo.scope.svg import Scope
from umo.system.processes import user_name

ANSWER_PAUSE = 0.002
"""s between two looks for an answer."""


def attach(station: str | int | None = None) -> RemoteStation:
    """A station that runs in real time on this computer, by name or pid; default: the only one.

        station = umo.attach("ztheta")
        station.z.encoder.read()
        with station.lease("commissioning"):
            station.mode = "manual"
            station.z.move_to(100_000)
            station.z.servo.gain = 0.004

    FramesError if none or several run; it names those that do. Reading disturbs nothing. Commands need the lease, and
    pass the same guards as the program's.
    """
    return RemoteStation(find_running(None if station is None else str(station)))


class RemoteStation(RemotePart):
    """A running station. Its objects, compounds, actions and tunable numbers are attributes, as in its declaration;
    one with the name of a member of this class is reached by its path: `station["stop"]`."""

    def __init__(self, reader: Reader) -> None:
        self.__dict__.update(reader=reader, held_lease=None, _cells=None, _sender=None)
        super().__init__(self, Tree(reader), "")

    reader: Reader
    """Reader of its frames."""
    held_lease: HeldLease | None
    """The lease that this client holds."""
    _cells: ClientMemory | None
    """The machine's cells, from the first command on."""
    _sender: Sender | None

    # What can be seen ----------------------------------------------------------------------------------

    @property
    def running(self) -> bool:
        return self.reader.state is not Stage.ENDED

    @property
    def mode(self) -> str:
        """ "automatic" or "manual"; "" if the station takes no commands. It is set under the lease."""
        return "" if self.reader.mode is None else str(self.reader.mode)

    @mode.setter
    def mode(self, mode: str) -> None:
        self.ask("mode", value=str(mode))

    @property
    def progress(self) -> Progress:
        """The progress of its work that the machine told last."""
        return progress_of(self.reader.latest())

    @property
    def events(self) -> list[Event]:
        """The last events, oldest first: commands with their answers, actions of guards."""
        return [each.event for each in self.reader.events()]

    def frames(self, seconds: float) -> dict[str, npt.NDArray[np.float64]]:
        """The last frames as arrays: "time" in s, and every object and signal by its path, NaN where it was BAD. As
        many as the ring still holds."""
        reader = self.reader
        period = reader.about["period"] or 0.01
        rows = reader.last(max(1, round(seconds / period)))
        columns = zip([*reader.paths, *reader.signals], samples(rows).T, strict=True)
        return {"time": np.array(rows["time"])} | {path: column.copy() for path, column in columns}

    # In a notebook -------------------------------------------------------------------------------------

    def live(self, *paths: str) -> LiveView:
        """Show a table of the values here in the notebook, and keep it up to date. `paths`: of objects, compounds,
        signals, or patterns such as "zones.*.heater"; default: all.

        It ends with the station, with its `stop()`, or with this program. PathError for a path that names nothing;
        FramesError outside of a notebook, or if the station has ended.
        """
        return LiveView(self.reader, lambda own: partial(own.html, paths))

    def scope(self, *paths: str, seconds: float = 10.0) -> LiveView:
        """Show objects and signals against time here in the notebook, as they change. `seconds` is the span, up to 300.

        Numbers of one unit share a lane; binary objects are bars. No peak is lost: least and greatest value are drawn
        for each pixel. Ends and errors as of `live`; RangeError for another span; up to 16 traces.
        """
        return LiveView(self.reader, lambda own: Scope(own, paths, seconds).draw)

    # Commands ------------------------------------------------------------------------------------------

    def lease(self, who: str = "", *, seconds: float = 2.0, over: bool = False) -> HeldLease:
        """The right to command, for a `with` block. `who` is shown to everybody; default: user and program.

        CommandRefused while another client has it, unless it is deliberately taken over (`over`). It is renewed
        meanwhile, and ends `seconds` (0.2 to 60) after this process has died or hangs.
        """
        return HeldLease(self, who or _myself(), seconds, over)

    def stop(self, who: str = "") -> None:
        """Ask the run to end safely: every actuator goes to its default. Returns at once; it needs no lease, and no
        queue of commands delays it. `who` is told at the end; default: user and program."""
        self._open_cells().ask_to_stop(signal.SIGTERM, who or _myself())

    def sign(self, lease: int, *paths: str) -> None:
        """Give a sign of life of the holder of this lease, for all that it holds at these paths; "": for the lease.
        It is written, and not answered."""
        cells, now = self._open_cells(), time.monotonic_ns()
        for path in paths:
            cells.sign(path, lease, now)

    def _open_cells(self) -> ClientMemory:
        """FramesError if the station has ended or takes no commands."""
        reader = self.reader
        if not self.running:
            raise FramesError(f"{reader.about['station']} has ended")
        if self._cells is None:
            if reader.mode is None or reader.ends is None:
                raise FramesError(f"{reader.about['station']}: it takes no commands")
            self._cells = ClientMemory(reader.ends.cells, reader.layout)
        return self._cells

    def acknowledge(self, path: str = "") -> bool:
        """Acknowledge latched interlocks, of an object or compound, or ("") of the machine: what they inhibit is free
        again. False if none was latched. CommandRefused while one of their conditions still holds. Under the lease, in
        any mode."""
        return self.ask("acknowledge", path) is None

    def send(self, do: str, path: str = "", *, key: str = "", who: str = "", **more: Any) -> int:
        """Send a command; its number. CommandRefused if the queue is full, FramesError if the station has ended."""
        cells = self._open_cells()
        if self._sender is None:
            self._sender = Sender(self.reader, cells)
        lease = self.held_lease
        key, who = key or (lease.key if lease else ""), who or (lease.who if lease else _myself())
        return self._sender.send({"do": do, "path": path, "key": key, "who": who, **more})

    def ask(self, do: str, path: str = "", *, while_running: Callable[[], object] = lambda: None, **more: Any) -> Any:
        """Send a command and wait for its end; its result. The machine's errors are raised here. Ctrl-C cancels the
        command."""
        start = self.reader.next_event
        answers = Answers(self.reader, self.send(do, path, **more), start)
        try:
            while (event := answers.end()) is None:
                if answers.begun:
                    while_running()
                time.sleep(ANSWER_PAUSE)
        except KeyboardInterrupt:
            if do == "call":
                with suppress(UmoError):
                    self.send("cancel", path)
            raise
        if event.state is not CommandState.DONE:
            raise _raised(event)
        return json.loads(event.text) if event.text else None

    @contextmanager
    def holding(self, path: str, lasts: float = DEAD_MAN_TIME) -> Iterator[None]:
        """Hold what the block writes or jogs as long as the lease lasts; if it fails, only what was held
        before."""
        lease = self.held_lease
        before = lease is not None and path in lease.held
        if lease is not None:
            lease.hold(path, lasts)
        try:
            yield
        except BaseException:
            if not before:
                self.let_go(path)
            raise

    def let_go(self, path: str) -> None:
        """Release what is written or jogged."""
        if self.held_lease is not None:
            self.held_lease.held.pop(path, None)

    def close(self) -> None:
        """Detach. A lease that this station still holds is given back."""
        if self.held_lease is not None:
            self.held_lease.give_back()
        if self._sender is not None:
            self._sender.close()
            self._sender = None
        if self._cells is not None:
            self._cells.close()
            self._cells = None
        self.reader.close()

    def __setattr__(self, name: str, value: Any) -> None:
        if name in RemoteStation.__annotations__ or isinstance(getattr(RemoteStation, name, None), property):
            object.__setattr__(self, name, value)
        else:
            super().__setattr__(name, value)

    def __enter__(self) -> RemoteStation:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def __repr__(self) -> str:
        about, reader = self.reader.about, self.reader
        now = "detached" if reader.closed else f"{reader.state}, {self.mode or 'no commands'}"
        return f"<{about['station']}, pid {about['pid']}, {now}>"


def _raised(event: Event) -> Exception:
    """The machine's error, of its own type where that is umo's."""
    if event.state is CommandState.CANCELLED:
        return TaskFailed(f"{event.path} was cancelled: {event.text}")
    name, _, text = event.text.partition(": ")
    kind = {each.__name__: each for each in _kinds(UmoError)}.get(name)
    if kind is None:
        return TaskFailed(event.text)
    error = kind.__new__(kind)  # without its constructor, which makes the message of other things
    error.args = (text,)
    return error


def _kinds(base: type[UmoError]) -> Iterator[type[UmoError]]:
    for kind in base.__subclasses__():
        yield kind
        yield from _kinds(kind)


def _myself() -> str:
    program = os.path.basename(sys.argv[0]) if sys.argv and sys.argv[0] else "python"
    return f"{user_name()}, {program} (pid {os.getpid()})"
