"""The models, how large they are, and on which machines what must hold holds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

from tools.memory_orders import client_protocols, frame_protocols, worker_protocols
from tools.memory_orders.client_protocols import COMMAND_SLOTS
from tools.memory_orders.explore import Found, Model, explore
from tools.memory_orders.machines import MACHINES, Arm, Machine, Tso
from tools.memory_orders.mutants import Mutant
from tools.memory_orders.sizes import small
from tools.planted_faults import edited


@dataclass(frozen=True)
class Case:
    name: str
    model: Callable[[], Model]
    breaks: Sequence[type[Machine]] = ()
    """The machines on which it does not hold, and `why` that may be so."""
    why: str = ""
    machines: Sequence[type[Machine]] = MACHINES
    quick: bool = False
    """Whether `make test` tries it."""
    command_slots: int = COMMAND_SLOTS
    pauses: bool = True

    @property
    def quick_machines(self) -> Sequence[type[Machine]]:
        """Those on which `make test` tries it. What holds on ARM holds on x86-64, which allows fewer orders."""
        if not self.quick:
            return ()
        return self.machines if self.breaks or Arm not in self.machines else (Arm,)


UNORDERED = "a ring has checksums on such processors"
WAITS = "a period, or a call of a device, lies between the two looks"
KILLED = (
    "in the microsecond in which it is written over, what a killed client has left may be taken for the next command"
)

CASES = [
    Case("texts, 1 look", partial(worker_protocols.texts, looks=1), quick=True),
    Case("texts, 2 looks", worker_protocols.texts),
    Case("texts without waits", worker_protocols.texts, pauses=False),
    Case("texts, 2 readers", partial(worker_protocols.texts, readers=2, looks=1), machines=(Tso,)),
    Case("banks, 1 look", partial(worker_protocols.banks, looks=1), quick=True),
    Case("banks, 2 looks", worker_protocols.banks),
    Case("banks without waits", worker_protocols.banks, pauses=False),
    Case("banks, 2 readers", partial(worker_protocols.banks, readers=2, looks=1, replaced=False), machines=(Tso,)),
    Case("banks, their writer is killed", partial(worker_protocols.banks, looks=0, replaced=False), quick=True),
    Case("requests, 1 look", partial(worker_protocols.requests, looks=1), quick=True),
    Case("requests, 2 looks", worker_protocols.requests),
    Case("the end of transfers", worker_protocols.end_of_transfers, quick=True),
    Case(
        "the end of transfers without waits", worker_protocols.end_of_transfers, (Arm,), WAITS, pauses=False, quick=True
    ),
    Case(
        "frames without checksums, read", partial(frame_protocols.frames, False, "read"), (Arm,), UNORDERED, quick=True
    ),
    Case("frames without checksums, one", partial(frame_protocols.frames, False, "one"), (Arm,), UNORDERED, quick=True),
    Case("frames without checksums, the last", partial(frame_protocols.frames, False, "latest"), (Arm,), UNORDERED),
    Case("frames with checksums, read", partial(frame_protocols.frames, True, "read")),
    Case("frames with checksums, one", partial(frame_protocols.frames, True, "one")),
    Case("frames with checksums, 1 look", partial(frame_protocols.frames, True, "one", looks=1), quick=True),
    Case("frames with checksums, the last", partial(frame_protocols.frames, True, "latest", looks=1), machines=(Tso,)),
    Case(
        "frames, their writer is killed", partial(frame_protocols.frames, True, "one", looks=0, kill=True), quick=True
    ),
    Case("journal without checksums", partial(frame_protocols.journal, False, False), (Arm,), UNORDERED, quick=True),
    Case("journal with checksums", partial(frame_protocols.journal, True, False), quick=True),
    Case(
        "journal in a recording, without checksums",
        partial(frame_protocols.journal, False, True),
        (Arm,),
        UNORDERED,
        quick=True,
    ),
    Case("journal in a recording, with checksums", partial(frame_protocols.journal, True, True), quick=True),
    Case("events without checksums", partial(frame_protocols.events, False, count=2), (Arm,), UNORDERED, quick=True),
    Case("events with checksums", partial(frame_protocols.events, True)),
    Case("events with checksums, 1 look", partial(frame_protocols.events, True, looks=1, count=2), quick=True),
    Case("events, their writer is killed", partial(frame_protocols.events, True, looks=0, kill=True), quick=True),
    Case("the lease", frame_protocols.lease),
    Case("the lease, 1 look", partial(frame_protocols.lease, looks=1), quick=True),
    Case("the lease, its writer is killed", partial(frame_protocols.lease, looks=0, kill=True), quick=True),
    Case("a stop, 1 client", partial(client_protocols.stop, clients=1, named=True), machines=(Tso,), quick=True),
    Case("a stop, 2 clients", client_protocols.stop),
    Case("a stop, 2 clients and 2 readers", partial(client_protocols.stop, readers=2), machines=(Tso,)),
    Case("heartbeats", client_protocols.signs),
    Case("heartbeats, 2 readers", partial(client_protocols.signs, readers=2), machines=(Tso,)),
    Case("commands, 1 client", partial(client_protocols.commands, ("a1", "a2"), ()), quick=True),
    Case(
        "commands of 1 client without waits",
        partial(client_protocols.commands, ("a1", "a2"), ()),
        (Arm,),
        WAITS,
        pauses=False,
        quick=True,
    ),
    Case("commands, 2 clients", client_protocols.commands, quick=True),
    Case("commands, 3 of 2 clients", partial(client_protocols.commands, ("a1", "a2"))),
    Case("commands, a client is killed", partial(client_protocols.commands, kill=True), (Arm,), KILLED),
    Case("recorded commands", client_protocols.recorded_commands, command_slots=1, quick=True),
]


def of_case(case: Case, machine: type[Machine]) -> Found:
    with small(case.command_slots):
        return explore(case.model(), machine, pauses=case.pauses)


def of_mutant(mutant: Mutant, machine: type[Machine]) -> Found:
    with small(mutant.command_slots), edited(mutant.edits):
        return explore(mutant.model(), machine)
