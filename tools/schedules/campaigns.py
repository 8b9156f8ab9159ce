"""Which schedules are played: orders without a fault, each single fault, pairs of one moment, and some at random."""

from __future__ import annotations

import json
import os
import random
import subprocess
import sys
from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import count as numbers_from
from itertools import islice, zip_longest
from pathlib import Path
from selectors import EVENT_READ, DefaultSelector
from typing import IO, Any

from tools.schedules.cases import cases
from tools.schedules.faults import MS, Fault, Moment, Schedule, What, parsed
from tools.schedules.scheduler import CLIENTS, COMMANDERS
from tools.schedules.shared import DEVICES

ROOT = Path(__file__).parents[2]
HOLDS = (60 * MS, 150 * MS, 700 * MS)
"""ns for which a process is held up: less than every limit, more than `hang_timeout`, more than that of a guardian."""
FULL = (20 * MS, 5000 * MS)
"""ns for which a disk is full: until the record of the start, or to the end."""
SILENT = (15 * MS, 100 * MS, 600 * MS, 3500 * MS, 30_000 * MS)
"""ns for which a device does not answer: less than its timeout, more; less than `reset_for` and the last attempt, more;
to the end."""
FORKING = ("guardian", "standby", "reserve")
REPEATED = 10
"""Each tenth schedule is played twice, with the same trace."""


@dataclass
class Played:
    """What came of a schedule."""

    schedule: Schedule
    wrong: list[str]
    steps: int
    hash: str
    ms: float
    """Virtual time."""
    cpu: float
    """s."""
    gates: dict[str, int]
    """The number of gates of each process."""
    outcome: str | None
    driven: dict[str, list[str]]
    """The devices that were not at their defaults at the end ("told"), and when the run had to be "asked" to stop."""
    due: str
    """The rows of the table of ends that apply."""
    took: float
    """Virtual time in ms until all outputs were at their defaults, as the rows count it."""
    limit: float
    """ms."""
    trace: list[str] = field(default_factory=list)
    printed: str = ""

    @classmethod
    def of(cls, data: Mapping[str, Any]) -> Played:
        names = ("wrong", "steps", "hash", "ms", "cpu", "gates", "outcome", "driven", "due", "took", "limit")
        found = cls(parsed(data["schedule"]), *(data[name] for name in names))
        found.trace, found.printed = data.get("trace", []), data.get("printed", "")
        return found


class Player:
    """A process that plays schedules (`tools.schedules.player`), on one core: its processes go on one at a time, and
    waking another one on the same core takes a third of the time."""

    _number = numbers_from(os.getpid())

    def __init__(self) -> None:
        one_thread = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
        path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH", "")]))
        environ = os.environ | one_thread | {"PYTHONHASHSEED": "0", "PYTHONPATH": path}
        words = [sys.executable, "-m", "tools.schedules.player"]
        self._process = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environ, cwd=ROOT)
        cores = sorted(os.sched_getaffinity(0))
        os.sched_setaffinity(self._process.pid, {cores[next(self._number) % len(cores)]})

    @property
    def answers(self) -> IO[bytes]:
        assert self._process.stdout is not None
        return self._process.stdout

    def ask(self, schedule: Schedule, *, trace: bool = False) -> None:
        assert self._process.stdin is not None
        request = {"schedule": str(schedule), "trace": trace}
        self._process.stdin.write(json.dumps(request).encode() + b"\n")
        self._process.stdin.flush()

    def answer(self) -> Played:
        """RuntimeError where the player has ended."""
        line = self.answers.readline()
        if not line:
            raise RuntimeError(f"a player of schedules has ended with status {self._process.wait()}")
        return Played.of(json.loads(line))

    def play(self, schedule: Schedule, *, trace: bool = False) -> Played:
        self.ask(schedule, trace=trace)
        return self.answer()

    def close(self) -> None:
        """Its worlds end with it. An answer that nobody has taken is read: the player would wait for that."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        self.answers.read()
        self._process.wait()
        self.answers.close()

    def __enter__(self) -> Player:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def played(schedules: Iterable[Schedule], players: Sequence[Player]) -> Iterator[Played]:
    """Each schedule with what came of it, as they come. Each tenth is played twice: another trace is wrong."""
    waiting = deque(players)
    coming = enumerate(schedules)
    under_way: dict[Player, tuple[int, Schedule, Played | None]] = {}
    again: deque[tuple[int, Schedule, Played | None]] = deque()
    with DefaultSelector() as selector:
        for player in players:
            selector.register(player.answers, EVENT_READ, player)
        while True:
            while waiting:
                next_one = again.popleft() if again else next(((*each, None) for each in coming), None)
                if next_one is None:
                    break
                under_way[player := waiting.popleft()] = next_one
                player.ask(next_one[1], trace=next_one[0] % REPEATED == 0)
            if not under_way:
                return
            for key, _ in selector.select():
                player = key.data
                number, schedule, before = under_way.pop(player)
                waiting.append(player)
                found = player.answer()
                if before is None and number % REPEATED == 0:
                    again.append((number, schedule, found))
                    continue
                if before is not None and before.hash != found.hash:
                    found.wrong.append(f"another trace than before: {_difference(before.trace, found.trace)}")
                yield found


def _difference(one: Sequence[str], other: Sequence[str]) -> str:
    """The first lines of two traces that are not the same."""
    both = zip_longest(one, other, fillvalue="the end")
    return next((f"{first!r}, {second!r}" for first, second in both if first != second), "none")


# Campaigns ------------------------------------------------------------------------------------------------


def orders(seeds: Iterable[int]) -> Iterator[Schedule]:
    """No fault: the processes in these orders."""
    return (Schedule(seed) for seed in seeds)


def gates_of(player: Player, seed: int, **kind: bool) -> dict[str, int]:
    """The number of gates of each process in a run without a fault, in a world of this kind."""
    return player.play(Schedule(seed, **kind)).gates


def in_worlds(schedules: Iterable[Schedule], **kind: bool) -> Iterator[Schedule]:
    """The same in worlds of this kind."""
    return (replace(schedule, **kind) for schedule in schedules)


def every_gate(gates: Mapping[str, int]) -> Iterator[Moment]:
    return (Moment(who, gate) for who, count in gates.items() for gate in range(1, count + 1))


def singles(kinds: Iterable[What], seed: int, gates: Mapping[str, int]) -> Iterator[Schedule]:
    """Each fault of these kinds at each gate of each process."""
    for what in kinds:
        for moment in every_gate(gates):
            for fault in _lasting(what, moment.who, moment):
                yield Schedule(seed, (fault,))


def asks(seed: int, gates: Mapping[str, int]) -> Iterator[Schedule]:
    """The machine is asked to stop at each gate of each process."""
    for moment in every_gate(gates):
        yield Schedule(seed, (Fault(What.ASK, "", moment),))


def pairs(
    kinds: tuple[What, What], seed: int, gates: Mapping[str, int], every: int = 1, held: int = 0
) -> Iterator[Schedule]:
    """A fault of the first kind to a process, of the second to another, at one moment: a gate of either, of its gates
    each `every`-th. `held`: for so many ns the first is held up there, and both faults come at the end of that."""
    for moment in every_gate(gates):
        if moment.gate % every:
            continue
        later = Moment(moment.who, moment.gate, held)
        hold = [Fault(What.HOLD, moment.who, moment, held + MS)] if held else []
        for other in gates:
            if other == moment.who:
                continue
            for first, second in dict.fromkeys((kinds, kinds[::-1])):
                for one in _lasting(first, moment.who, later):
                    for two in _lasting(second, other, later):
                        yield Schedule(seed, (*hold, one, two))


def _lasting(what: What, who: str, moment: Moment) -> Iterator[Fault]:
    """A fault, where it lasts once for each time."""
    for lasting in HOLDS if what is What.HOLD else (0,):
        yield Fault(what, who, moment, lasting)


def beside_clients(seed: int, gates: Mapping[str, int], every: int = 1) -> Iterator[Schedule]:
    """At each `every`-th gate of each client: every fault of one process, of the client and of those of the run; and
    a client, or the starter, is asked to stop the machine."""
    for moment in every_gate({who: gates[who] for who in CLIENTS}):
        if moment.gate % every:
            continue
        for what in (What.KILL, What.STOP, What.HOLD):
            for who in (moment.who, "control", "guardian", "worker", "starter"):
                for fault in _lasting(what, who, moment):
                    yield Schedule(seed, (fault,), clients=True)
        for who in ("", *COMMANDERS):
            yield Schedule(seed, (Fault(What.ASK, who, moment),), clients=True)


def no_forks(seed: int, gates: Mapping[str, int]) -> Iterator[Schedule]:
    """A fork fails: the next one of a process from each of its gates on; alone, and where control is killed there."""
    for moment in every_gate(gates):
        if moment.who in FORKING:
            fault = Fault(What.NO_FORK, moment.who, moment)
            yield Schedule(seed, (fault,))
            yield Schedule(seed, (fault, Fault(What.KILL, "control", moment)))


def no_disks(seed: int, gates: Mapping[str, int]) -> Iterator[Schedule]:
    """The disk is full for a time, from each gate of the guardian on; alone, and where control is killed there."""
    for moment in every_gate(gates):
        if moment.who == "guardian":
            for lasting in FULL:
                fault = Fault(What.NO_DISK, "", moment, lasting)
                yield Schedule(seed, (fault,))
                yield Schedule(seed, (fault, Fault(What.KILL, "control", moment)))


def silences(seed: int, gates: Mapping[str, int], every: int = 1) -> Iterator[Schedule]:
    """A device does not answer for a time, from each `every`-th gate of control on; alone, and where control or its
    guardian is killed there."""
    for moment in every_gate(gates):
        if moment.who != "control" or moment.gate % every:
            continue
        for device in DEVICES:
            for lasting in SILENT:
                fault = Fault(What.SILENT, device, moment, lasting)
                yield Schedule(seed, (fault,))
                for who in ("control", "guardian"):
                    yield Schedule(seed, (fault, Fault(What.KILL, who, moment)))


def at_random(seeds: Iterable[int], gates: Mapping[str, int], count: int = 3) -> Iterator[Schedule]:
    """Some faults at random gates, in random orders of the processes."""
    kinds = [What.KILL] * 4 + [What.STOP] * 2 + [What.HOLD] * 2 + [What.ASK]
    for seed in seeds:
        chance = random.Random(f"faults {seed}")
        faults = []
        moment = _some_moment(chance, gates)
        for _ in range(count):
            if chance.random() < 0.5:
                moment = _some_moment(chance, gates)
            what, who = chance.choice(kinds), chance.choice([*gates])
            lasting = chance.choice(HOLDS) if what is What.HOLD else 0
            if what is What.ASK:
                who = chance.choice(["", *COMMANDERS]) if COMMANDERS[0] in gates else ""
            faults.append(Fault(what, who, moment, lasting))
        yield Schedule(seed, tuple(faults))


HUNTED_EVERY = 3
"""The gates of a hunt: each third."""


def hunt(gates: Mapping[str, int], with_clients: Mapping[str, int]) -> Iterator[Schedule]:
    """What finds a fault of umo soonest: the named cases, then some of all kinds in turns. The numbers of gates are
    those of a simple world, and of one with clients."""
    yield from cases()
    some = {who: count for who, count in gates.items() if who != "starter"}
    kinds: list[Iterable[Schedule]] = [
        orders(range(1, 1000)),
        singles([What.KILL], 0, some),
        in_worlds(singles([What.STOP], 0, some), long=True),
        asks(0, gates),
        singles([What.HOLD], 0, some),
        no_forks(0, gates),
        in_worlds(
            pairs(
                (What.KILL, What.KILL), 0, {"guardian": gates["guardian"], "control": gates["control"]}, held=60 * MS
            ),
            long=True,
        ),
        in_worlds(silences(0, gates), long=True),
        at_random(range(1, 10_000), gates),
        in_worlds(at_random(range(1, 10_000), with_clients), clients=True),
    ]
    for several in zip_longest(*(islice(each, 1, None, HUNTED_EVERY) for each in kinds)):
        yield from filter(None, several)


def _some_moment(chance: random.Random, gates: Mapping[str, int]) -> Moment:
    who = chance.choice([*gates])
    return Moment(who, chance.randint(1, gates[who]), chance.choice([0, 0, chance.randrange(1, 80) * MS]))


# A failure, reduced ---------------------------------------------------------------------------------------


def shrunk(found: Played, player: Player) -> Played:
    """The same failure with fewer faults; in turns and without frames where that fails, too."""
    for simpler in ({"seed": 0}, {"frames": False}, {"long": False}, {"clients": False}):
        smaller = player.play(replace(found.schedule, **simpler))
        if smaller.wrong:
            found = smaller
    number = 0
    while number < len(found.schedule.faults):
        fewer = [fault for place, fault in enumerate(found.schedule.faults) if place != number]
        smaller = player.play(found.schedule.with_faults(fewer))
        if smaller.wrong:
            found = smaller
        else:
            number += 1
    return found
