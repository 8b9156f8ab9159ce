"""Memory that the scheduler and the processes of a world share: their gates, the clock, the devices.

It is anonymous: no descriptor belongs to it, so a process that closes all of its descriptors stays at its gate. Only
one process runs at a time, so nothing in it is written by two.
"""

from __future__ import annotations

import ctypes
import mmap
import os
import signal
import time
from enum import IntEnum, IntFlag
from typing import NamedTuple

_real_time = time.time
SEMAPHORE_BYTES = 32
"""Size of a sem_t (semaphore.h) of glibc on 64 bits, bytes."""
SLOTS = 64
"""Number of processes in one world at most, dead ones too."""
SLOT_CELLS = 16
TEXT_BYTES = 160
DEVICES = ("d1", "d2")
MAX_MOVES = 4096
MOVE_CELLS = 5
MAX_OUTCOME_BYTES = 1 << 17
LOOK_INTERVAL = 10
"""Time in s after which a process that stands at its gate looks whether the scheduler still lives."""
START, LATEST = 1_000_000_000_000, 1 << 62
"""Where the clock begins, and a time that does not come, ns."""


class Head(IntEnum):
    """Cells of the whole world."""

    CLOCK = 0
    """ns."""
    SLOTS = 1
    """Number of processes that there have been."""
    MOVES = 2
    """Number of entries in the list of what the devices were told."""
    OUTCOME = 3
    """Bytes of the outcome that the starter got; 0: none."""
    PLAYER = 4
    """Pid of the scheduler."""
    TOLD = 5
    """Time in ns at which the starter got it."""
    LEVELS = 8
    """The level of the output of each device."""
    SILENT = 16
    """Whether each device does not answer."""


class Cell(IntEnum):
    """Cells of one process."""

    PID = 0
    GATES = 1
    """Number of gates that it has come to."""
    EFFECT = 2
    """What its call does beside itself, an `Effect`; with two numbers."""
    FIRST = 3
    SECOND = 4
    UNTIL = 5
    """Where a call waits: until this time in ns at most; 0: the call does not wait, or not yet."""
    WAKES = 6
    """What ends the wait before, a `Wakes`."""
    ANSWER = 7
    """What the last call has given."""
    SIGNAL = 8
    """From the scheduler: raise this signal and ask again; 0: go on."""
    ERROR = 9
    """From the scheduler: the call fails with this error number; 0: it is made."""


class Effect(IntEnum):
    """What a call does, as far as the scheduler has to know."""

    NONE = 0
    CHANGE = 1
    """Something may become ready for others: what `Wakes` says."""
    SIGNAL = 2
    """A signal is sent: to the process in that slot, this number."""
    DIE_WITH = 3
    """It is to be sent a signal at the death of the process in that slot, this number."""
    ALARM = 4
    """SIGALRM is to come after so many ns, then every so many."""
    FORK = 5
    DISK = 6
    """Something is written to a disk."""
    EXIT = 7
    """The process ends in this call."""


DYING = -1
"""First number of `Effect.EXIT`: a signal ends the process now, at no gate."""


class Wakes(IntFlag):
    """What ends a wait before its time."""

    NOTHING = 0
    PIPE = 1
    """A byte comes, or an end is closed."""
    SOCKET = 2
    """A message comes, or an end is closed."""
    DEATH = 4
    """A process has ended, with its locks and its ends of pipes and sockets; or is stopped, or goes on."""
    LOCK = 8
    """The first lock is given back; the next bits are those of the next locks."""


WAKES_BITS = 48


class Move(IntEnum):
    """What a device is told."""

    OPEN = 0
    CLOSE = 1
    INITIALIZE = 2
    RESET = 3
    FINALIZE = 4
    WRITE = 5


class Moved(NamedTuple):
    """An entry in the list of what the devices were told."""

    slot: int
    device: int
    move: Move
    raw: int
    time: int
    """ns on the clock."""


class _Timespec(ctypes.Structure):
    _fields_ = [("seconds", ctypes.c_long), ("nanoseconds", ctypes.c_long)]


_libc = ctypes.CDLL(None)
_post, _timed_wait, _init = _libc.sem_post, _libc.sem_timedwait, _libc.sem_init
for _function in (_post, _timed_wait, _init):
    _function.restype = ctypes.c_int
_post.argtypes, _timed_wait.argtypes = [ctypes.c_void_p], [ctypes.c_void_p, ctypes.POINTER(_Timespec)]
_init.argtypes = [ctypes.c_void_p, ctypes.c_int, ctypes.c_uint]


class Semaphore:
    """A semaphore at one place of the memory, shared by processes (sem_init(3))."""

    def __init__(self, place: int) -> None:
        self._place = place

    def clear(self) -> None:
        _init(self._place, 1, 0)

    def post(self) -> None:
        _post(self._place)

    def wait(self, seconds: int) -> bool:
        """Whether it was posted within about so many s of real time."""
        until = _Timespec(int(_real_time()) + seconds, 0)
        return bool(_timed_wait(self._place, until) == 0)


class Slot:
    """The place of one process of a world."""

    def __init__(self, memory: Memory, number: int) -> None:
        self.number = number
        first = SLOT_CELLS * number
        self.cells = memory.slot_cells[first : first + SLOT_CELLS]
        self.go = Semaphore(memory.base + memory.semaphores_at + SEMAPHORE_BYTES * (number + 2))
        """Posted when the process may go on."""
        self._memory = memory.map
        self._name_at = memory.texts_at + 2 * TEXT_BYTES * number
        self._text_at = self._name_at + TEXT_BYTES

    @property
    def name(self) -> str:
        return self._get(self._name_at)

    @name.setter
    def name(self, text: str) -> None:
        self._put(self._name_at, text)

    @property
    def text(self) -> str:
        """The call before which it stands, in words."""
        return self._get(self._text_at)

    @text.setter
    def text(self, text: str) -> None:
        self._put(self._text_at, text)

    def _get(self, at: int) -> str:
        return self._memory[at : at + TEXT_BYTES].rstrip(b"\0").decode(errors="replace")

    def _put(self, at: int, text: str) -> None:
        self._memory[at : at + TEXT_BYTES] = text.encode()[:TEXT_BYTES].ljust(TEXT_BYTES, b"\0")


class Memory:
    """The memory of one world after the other."""

    def __init__(self) -> None:
        head_bytes, slot_bytes = 8 * 64, 8 * SLOT_CELLS * SLOTS
        moves_bytes = 8 * MOVE_CELLS * MAX_MOVES
        self.semaphores_at = head_bytes + slot_bytes + moves_bytes
        self.texts_at = self.semaphores_at + SEMAPHORE_BYTES * (SLOTS + 2)
        self._outcome_at = self.texts_at + 2 * TEXT_BYTES * SLOTS
        self.map = mmap.mmap(-1, self._outcome_at + MAX_OUTCOME_BYTES)
        self.base = ctypes.addressof(ctypes.c_char.from_buffer(self.map))
        view = memoryview(self.map)
        self.head = view[:head_bytes].cast("q")
        self.slot_cells = view[head_bytes : head_bytes + slot_bytes].cast("q")
        self._moves = view[head_bytes + slot_bytes : self.semaphores_at].cast("q")
        self.arrived = Semaphore(self.base + self.semaphores_at)
        """Posted by the process that runs, when it stands at its gate again."""
        self.born = Semaphore(self.base + self.semaphores_at + SEMAPHORE_BYTES)
        """Posted by a process that was forked, when it stands at its first gate."""
        self.slots = [Slot(self, number) for number in range(SLOTS)]

    def clear(self) -> None:
        """Before the next world, when no process of the last one lives."""
        self.map[: self.semaphores_at] = bytes(self.semaphores_at)
        self.head[Head.CLOCK], self.head[Head.PLAYER] = START, os.getpid()
        for semaphore in (self.arrived, self.born, *(slot.go for slot in self.slots)):
            semaphore.clear()

    @property
    def clock(self) -> int:
        """ns."""
        return self.head[Head.CLOCK]

    def new_slot(self, kind: str) -> Slot:
        """The place of a process that is to be forked: its name is its kind, with a number from the second on. OSError
        where there are too many."""
        number = self.head[Head.SLOTS]
        if number == SLOTS:
            raise BlockingIOError("a world has too many processes")
        count = 1 + sum(slot.name.rstrip("0123456789") == kind for slot in self.slots[:number])
        slot = self.slots[number]
        slot.name = kind if count == 1 else f"{kind}{count}"
        self.head[Head.SLOTS] = number + 1
        return slot

    def until_born(self) -> None:
        """Wait for the first gate of a process that was forked."""
        while not self.born.wait(LOOK_INTERVAL):
            pass

    def slot_of(self, pid: int) -> Slot | None:
        """The place of the process that has this number; None: it is none of this world."""
        known = self.slots[: self.head[Head.SLOTS]]
        return next((slot for slot in reversed(known) if slot.cells[Cell.PID] == pid), None)

    def note(self, slot: Slot, device: int, move: Move, raw: int = 0) -> None:
        """A device was told something."""
        count = self.head[Head.MOVES]
        if count < MAX_MOVES:
            entry = (slot.number, device, move, raw, self.clock)
            for at, number in enumerate(entry, MOVE_CELLS * count):
                self._moves[at] = number
            self.head[Head.MOVES] = count + 1

    @property
    def moves(self) -> list[Moved]:
        """What the devices were told, in order."""
        cells = self._moves[: MOVE_CELLS * self.head[Head.MOVES]].tolist()
        rows = [cells[at : at + MOVE_CELLS] for at in range(0, len(cells), MOVE_CELLS)]
        return [Moved(slot, device, Move(move), raw, time) for slot, device, move, raw, time in rows]

    @property
    def levels(self) -> dict[str, int]:
        """The level of the output of each device."""
        return {name: self.head[Head.LEVELS + number] for number, name in enumerate(DEVICES)}

    def put_outcome(self, text: bytes) -> None:
        text = text[:MAX_OUTCOME_BYTES]
        self.map[self._outcome_at : self._outcome_at + len(text)] = text
        self.head[Head.OUTCOME], self.head[Head.TOLD] = len(text), self.clock

    @property
    def driven(self) -> list[str]:
        """The devices whose output is not at its default."""
        return [name for name, level in self.levels.items() if level]

    @property
    def outcome(self) -> bytes:
        """What the starter got; empty: nothing."""
        return self.map[self._outcome_at : self._outcome_at + self.head[Head.OUTCOME]]


def await_turn(memory: Memory, slot: Slot) -> None:
    """Wait until the scheduler lets this process go on. It ends where there is no scheduler any more."""
    while not slot.go.wait(LOOK_INTERVAL):
        try:
            os.kill(memory.head[Head.PLAYER], 0)
        except ProcessLookupError:
            os.kill(os.getpid(), signal.SIGKILL)
