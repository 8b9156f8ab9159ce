"""What clients write for the machine: commands, a request to stop, heartbeats."""

from __future__ import annotations

import json
import threading
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

from tools.memory_orders.explore import Model
from tools.memory_orders.threads import Access, Call, Shape, Thread, demand
from umo.cycle.stage import Stage
from umo.errors import CommandRefused
from umo.process.frames import client_memory
from umo.process.frames import command_queue as queue_module
from umo.process.frames.client_memory import STOP, WHO, ClientMemory
from umo.process.frames.command_queue import Receiver, Sender
from umo.process.frames.layout import (
    NAME,
)
from umo.recording.ring_collector import Collector
from umo.system.shared_cells import HEAD as TEXT_HEAD
from umo.system.shared_cells import SharedText

# The queue of commands ------------------------------------------------------------------------------------
# src/umo/process/frames/command_queue.py Sender, Receiver; src/umo/recording/ring_collector.py Collector.copy_commands.
# Clients take turns by a lock. Written: the entry (checksum and size, number, text), then the head. The machine takes
# no lock. It reads the entry, and shows in its frames how many it has taken.


QUEUE_AT, COMMAND_BYTES, COMMAND_SLOTS = client_memory.QUEUE, len(json.dumps({"do": "a1"})), 2
COMMAND_SLOT = queue_module.ENTRY.size + COMMAND_BYTES
QUEUE_SHAPE = Shape(
    QUEUE_AT + COMMAND_SLOTS * COMMAND_SLOT,
    {0: "taken", 8: "", client_memory.HEAD: "head", client_memory.HEAD + 8: "",
     **{QUEUE_AT + slot * COMMAND_SLOT + at: f"command {slot} {name}" for slot in range(COMMAND_SLOTS)
        for at, name in ((0, "checksum"), (8, "number"), (16, "text a"), (24, "text b"))}},
)  # fmt: skip


class _Taken:
    state = Stage.RUNNING

    def __init__(self, memory: Access) -> None:
        self._memory = memory

    @property
    def taken(self) -> int:
        return int.from_bytes(self._memory.load(0, 8), "little")


def _cells(memory: Access) -> Any:
    head = memory.view(client_memory.HEAD, client_memory.HEAD + 8, "Q")
    return SimpleNamespace(head=head, memory=memory.view())


def _send(text: str) -> Call:
    def call(memory: Access, sent: Any) -> Any:
        sender: Any = Sender.__new__(Sender)
        cells = _cells(memory)
        sender._reader, sender._head, sender._memory = _Taken(memory), cells.head, cells.memory
        sender._alone, sender._file = threading.Lock(), memory
        try:
            return (*sent, (sender.send({"do": text}), text))
        except CommandRefused:
            return sent

    return call


def _receive(memory: Access, known: Any) -> Any:
    now = _received(memory, known)
    if now[0] != known[0]:
        memory.store(0, now[0].to_bytes(8, "little"))  # Ring.show
    return now


def _received(memory: Access, known: Any) -> tuple[Any, ...]:
    taken, dropped, doubted, got = known
    receiver = Receiver(_cells(memory))
    receiver.taken, receiver.dropped, receiver._doubted = taken, dropped, doubted
    command = receiver.get()
    demand(not receiver.dropped, f"command {taken + 1} is dropped")
    if command is not None:
        got = (*got, (command.number, command.do))
    return receiver.taken, receiver.dropped, receiver._doubted, got


def commands(
    first: Sequence[str] = ("a1",), second: Sequence[str] = ("b1",), looks: int = 2, kill: bool = False
) -> Model:
    """Two clients, of which the first may be killed, and the machine."""

    def final(memory: Access, results: Sequence[Any]) -> None:
        *clients, known = results
        for _ in range(2 * (len(first) + len(second))):  # a command that is not whole is looked at twice
            known = _received(memory, known)
        got = known[3]
        numbers = [number for number, _ in got]
        demand(numbers == sorted(set(numbers)), f"commands {numbers} are taken")
        texts = [text for _, text in got]
        demand(len(set(texts)) == len(texts) and {*texts} <= {*first, *second}, f"commands {texts} are taken")
        for sent in clients:
            demand({*(sent or ())} <= {*got}, f"of the commands {sent} these were taken: {got}")

    return Model(
        QUEUE_SHAPE,
        [
            Thread("first client", [_send(text) for text in first], (), killable=kill),
            *([Thread("second client", [_send(text) for text in second], ())] if second else []),
            Thread("machine", [_receive] * looks, (0, 0, 0, ())),
        ],
        final,
    )


def recorded_commands() -> Model:
    """A recorder copies the commands beside the machine. With room for one command."""
    sent = ("a1", "a2")

    def collect(memory: Access, known: Any) -> Any:
        collector: Any = Collector.__new__(Collector)
        collector._cells, collector._reader = _cells(memory), _Taken(memory)
        collector._seen, collector._copied = known[0], dict(known[1])
        collector.copy_commands()
        for number, text in collector._copied.items():
            demand(text == json.dumps({"do": sent[number - 1]}).encode(), f"command {number} is copied as {text!r}")
        return collector._seen, tuple(collector._copied.items())

    return Model(
        QUEUE_SHAPE,
        [
            Thread("client", [_send(text) for text in sent], ()),
            Thread("machine", [_receive], (0, 0, 0, ())),
            Thread("recorder", [collect, collect], (0, ())),
        ],
    )


# A request to stop, and heartbeats ---------------------------------------------------------------------
# src/umo/process/frames/client_memory.py ClientMemory. Writers: any number of clients, without a lock.

ASKED = [(15, "ann, the page of a browser".ljust(NAME, ".")), (2, "bob, a program of his own".ljust(NAME, "."))]


def _client_memory(memory: Access) -> Any:
    mine: Any = ClientMemory.__new__(ClientMemory)
    mine.memory, mine.words = memory.view(), memory.view(item="Q")
    mine._who = SharedText(memory.view(), WHO, TEXT_HEAD.size + NAME)
    mine._signs = {"": client_memory.HEAD >> 3}
    return mine


CELLS_SHAPE = Shape(
    128,
    {STOP: "stop", STOP + 8: "", WHO: "who number", WHO + 8: "who size", WHO + 16: "who checksum", WHO + 24: "who a",
     WHO + 56: "who b", client_memory.HEAD: "sign a", client_memory.HEAD + 8: "sign b", client_memory.HEAD + 16: ""},
)  # fmt: skip


def stop(clients: int = 2, readers: int = 1, named: bool = False) -> Model:
    """`named`: who asked is seen together with the request."""

    def ask(number: int) -> Call:
        def call(memory: Access, _: Any) -> Any:
            _client_memory(memory).ask_to_stop(*ASKED[number])
            return True

        return call

    def look(memory: Access, known: Any) -> Any:
        found = _client_memory(memory).stop
        if found is None:
            demand(not known, "a request to stop is no longer there")
            return known
        demand(
            found in (*ASKED, *(() if named else ((number, "") for number, _ in ASKED))), f"the request {found} is torn"
        )
        return True

    def final(memory: Access, results: Sequence[Any]) -> None:
        found = _client_memory(memory).stop
        demand(found is not None or not any(results[:clients]), "a request to stop is lost")

    threads = [Thread(f"client {each}", [ask(each)], killable=not each) for each in range(clients)]
    return Model(
        CELLS_SHAPE, [*threads, *(Thread(f"machine {each}", [look, look], False) for each in range(readers))], final
    )


def signs(readers: int = 1) -> Model:
    """Two leases, each with a client that sends heartbeats; the one before goes on with it until it sees that its
    lease has ended."""
    times = {1: [1_000_000_000, 3_000_000_000], 2: [2_000_000_000, 4_000_000_000]}

    def sign(number: int, now: int) -> Call:
        def call(memory: Access, _: Any) -> Any:
            _client_memory(memory).sign("", number, now)
            return None

        return call

    def look(memory: Access, _: Any) -> Any:
        found = _client_memory(memory).signed("", 2)
        demand(
            found in (0.0, *(time * 1e-9 for time in times[2])), f"a heartbeat at {found} s is that of another lease"
        )
        return None

    threads = [Thread(f"client {lease}", [sign(lease, now) for now in times[lease]], killable=True) for lease in times]
    return Model(CELLS_SHAPE, [*threads, *(Thread(f"machine {each}", [look, look]) for each in range(readers))])
