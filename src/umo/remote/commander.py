"""Commands to a running machine: their answers, the lease, and what is held under it."""

from __future__ import annotations

import json
import os
import secrets
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

from umo.clients.client_commands import DEAD_MAN_TIME, LONGEST_LEASE, SHORTEST_LEASE
from umo.cycle.events import LET_GO, CommandState, Event
from umo.cycle.stage import Stage
from umo.errors import CommandRefused, FramesError, LeaseHeld, RangeError, TaskFailed, UmoError
from umo.frames import Reader
from umo.frames.client_memory import LEASE, ClientMemory
from umo.remote.queue import Sender
from umo.remote.suggestions import with_nearest
from umo.system.processes import user_name

ANSWER_PAUSE = 0.002
"""s between two looks for an answer."""
ANSWER_TIMEOUT = 5.0
"""s within which the machine takes a command; five periods if they are longer."""
EVENT_DELAY = 0.05
"""s within which the machine's words follow the end of a lease."""
SIGNS_OF_LIFE = 5
"""Number of signs of life that a client gives in the time of a lease, or the dead-man time of what it holds."""


class Commander:
    """A client of a running station: its frames, and the commands to it."""

    def __init__(self, reader: Reader) -> None:
        self.reader = reader
        """Reader of its frames."""
        self.held_lease: HeldLease | None = None
        """The lease that this client holds."""
        self._cells: ClientMemory | None = None
        """The machine's cells, from the first command on."""
        self._sender: Sender | None = None

    @property
    def running(self) -> bool:
        return self.reader.state is not Stage.ENDED

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
        """A sign of life of this lease's holder, for what it holds at these paths ("": the lease). It has no answer."""
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

    def send(self, do: str, path: str = "", *, key: str = "", who: str = "", **more: Any) -> int:
        """Send a command; its number. CommandRefused if the queue is full, FramesError if the station has ended."""
        cells = self._open_cells()
        if self._sender is None:
            self._sender = Sender(self.reader, cells)
        lease = self.held_lease
        key, who = key or (lease.key if lease else ""), who or (lease.who if lease else _myself())
        return self._sender.send({"do": do, "path": path, "key": key, "who": who, **more})

    def ask(self, do: str, path: str = "", *, while_running: Callable[[], object] = lambda: None, **more: Any) -> Any:
        """Send a command; its result. The machine's errors are raised here. Ctrl-C cancels the command."""
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
            raise error_of(event)
        return json.loads(event.text) if event.text else None

    @contextmanager
    def holding(self, path: str, lasts: float = DEAD_MAN_TIME) -> Iterator[None]:
        """Hold what the block writes or jogs as long as the lease lasts; if it fails, only what was held before."""
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


class HeldLease:
    """`with station.lease("commissioning"):`. Only its holder commands the station.

    A thread gives signs of life for it and for what was written or is jogged, until the block ends. If this process
    dies, the lease ends after `seconds`, and what it held goes to its default. RangeError for other `seconds` than
    a lease may last.
    """

    def __init__(self, station: Commander, who: str, seconds: float, over: bool) -> None:
        if not SHORTEST_LEASE <= seconds <= LONGEST_LEASE:
            raise RangeError(f"a lease can last from {SHORTEST_LEASE:g} to {LONGEST_LEASE:g} s, not {seconds:g} s")
        self.who = who
        self.key = secrets.token_hex(8)
        self.held: dict[str, float] = {}
        """The paths that are held, each with the s for which it lasts."""
        self._since: dict[str, int] = {}
        """The number of the next event when a path was held first."""
        self._station = station
        self._seconds = seconds
        self._over = over
        self._number = 0
        self._ended = False
        self._wake = threading.Event()
        self._thread: threading.Thread | None = None

    @property
    def lost(self) -> bool:
        """Whether it has ended, with the station or by itself, or another client has taken it over."""
        return not (self._station.running and self._station.reader.lease_held(self._number))

    def __enter__(self) -> HeldLease:
        """LeaseHeld, if another client has it, names the argument that takes it over."""
        ask = self._station.ask
        try:
            self._number = ask("lease", key=self.key, who=self.who, seconds=self._seconds, over=self._over)
        except LeaseHeld as error:
            raise LeaseHeld(
                f"{error}; take it over with station.lease(over=True), or wait until it is given back"
            ) from error
        self._station.held_lease = self
        self._thread = threading.Thread(target=self._keep, name="umo lease", daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self.give_back()

    def give_back(self) -> None:
        """End the lease. What it held goes to its default."""
        if self._station.held_lease is not self:  # it was given back before
            return
        try:
            with suppress(UmoError, OSError):  # it is lost, or the station has ended
                if not self.lost:
                    self._station.ask("give back")
        finally:
            self._ended = True
            self._wake.set()
            assert self._thread is not None
            self._thread.join()
            self._station.held_lease = None

    def hold(self, path: str, lasts: float) -> None:
        """Hold this path from now on: the thread may be waiting longer than it lasts."""
        self._since[path] = self._station.reader.next_event
        self._station.sign(self._number, path)
        self.held[path] = lasts
        self._wake.set()

    def ended(self, path: str) -> str:
        """Reason why what was held at this path has ended, in the machine's words; "": it lasts, or was not held."""
        station, lost = self._station, self.lost  # before the events: the last of them may tell why
        if not (told := self._told(path)) and lost and station.running:
            time.sleep(EVENT_DELAY)
            told = self._told(path)
        if told or not lost:
            return told
        return "the lease has ended" if station.running else f"{station.reader.about['station']} has ended"

    def _told(self, path: str) -> str:
        since = self._since.get(path, self._station.reader.next_event)
        events = (each.event for each in self._station.reader.events(since))
        reader = self._station.reader
        return next((each.text for each in events if has_ended(each, path, reader)), "")

    def _keep(self) -> None:
        """Give signs of life until the block ends, or the lease is lost."""
        with suppress(FramesError):  # the station has just ended
            while not (self._ended or self.lost):
                self._station.sign(self._number, LEASE, *self.held.copy())
                self._wake.wait(min([self._seconds, *self.held.copy().values()]) / SIGNS_OF_LIFE)
                self._wake.clear()


class Answers:
    """The answers to the command of this number. `start`: the number of the next event before it was sent."""

    def __init__(self, reader: Reader, number: int, start: int) -> None:
        self.begun = False
        """An action has begun; its end is still to come."""
        self._reader = reader
        self._number = number
        self._next = start
        self._limit = max(ANSWER_TIMEOUT, 5 * reader.about["period"])
        self._until = time.monotonic() + self._limit

    def new(self) -> list[Event]:
        """New answers. CommandRefused if none has come in time, FramesError if none can come any more."""
        ended = self._reader.state is Stage.ENDED  # before the events: the last of them may be the answer
        events = self._reader.events(self._next)
        if events:
            self._next = events[-1].number + 1
        layout = self._reader.layout
        found = [with_nearest(each.event, layout) for each in events if each.event.command == self._number]
        self.begun = self.begun or bool(found)
        if not found and ended:
            raise FramesError(f"{self._reader.about['station']} has ended before it answered")
        if not self.begun and time.monotonic() > self._until:
            raise CommandRefused(f"the machine has not answered within {self._limit:g} s")
        return found

    def end(self) -> Event | None:
        """The last answer, if it has come."""
        return next((event for event in self.new() if event.state is not CommandState.BEGUN), None)


def has_ended(event: Event, path: str, reader: Reader) -> bool:
    """Whether an event tells that what was held at this path has ended: by itself, or as one of several actuators for
    one reason. Of those the text names the first: what is still taken by a client has not ended. Of an action each end
    is told by itself."""
    if event.state is not CommandState.CANCELLED:
        return False
    if event.command or event.asked != LET_GO:
        return event.path == path
    return reader.is_object(path) and is_beside(path, event.path) and not reader.is_taken(path)


def is_beside(path: str, around: str) -> bool:
    """Whether a path is below another; "": every one is."""
    return not around or path.startswith(f"{around}.")


def error_of(event: Event) -> Exception:
    """The machine's error, of its own type where that is umo's."""
    if event.state is CommandState.CANCELLED:
        return TaskFailed(f"{event.path or event.asked} was cancelled: {event.text}")
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
