"""The other programs of a world with clients: two that command the machine, the host of the faces with one face, and
the recorder. All have umo's own code; what they ask for is written here.

A starter forks them when its run publishes frames, and closes all but the descriptors of the frames in them, as
programs have it that attach to a station. Each stands at its gate before it writes to memory that it shares with the
machine, and when it has learnt something. Its exit status is 0 where it has done all that it was to do.
"""

from __future__ import annotations

import asyncio
import fcntl
import os
import signal
import socket
from collections.abc import Callable, Coroutine
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from selectors import SelectorKey, SelectSelector
from typing import Any

from tools.schedules.gate import Gate
from tools.schedules.machine import UNIT
from tools.schedules.scheduler import CLIENTS
from umo.clients.faces.face import Changes, Commands, Face, User
from umo.clients.faces.host import FaceHost
from umo.clients.remote.client_session import ClientSession
from umo.cycle.events import Event
from umo.errors import FramesError, UmoError
from umo.operation.commands.verbs import CLEAR, GIVE_BACK, LET_GO, MODE, TAKE_LEASE, WRITE, Verb
from umo.process.frames import Reader
from umo.process.frames.memory import RunDescriptors
from umo.process.frames.ring import Ring
from umo.recording.record_settings import RecordSettings
from umo.system import calls, notify
from umo_command.run.record_work import RecordingWork, record_to_the_end

OPERATOR, SUPERVISOR, FACES, RECORDER = CLIENTS
WRITTEN = {OPERATOR: 3, SUPERVISOR: 4}
"""The level that each writes; the application writes greater ones."""
LEASE_SECONDS = 0.2
LOOK, AGAIN = 0.01, 0.03
"""Time in s from one look for an answer to the next, and from a refusal to the next attempt."""
SUPERVISOR_BEGINS = 0.09
"""Time in s after which the supervisor takes the lease over: the operator is at work."""
HELD_LOOKS = 25
"""Looks for which a client holds an actuator: longer than a lease lasts that nobody renews."""
FACE_RATE = 50.0
WATCHDOG = 60_000
"""Time in us within which the service manager wants a sign of life: less than a control process may be silent for."""
RUN_IS_OVER, NOT_DONE = 1, 3
"""Exit statuses."""


def become(gate: Gate, name: str, ends: RunDescriptors, recording: Path) -> int:
    """Be this program, in a process that was forked for it; its exit status."""
    reader = Reader("the run", ends)
    if name == RECORDER:
        return _record(reader, recording)
    return _serve(reader, gate) if name == FACES else _Client(reader, gate, name).run()


# Two that command -----------------------------------------------------------------------------------------


class _Client:
    """Takes the lease, drives an output in manual mode for a while, and gives all back. On SIGTERM it asks the machine
    to stop (`What.ASK`)."""

    def __init__(self, reader: Reader, gate: Gate, name: str) -> None:
        self._gate, self._name = gate, name
        self._session = ClientSession(reader)
        self._takes_over = self._name == SUPERVISOR
        signal.signal(signal.SIGTERM, self._stop)

    def _stop(self, number: int, frame: object) -> None:
        with suppress(FramesError):  # the run has ended
            self._session.stop(self._name)

    def run(self) -> int:
        if self._takes_over:
            calls.sleep(SUPERVISOR_BEGINS)
        try:
            while not self._work():
                calls.sleep(AGAIN)
        except FramesError as error:
            self._gate.stand(f"told the run is over: {error}")
            return RUN_IS_OVER
        return 0

    def _work(self) -> bool:
        """Whether all was done; False: something was refused, and it begins again."""
        steps = (
            (TAKE_LEASE, "", {"seconds": LEASE_SECONDS, "over": self._takes_over}, 0),
            (MODE, "", {"value": "manual"}, 0),
            (WRITE, "motor", {"value": float(WRITTEN[self._name])}, HELD_LOOKS),
            (LET_GO, "motor", {}, 0),
            (MODE, "", {"value": "automatic"}, 0),
            (GIVE_BACK, "", {}, 0),
        )
        return all(self._ask(*step) for step in steps)

    def _ask(self, verb: Verb, path: str, fields: dict[str, Any], looks: int) -> bool:
        asked = self._session.asking(verb.name, path, who=self._name, **fields)
        try:
            asked.send()
            while asked.end is None:
                self._pass()
                asked.look()
            asked.outcome()
        except FramesError:
            raise
        except UmoError as error:
            asked.forget()
            self._gate.stand(f"told {verb.name} refused: {error}")
            return False
        self._gate.stand(f"told {verb.name} done")
        for _ in range(looks):
            self._pass()
        return True

    def _pass(self) -> None:
        calls.sleep(LOOK)
        self._session.keep()


# The faces ------------------------------------------------------------------------------------------------


class _OverError(Exception):
    """The run is over, and no other one comes."""


class _Panel(Face):
    """A face whose user clears the unit when it is in fault, and then lets the application go on."""

    def __init__(self, gate: Gate) -> None:
        self._gate = gate
        self._user = User(FACES, proved=True, is_owner=True, is_alive=lambda: True)
        self._commanding: asyncio.Task[None] | None = None
        self.is_done = False

    async def begin(self, machine: Any, commands: Commands) -> None:
        self._gate.stand("told begin")
        self._commanding = asyncio.create_task(self._command(commands))

    async def _command(self, commands: Commands) -> None:
        try:
            while not (await self._ask(commands, CLEAR, path=UNIT)).startswith("cleared"):
                await asyncio.sleep(AGAIN)
            while not await self._ask(commands, MODE, value="automatic"):
                await asyncio.sleep(AGAIN)
        except FramesError:
            return
        self.is_done = True

    async def _ask(self, commands: Commands, verb: Verb, path: str = "", **more: Any) -> str:
        """The answer; "": it was refused."""
        try:
            answer = await commands.ask(self._user, verb.name, path, **more)
        except FramesError:
            raise
        except UmoError as error:
            self._gate.stand(f"told {verb.name} refused: {error}")
            return ""
        self._gate.stand(f"told {verb.name} done")
        return str(answer or verb.name)

    async def frames(self, changes: Changes) -> None:
        return

    async def end(self, why: str) -> None:
        self._gate.stand(f"told end: {why}")
        if self._commanding is not None:
            self._commanding.cancel()


def _serve(reader: Reader, gate: Gate) -> int:
    """The host of the faces for one run."""
    readers = [reader]

    def find() -> Reader:
        if not readers:
            raise _OverError
        return readers.pop()

    panel = _Panel(gate)
    host = FaceHost(None, [("panel", panel)], rate=FACE_RATE, read_only=False, find=find, say=lambda text: None)
    _in_loop(host.run())
    return 0 if panel.is_done else NOT_DONE


class Here(ThreadPoolExecutor):
    """Carries out at once what is given to a thread: a process has one gate."""

    def submit(self, function: Callable[..., Any], /, *arguments: Any, **more: Any) -> Future[Any]:
        future: Future[Any] = Future()
        try:
            future.set_result(function(*arguments, **more))
        except BaseException as error:
            future.set_exception(error)
        return future


class _Waits(SelectSelector):
    """Waits on the clock of the world. Nobody but signals and timers wakes the loop of a host."""

    def select(self, timeout: float | None = None) -> list[tuple[SelectorKey, int]]:
        if found := super().select(0):
            return found
        if timeout is None or timeout > 0:
            calls.sleep(1.0 if timeout is None else timeout)
        return super().select(0)


def _in_loop(work: Coroutine[Any, Any, None]) -> None:
    loop = asyncio.SelectorEventLoop(_Waits())
    loop.set_default_executor(Here(1))
    try:
        loop.run_until_complete(work)
    except _OverError:
        return
    finally:
        loop.close()


# The recorder ---------------------------------------------------------------------------------------------


def _record(reader: Reader, file: Path) -> int:
    work = RecordingWork(reader, file, RecordSettings(), lambda text: None, threaded=False)
    record_to_the_end(work, lambda: False, calls.sleep)
    return NOT_DONE if work.failed else 0


# Gates at what the machine and its clients share ------------------------------------------------------------


class QueueLock:
    """The lock of the queue of commands, with a gate before each call."""

    LOCK_EX, LOCK_NB, LOCK_UN = fcntl.LOCK_EX, fcntl.LOCK_NB, fcntl.LOCK_UN

    def __init__(self, gate: Gate) -> None:
        self._gate = gate

    def flock(self, file: int, how: int) -> None:
        self._gate.stand("unlock queue" if how & fcntl.LOCK_UN else "lock queue")
        fcntl.flock(file, how)


def events_of(ring: Ring) -> list[str]:
    """The events that a ring is to publish, a line for each."""
    new = ring._events.recent(ring._events.told - ring._told)
    return [f"event {each.who or 'machine'} {each.state} {_subject(each)}" for each in new]


def _subject(event: Event) -> str:
    return f"{event.asked} {event.path}".strip() if event.command else event.text


class Manager:
    """The service manager of a run, in the process that has started it: who tells it more than it has room for has to
    tell it again (`umo.system.notify`)."""

    def __init__(self, name: str) -> None:
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.bind(f"\0{name}")
        os.environ |= {
            notify.SOCKET: f"@{name}", notify.WATCHDOG: str(WATCHDOG), notify.WATCHDOG_PID: str(os.getpid())
        }  # fmt: skip

    def read(self) -> None:
        with suppress(BlockingIOError):
            while True:
                self._socket.recv(1 << 12)
