"""The protocols with one step left out or swapped, in the text of umo's own functions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from tools.memory_orders import client_protocols, frame_protocols, worker_protocols
from tools.memory_orders.client_protocols import COMMAND_SLOTS
from tools.memory_orders.explore import Model
from tools.memory_orders.machines import Arm, Machine, Tso
from tools.planted_faults import Edit
from umo.drivers.off_cycle import shared_memory
from umo.drivers.off_cycle.proxy import OffCycle
from umo.drivers.off_cycle.shared_memory import Banks
from umo.process.frames import command_queue as queue
from umo.process.frames.client_memory import ClientMemory
from umo.process.frames.command_queue import Receiver, Sender
from umo.process.frames.reader import Reader
from umo.process.frames.ring import Ring
from umo.recording import ring_collector
from umo.recording.ring_collector import Collector
from umo.system import shared_cells
from umo.system.shared_cells import SharedText

BOTH: Sequence[type[Machine]] = (Tso, Arm)
WEAK: Sequence[type[Machine]] = (Arm,)
NOWHERE: Sequence[type[Machine]] = ()


@dataclass(frozen=True)
class Mutant:
    what: str
    edits: Sequence[Edit]
    model: Callable[[], Model]
    found: Sequence[type[Machine]]
    """The machines on which it is found; on the others it is equivalent, as far as the model goes."""
    machines: Sequence[type[Machine]] = BOTH
    """Those on which the protocol without the mutant holds."""
    command_slots: int = COMMAND_SLOTS
    quick: bool = True
    """Whether `make test` tries it."""

    @property
    def quick_machines(self) -> Sequence[type[Machine]]:
        """One on which `make test` finds it: ARM if it is found there, whose search ends sooner."""
        return self.found[-1:] if self.quick else ()


def _frames(checksum: bool, how: str) -> Callable[[], Model]:
    return lambda: frame_protocols.frames(checksum, how, looks=1)


def _events(checksum: bool) -> Callable[[], Model]:
    return lambda: frame_protocols.events(checksum, looks=1, count=2)


MUTANTS = [
    # texts
    Mutant(
        "a text: its checksum is not compared",
        [Edit(SharedText, "get", ("if checksum(text, number) == proof else None", ""))],
        worker_protocols.texts,
        BOTH,
    ),
    Mutant(
        "a text: the checksum is not over its number",
        [
            Edit(
                shared_cells,
                "checksum",
                ('zlib.crc32(content, zlib.crc32(struct.pack("<Q", number & MASK)))', "zlib.crc32(content)"),
            )
        ],
        worker_protocols.texts,
        BOTH,
    ),
    Mutant(
        "a text: its number, size and checksum are stored before it",
        [
            Edit(
                SharedText,
                "put",
                ("    self._memory[start : start + len(text)] = text\n", ""),
                (
                    "checksum(text, number))",
                    "checksum(text, number))\n    self._memory[start : start + len(text)] = text",
                ),
            )
        ],
        worker_protocols.texts,
        NOWHERE,
    ),
    # banks
    Mutant(
        "banks: the count before the bank",
        [
            Edit(
                Banks,
                "post",
                (
                    "self._fill(count, rows)\n    self._cells[self._count] = count",
                    "self._cells[self._count] = count\n    self._fill(count, rows)",
                ),
            )
        ],
        lambda: worker_protocols.banks(looks=0, replaced=False),
        BOTH,
    ),
    Mutant(
        "banks: the checksum is not compared",
        [Edit(Banks, "read", ("number == count and proof == crc32(memoryview(bank)[8:])", "number == count"))],
        worker_protocols.banks,
        BOTH,
    ),
    Mutant(
        "banks: the number of the bank is not compared",
        [Edit(Banks, "read", ("number == count and ", ""))],
        worker_protocols.banks,
        BOTH,
    ),
    Mutant(
        "banks: the valid bank is written over",
        [Edit(Banks, "_fill", ("self._banks[count & 1]", "self._banks[~count & 1]"))],
        worker_protocols.banks,
        BOTH,
    ),
    # requests
    Mutant(
        "requests: the number of the text is not compared",
        [Edit(shared_memory, "_of_number", (" and found[0] == number", ""))],
        worker_protocols.requests,
        BOTH,
    ),
    Mutant(
        "requests: the number is counted before the text is written",
        [
            Edit(
                shared_memory.Exchange,
                "ask",
                (
                    "self._request.put(number, json.dumps(request).encode())\n    self.cells[Cell.REQUESTED] = number",
                    "self.cells[Cell.REQUESTED] = number\n    self._request.put(number, json.dumps(request).encode())",
                ),
            )
        ],
        worker_protocols.requests,
        NOWHERE,
    ),
    Mutant(
        "the end: transfers are not taken back",
        [Edit(OffCycle, "end", ("self.exchange.cells[Cell.CYCLIC] = 0", "pass"))],
        worker_protocols.end_of_transfers,
        BOTH,
    ),
    # frames
    Mutant(
        "frames: no checksum",
        [Edit(Reader, "_whole", ('whole &= np.array(sums, np.uint64) == frames["checksum"]', "pass"))],
        _frames(True, "read"),
        WEAK,
    ),
    Mutant(
        "frames: no look at the head after the copy",
        [Edit(Reader, "_whole", ("self.head - self.slots - ended", "-1"))],
        _frames(False, "read"),
        (Tso,),
        (Tso,),
    ),
    Mutant(
        "frames: the frame that may be being written over counts as whole",
        [Edit(Reader, "_whole", ("numbers.astype(np.int64) > oldest", "numbers.astype(np.int64) >= oldest"))],
        _frames(False, "read"),
        (Tso,),
        (Tso,),
    ),
    Mutant(
        "frames: the number is not compared",
        [Edit(Reader, "_whole", (' & (frames["sequence"] == 2 * numbers + 2)', ""))],
        _frames(True, "read"),
        WEAK,
        quick=False,
    ),
    Mutant(
        "frames: no odd number while one is written",
        [Edit(Ring, "__call__", ("words[at >> 3] = 2 * index + 1\n", "pass\n"))],
        _frames(False, "read"),
        NOWHERE,
        (Tso,),
    ),
    Mutant(
        "one frame: the end is looked up after the head",
        [Edit(Reader, "frame_bytes", ("self.slots - ended", "self.slots - self.is_finished"))],
        _frames(False, "one"),
        (Tso,),
        (Tso,),
    ),
    # journal
    Mutant(
        "the journal: its count is moved after the entries are written",
        [
            Edit(
                Ring,
                "_keep",
                ("    self._live[Live.JOURNAL] = self._entries = self._entries + count\n", ""),
                (
                    "    return zlib",
                    "    self._live[Live.JOURNAL] = self._entries = self._entries + count\n    return zlib",
                ),
            )
        ],
        lambda: frame_protocols.journal(False, False),
        (Tso,),
        (Tso,),
    ),
    Mutant(
        "the journal: no checksum",
        [Edit(Reader, "journal", ('zlib.crc32(entries.tobytes()) != frame["entries_checksum"]', "False"))],
        lambda: frame_protocols.journal(True, False),
        WEAK,
    ),
    Mutant(
        "the journal in a recording: no checksum",
        [Edit(Reader, "entries_of", ('zlib.crc32(own.tobytes()) != frame["entries_checksum"]', "False"))],
        lambda: frame_protocols.journal(True, True),
        WEAK,
    ),
    # events
    Mutant(
        "events: the number is not 0 while one is written",
        [Edit(Ring, "_tell", ("self._words[at >> 3] = 0", "pass"))],
        _events(False),
        (Tso,),
        (Tso,),
    ),
    Mutant(
        "events: no second look at the number",
        [Edit(Reader, "events", ('self._events["sequence"][numbers % EVENTS] == numbers + 1', "numbers >= 0"))],
        _events(False),
        (Tso,),
        (Tso,),
    ),
    Mutant("events: no checksum", [Edit(Reader, "events", ("if self._checked:", "if False:"))], _events(True), WEAK),
    # a stop, heartbeats
    Mutant(
        "a stop: asked for before it is said who asks",
        [
            Edit(
                ClientMemory,
                "ask_to_stop",
                (
                    "self._who.put(number, cut(who, NAME))\n        self.words[STOP >> 3] = STOP_MARK | number",
                    "self.words[STOP >> 3] = STOP_MARK | number\n        self._who.put(number, cut(who, NAME))",
                ),
            )
        ],
        lambda: client_protocols.stop(clients=1, named=True),
        (Tso,),
        (Tso,),
    ),
    Mutant(
        "a stop: who asks may have asked with another signal",
        [Edit(ClientMemory, "stop", (" and found[0] == number", ""))],
        client_protocols.stop,
        BOTH,
        quick=False,
    ),
    Mutant(
        "heartbeats: the number of the lease and the time do not depend on one another",
        [
            Edit(ClientMemory, "sign", ("lease ^ now, now", "lease, now")),
            Edit(ClientMemory, "signed", ("self.words[at] ^ now == lease", "self.words[at] == lease")),
        ],
        client_protocols.signs,
        BOTH,
    ),
    # commands
    Mutant(
        "commands: no lock among clients",
        [
            Edit(
                Sender,
                "_turn",
                ("fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)", "pass"),
                ("fcntl.flock(self._file, fcntl.LOCK_UN)", "pass"),
            )
        ],
        client_protocols.commands,
        BOTH,
    ),
    Mutant(
        "commands: the head before the entry",
        [
            Edit(
                Sender,
                "_put",
                (
                    "self._memory[at : at + len(entry)] = entry\n    self._head[0] = number",
                    "self._head[0] = number\n    self._memory[at : at + len(entry)] = entry",
                ),
            )
        ],
        lambda: client_protocols.commands(second=()),
        BOTH,
    ),
    Mutant(
        "commands: no look at the room in the queue",
        [Edit(Sender, "send", ("head - self._reader.taken < SLOTS", "True"))],
        lambda: client_protocols.commands(("a1", "a2"), ()),
        BOTH,
        command_slots=1,
    ),
    Mutant(
        "commands: one that is not whole is dropped at the first look",
        [Edit(Receiver, "get", ("text is None and self._doubted != number", "False"))],
        lambda: client_protocols.commands(second=()),
        WEAK,
    ),
    Mutant(
        "commands: their checksum is not compared",
        [
            Edit(module, "command_in", (" and checksum == _checksum(size, number, text)", ""))
            for module in (queue, ring_collector)
        ],
        client_protocols.recorded_commands,
        BOTH,
        command_slots=1,
    ),
    Mutant(
        "recorded commands: what is not whole counts as copied",
        [
            Edit(
                Collector,
                "copy_commands",
                ("self._copied[number] = text", 'self._copied[number] = text or b""'),
                ("if text is not None:", "if True:"),
            )
        ],
        client_protocols.recorded_commands,
        BOTH,
        command_slots=1,
    ),
]
