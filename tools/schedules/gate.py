"""The process side: before each call that others can observe, a process stands at its gate until the scheduler lets it
go on.

The functions of `umo.system.calls` are replaced by those of `Gate`, which ask first and then make the real call. A call
that waits becomes the real call that does not, made again at each event and at the end of its time. Clocks are those of
the world. What only the process itself can notice (descriptors of its own, handlers of signals) is not asked for.
"""

from __future__ import annotations

import ctypes
import errno
import os
import select
import signal
import stat
import struct
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from math import inf
from typing import Any, NoReturn

from tools.schedules.shared import DYING, Cell, Effect, Memory, Slot, Wakes, await_turn
from umo.system import calls

FOREVER = 1 << 62
"""ns."""
NS = 1_000_000_000
CRASHED = 97
MAX_NAME_BYTES = 107
"""Bytes of the name of a socket (unix(7))."""
SIGACTION_BYTES = 256
"""More than a struct sigaction has (sigaction(2)); its handler is the first field."""
_real = {name: getattr(calls, name) for name in vars(calls) if callable(getattr(calls, name))}
_libc = ctypes.CDLL(None)
Look = Callable[[], Any]
"""A call that does not wait; None: it is not ready."""


class Gate:
    """The gate of this process, and after a fork that of the child."""

    def __init__(self, memory: Memory, slot: Slot, prefix: str) -> None:
        """`prefix`: of the abstract names of sockets."""
        self.memory, self.slot, self._prefix = memory, slot, prefix.encode()
        self.next_kind = "reset"
        """The kind of the process that is forked next, by which it is named."""
        self.locks: list[str] = []
        """The names of the locks, in the order in which they are made."""
        self.starts: Callable[[Sequence[int], Mapping[str, str]], int] = lambda files, environ: 0
        """Function that is, in a new process, the program that is started; its exit status."""
        self._lock_numbers: dict[int, int] = {}
        self._processes: dict[int, Slot] = {}
        """Descriptors of processes."""
        self._timers: dict[int, tuple[int, int]] = {}
        """Descriptors of timers: the next expiry and the interval, ns."""

    def install(self) -> None:
        """Put the gate in front of all calls."""
        for name in GATED:
            setattr(calls, name, getattr(self, name))
        calls.now_ns = calls.boottime_ns = self.now_ns
        calls.processor_ns = lambda: 0

    # Standing -----------------------------------------------------------------------------------------------

    def begin(self) -> None:
        """The first gate of a process that was forked."""
        self.slot.cells[Cell.PID] = os.getpid()
        self._ask("begin", Effect.NONE, 0, 0)
        self.memory.born.post()
        self._until_let()

    def stand(self, text: str, effect: Effect = Effect.NONE, first: int = 0, second: int = 0) -> None:
        """Stand at the gate before a call, until it may be made."""
        self._ask(text, effect, first, second)
        self.memory.arrived.post()
        self._until_let()

    def _ask(self, text: str, effect: Effect, first: int, second: int) -> None:
        slot, cells = self.slot, self.slot.cells
        slot.text = text
        cells[Cell.GATES] += 1
        cells[Cell.EFFECT], cells[Cell.FIRST], cells[Cell.SECOND] = effect, first, second
        cells[Cell.UNTIL] = cells[Cell.WAKES] = 0

    def _until_let(self, until: Callable[[], int] | None = None) -> None:
        """Wait for the scheduler. A signal that it hands over is raised here, and the request is made again, for a wait
        with the time until which that lasts by then."""
        cells = self.slot.cells
        while True:
            await_turn(self.memory, self.slot)
            number = cells[Cell.SIGNAL]
            if not number:
                return
            cells[Cell.SIGNAL] = 0
            self._raise(number)
            if until is not None:
                cells[Cell.UNTIL] = until()
            self.memory.arrived.post()

    def _raise(self, number: int) -> None:
        asked, cells = self.slot.text, self.slot.cells[Cell.EFFECT : Cell.WAKES + 1].tolist()
        deadly = _has_no_handler(number) and number not in (signal.SIGCHLD, signal.SIGCONT)
        blocked = number in signal.pthread_sigmask(signal.SIG_BLOCK, ())
        if deadly and not blocked:
            self.slot.cells[Cell.EFFECT], self.slot.cells[Cell.FIRST] = Effect.EXIT, DYING
            self.memory.arrived.post()
        signal.raise_signal(number)
        self.slot.text = asked  # a handler may have stood at gates of its own
        for cell, value in enumerate(cells, Cell.EFFECT):
            self.slot.cells[cell] = value

    def _answer(self, number: int) -> None:
        self.slot.cells[Cell.ANSWER] = number

    def _fail_if_told(self) -> None:
        """The scheduler lets this call fail."""
        cells = self.slot.cells
        number, cells[Cell.ERROR] = cells[Cell.ERROR], 0
        if number:
            raise OSError(number, os.strerror(number))

    def _wait(self, text: str, look: Look, until: Callable[[], int], wakes: int) -> Any:
        """Make a call that waits: look once, then at each of these events, until a time in ns; None: it is over."""
        self.stand(text)
        while (answer := look()) is None and until() > self.now_ns():
            self._wait_on(until, wakes)
        return answer

    def _wait_until(self, text: str, until: Callable[[], int]) -> None:
        """Make a call that waits until a time in ns."""
        self._ask(text, Effect.NONE, 0, 0)
        while until() > self.now_ns():
            self._wait_on(until, Wakes.NOTHING)

    def _wait_on(self, until: Callable[[], int], wakes: int) -> None:
        self.slot.cells[Cell.UNTIL], self.slot.cells[Cell.WAKES] = until(), wakes
        self.memory.arrived.post()
        self._until_let(until)

    def _after(self, seconds: float) -> Callable[[], int]:
        until = FOREVER if seconds == inf else self.now_ns() + round(seconds * NS)
        return lambda: until

    # Processes ----------------------------------------------------------------------------------------------

    def fork(self) -> int:
        kind, self.next_kind = self.next_kind, "reset"
        self.stand(f"fork {kind}", Effect.FORK)
        self._fail_if_told()
        slot = self.memory.new_slot(kind)
        pid: int = _real["fork"]()
        if pid:
            self.memory.until_born()
            return pid
        self.slot = slot
        self.begin()
        return 0

    def start_program(self, words: Sequence[str], files: Sequence[int], environ: Mapping[str, str]) -> int:
        self.next_kind = "guardian"
        pid = self.fork()
        if pid == 0:
            self._become_program(files, environ)
        return pid

    def _become_program(self, files: Sequence[int], environ: Mapping[str, str]) -> NoReturn:
        """The program that was started, in a process that was forked."""
        os.environ.update(environ)
        self._be_program(files, lambda: self.starts(files, environ), 1)

    def start_client(self, kind: str, files: Sequence[int], program: Callable[[], int]) -> None:
        """Fork a process that inherits these descriptors, and is this program. Its exit status is `CRASHED` where it
        ends by an exception."""
        self.next_kind = kind
        if self.fork() == 0:
            self._be_program(files, program, CRASHED)

    def _be_program(self, files: Sequence[int], program: Callable[[], int], status: int) -> NoReturn:
        """What starting a program does to a process that was forked, and then the program."""
        _close_all_but(files)
        os.setsid()
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, signal.SIG_DFL)
        try:
            status = program()
        except BaseException:
            sys.excepthook(*sys.exc_info())
        self.exit_now(status)

    def exit_now(self, status: int) -> NoReturn:
        self.stand(f"exit {status}", Effect.EXIT)
        os._exit(status)

    def wait(self, pid: int) -> tuple[int, int]:
        self.stand(f"wait {self._name_of(pid)}")
        found, status = _real["wait"](pid)
        self._answer(status if found else -1)
        return found, status

    def kill(self, pid: int, number: int) -> None:
        slot = self.memory.slot_of(pid)
        if slot is None or not number:
            _real["kill"](pid, number)
        else:
            self._send(slot, number)

    def _send(self, slot: Slot, number: int) -> None:
        self.stand(f"signal {slot.name} {signal.Signals(number).name}", Effect.SIGNAL, slot.number, number)

    def open_process(self, pid: int) -> int:
        file: int = _real["open_process"](pid)
        if (slot := self.memory.slot_of(pid)) is not None:
            self._processes[file] = slot
        return file

    def signal_process(self, file: int, number: int) -> None:
        self._send(self._processes[file], number)

    def die_with_parent(self, parent: int, number: int) -> None:
        slot = self.memory.slot_of(parent)
        assert slot is not None
        self.stand(f"die with {slot.name}", Effect.DIE_WITH, slot.number, number)

    def _name_of(self, pid: int) -> str:
        slot = self.memory.slot_of(pid)
        return "any" if slot is None else slot.name

    # Signals ------------------------------------------------------------------------------------------------

    def set_alarm(self, first: float, interval: float = 0.0) -> None:
        self.stand("set alarm", Effect.ALARM, round(first * NS), round(interval * NS))

    # Descriptors --------------------------------------------------------------------------------------------

    def read(self, file: int, size: int) -> bytes:
        if file in self._timers:
            return self._read_timer(file)
        self._wait("read", partial(_poll, file, calls.INPUT), lambda: FOREVER, _end_of(file) | Wakes.DEATH)
        return os.read(file, size)

    def write(self, file: int, data: bytes) -> int:
        if end := _end_of(file):
            self.stand("write", Effect.CHANGE, end)
        else:
            self._to_disk("write to disk")
        return os.write(file, data)

    def open(self, path: Any, flags: int, mode: int = 0o777) -> int:
        if str(path).endswith("/schedstat"):  # of real processors
            raise OSError(errno.ENOENT, "no times of processors")
        file: int = _real["open"](path, flags, mode)
        return file

    def close(self, file: int) -> None:
        self._timers.pop(file, None)
        self._processes.pop(file, None)
        if end := _end_of(file):
            self.stand("close pipe" if end is Wakes.PIPE else "close socket", Effect.CHANGE, end)
        os.close(file)

    def close_from(self, first: int) -> None:
        self.stand("close all", Effect.CHANGE, Wakes.PIPE | Wakes.SOCKET)
        os.closerange(first, os.sysconf("SC_OPEN_MAX"))

    def ready(self, file: int, within: float, awaited: int = calls.INPUT) -> int:
        slot = self._processes.get(file)
        text = "poll" if slot is None else f"poll {slot.name}"
        wakes = _end_of(file) | Wakes.DEATH
        events: int = self._wait(text, partial(_poll, file, awaited), self._after(within), wakes) or 0
        self._answer(events)
        return events

    # Sockets ------------------------------------------------------------------------------------------------

    def send_message(self, connection: Any, data: bytes, files: Sequence[int] = ()) -> None:
        kind = data[:40].partition(b'"kind": "')[2].partition(b'"')[0].decode(errors="replace")
        self.stand(f"send {kind}", Effect.CHANGE, Wakes.SOCKET)
        _real["send_message"](connection, data, files)

    def receive_message(self, connection: Any, size: int, most: int) -> tuple[bytes, list[int]]:
        look, wakes = partial(_poll, connection.fileno(), calls.INPUT), Wakes.SOCKET | Wakes.DEATH
        self._wait("receive", look, lambda: FOREVER, wakes)
        data, files = _real["receive_message"](connection, size, most)
        self._answer(len(files) if data else -1)
        return data, files

    def take_name(self, name: bytes, kind: int) -> Any:
        return _real["take_name"](self._own_name(name), kind)

    def listener(self, name: bytes) -> Any:
        return _real["listener"](self._own_name(name))

    def _own_name(self, name: bytes) -> bytes:
        """Of this world alone."""
        return (b"\0" + self._prefix + name[1:])[:MAX_NAME_BYTES] if name[:1] == b"\0" else name

    # Clocks, sleep, timer -----------------------------------------------------------------------------------

    def now_ns(self) -> int:
        return self.memory.clock

    def now(self) -> float:
        return self.memory.clock * 1e-9

    def sleep(self, seconds: float) -> None:
        self._wait_until("sleep", self._after(seconds))

    def make_timer(self) -> int:
        file: int = _real["make_timer"]()
        self._timers[file] = FOREVER, 0
        return file

    def set_timer(self, file: int, first: int, interval: int) -> None:
        self._timers[file] = first, interval

    def _read_timer(self, file: int) -> bytes:
        self._wait_until("tick", lambda: self._timers[file][0])
        first, interval = self._timers[file]
        count = 1 + (self.now_ns() - first) // interval
        self._timers[file] = first + count * interval, interval
        return struct.pack("Q", count)

    # Locks --------------------------------------------------------------------------------------------------

    def make_mutex(self, memory: Any, at: int) -> Any:
        mutex = _real["make_mutex"](memory, at)
        self._lock_numbers[id(mutex)] = len(self._lock_numbers)
        return mutex

    def lock_mutex(self, mutex: Any, within: float) -> int:
        number = self._lock_numbers[id(mutex)]
        look, wakes = partial(_try_lock, mutex), Wakes.LOCK << number | Wakes.DEATH
        answer: int | None = self._wait(f"lock {self.locks[number]}", look, self._after(within), wakes)
        answer = errno.ETIMEDOUT if answer is None else answer
        self._answer(answer)
        return answer

    def unlock_mutex(self, mutex: Any) -> None:
        number = self._lock_numbers[id(mutex)]
        self.stand(f"unlock {self.locks[number]}", Effect.CHANGE, Wakes.LOCK << number)
        _real["unlock_mutex"](mutex)

    def mutex_is_held(self, mutex: Any) -> bool:
        self.stand(f"look at {self.locks[self._lock_numbers[id(mutex)]]}")
        is_held: bool = _real["mutex_is_held"](mutex)
        self._answer(is_held)
        return is_held

    def lock_file(self, file: Any, *, shared: bool) -> bool:
        self.stand("lock file")
        taken: bool = _real["lock_file"](file, shared=shared)
        return taken

    # Records ------------------------------------------------------------------------------------------------

    def replace(self, old: Any, new: Any) -> None:
        self._to_disk("replace")
        os.replace(old, new)

    def unlink(self, path: Any) -> None:
        """Also on a full disk."""
        self.stand("unlink")
        _real["unlink"](path)

    def fsync(self, file: int) -> None:
        """The order of processes does not show whether it has reached the disk."""
        self._to_disk("fsync")

    def _to_disk(self, text: str) -> None:
        self.stand(text, Effect.DISK)
        self._fail_if_told()


def stand_before(gate: Gate, owner: type, name: str, texts: Callable[..., Sequence[str]]) -> None:
    """From now on this process stands at its gate before each call of a method: once for each text that `texts` makes
    of the object and the arguments. The answer is noted where it is a truth value."""
    function = getattr(owner, name)

    def gated(self: Any, *words: Any) -> Any:
        for each in texts(self, *words):
            gate.stand(each)
        answer = function(self, *words)
        if isinstance(answer, bool):
            gate._answer(answer)
        return answer

    setattr(owner, name, gated)


GATED = [name for name in vars(Gate) if name in _real or name in ("read", "now", "sleep")]
"""The functions of `calls` that have a gate."""


def _poll(file: int, awaited: int) -> int | None:
    """The events of a descriptor; None: there are none yet."""
    poll = select.poll()
    poll.register(file, awaited)
    return next((events for _, events in poll.poll(0)), None)


def _try_lock(mutex: Any) -> int | None:
    """The answer of a lock; None: another one has it. (`calls.lock_mutex` waits by the clock of the computer.)"""
    answer: int = _libc.pthread_mutex_trylock(ctypes.byref(mutex))
    if answer == errno.EOWNERDEAD:
        _libc.pthread_mutex_consistent(ctypes.byref(mutex))
    return None if answer == errno.EBUSY else answer


def _has_no_handler(number: int) -> bool:
    """Whether a signal has its default action in this process. (Python does not know the handlers of faulthandler.)"""
    action = ctypes.create_string_buffer(SIGACTION_BYTES)
    _libc.sigaction(number, None, action)
    return not any(action.raw[: ctypes.sizeof(ctypes.c_void_p)])


def _end_of(file: int) -> Wakes:
    """What a descriptor that has another end is waited for by; nothing: it has none."""
    try:
        mode = os.fstat(file).st_mode
    except OSError:
        return Wakes.NOTHING
    if stat.S_ISFIFO(mode):
        return Wakes.PIPE
    return Wakes.SOCKET if stat.S_ISSOCK(mode) else Wakes.NOTHING


def _close_all_but(files: Sequence[int]) -> None:
    """As a program that is started has them."""
    kept = {0, 1, 2, *files}
    for name in os.listdir("/proc/self/fd"):
        if (file := int(name)) not in kept:
            try:
                os.close(file)
            except OSError:  # of the folder that is listed
                continue
