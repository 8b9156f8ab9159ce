"""Who drives an output: the table of claims, by itself and beside the real thing.

The model is `helpers/claims_model.py`. Every state that it can reach keeps its invariants. Beside it, the machine as it
is takes the same steps, at random: with numpy, and with the extension in C.
"""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator, Sequence
from functools import partial
from importlib import import_module
from itertools import product
from random import Random
from typing import Any

import pytest

from helpers.claims_model import (
    BAD,
    DEFAULT,
    FAILED,
    GOOD,
    REFUSED,
    STALE,
    STOPS,
    Answer,
    Kind,
    Lock,
    Output,
    Rank,
    Seen,
)
from helpers.conversions import CHOSEN_FIRST, WAYS, choose
from helpers.letters import Letters
from helpers.machines import actuator, timer
from helpers.tiers import first, some
from tools.planted_faults import Edit, changed, function_with
from umo import Compound, DigitalActuator, DigitalSensor, Interlock, TaskFailed, Vector, connect
from umo.cycle.claim_table import Claims, Command
from umo.cycle.columns import ASKED, FREE, TAKEN_BY_CLIENT
from umo.cycle.command_stage import CommandStage
from umo.cycle.deliveries import AtOnce
from umo.cycle.events import CommandState
from umo.cycle.guards import Guards
from umo.cycle.image import Image
from umo.cycle.inhibition import Inhibition
from umo.cycle.machine_view import MachineView
from umo.cycle.to_defaults import ImageDefaults
from umo.errors import DriverError, Interlocked, UmoError
from umo.objects import Quality
from umo.operation.commands.client_commands import ClientCommand, Mode
from umo.operation.commands.client_control import ClientControl
from umo.operation.resting import Resting
from umo.testing import Scripted, VirtualTimer

Step = tuple[Any, ...]
"""An event and its arguments."""
LOCK, LATCHED, STOPPING = Lock(), Lock(latched=True), Lock(stops=True)
KINDS = [
    Kind(),
    Kind(rate=1, locks=(LOCK,), levels=1),
    Kind(retries=2, locks=(STOPPING,), levels=1),
    Kind(synchronous=False, levels=2),
    Kind(expires=2, rate=2, locks=(LOCK,), levels=1, late=True),
    Kind(synchronous=False, expires=2, locks=(LOCK, Lock(latched=True, stops=True))),
    Kind(rate=2, retries=2, locks=(LATCHED, LATCHED)),
    Kind(expires=3, locks=(LATCHED,), levels=1, every=2),
    Kind(rate=1, retries=4, every=3),
    Kind(synchronous=False, expires=2, retries=2, locks=(LATCHED,), levels=1),
    Kind(expires=2, locks=(LATCHED, STOPPING), levels=2),
]
"""What is compared in each run of the tests."""
EACH = product((True, False), (0, 2), (0, 2), (0,), ((), (LOCK,), (LATCHED,), (STOPPING, LATCHED)), (0, 1, 2))
ALL = [*dict.fromkeys([*KINDS, *(Kind(*each) for each in EACH)])]


# By itself ----------------------------------------------------------------------------------------------


WRITES = ("write", "write_vector", "client_writes", "go_on")
PLAIN = (
    "update", "let_go", "dead_man", "clear", "reset", "acknowledge", "rest", "go_on", "initialized_again"
)  # fmt: skip


def steps_of(
    kind: Kind, values: Sequence[int] = (DEFAULT, 3), ticks: Sequence[int] = (0, 1), conditions: Sequence[int] = (0, 1)
) -> Iterator[Step]:
    """Every event that there is for an actuator of this kind."""
    yield from product(WRITES[:3], values)
    yield from ((name,) for name in PLAIN)
    yield from product(("equipment_fails",), range(kind.levels))
    yield from product(("begin",), ticks, product(conditions, repeat=len(kind.locks)))
    yield from product(("breaks",), (False, True))


def check_invariants(before: Output, step: Step, after: Output) -> None:
    inhibited, sent = after.rank >= Rank.INTERLOCK, after.sure == GOOD
    assert not inhibited or after.pending == DEFAULT, "what is inhibited is at its default"
    assert not (inhibited and after.client), "a client does not outlast an inhibition"
    assert after.rank >= before.rank or after.pending == DEFAULT, "nothing comes back by itself"
    assert before.pending != DEFAULT or after.pending == DEFAULT or step[0] in WRITES, "only a write leaves the default"
    if before.kind.synchronous:
        sent = sent and step[0] == "update" and not (before.kind.late or before.kind.every)
    if sent and (inhibited or not before.kind.rate):
        assert after.at == after.pending, "the device has what is pending"
    elif sent and not (before.owed or before.moved):
        assert abs(after.at - after.pending) <= abs(before.at - after.pending), "a rate leads to it"


@pytest.mark.parametrize("kind", first(6, ALL), ids=str)
def test_every_state_that_the_table_reaches_keeps_the_invariants(kind: Kind) -> None:
    begin, steps = Output(kind), list(steps_of(kind))
    known, waiting = {begin.key}, [begin]
    while waiting:
        before = waiting.pop()
        for step in steps:
            after = before.after(*step)
            check_invariants(before, step, after)
            if after.key not in known:
                known.add(after.key)
                waiting.append(after)


# The real thing -----------------------------------------------------------------------------------------

PERIOD = 2.0**-24
"""s; sums are exact, and no absence of a driver lasts so long that its device is initialised again by itself."""
SURE = {Quality.GOOD: GOOD, Quality.STALE: STALE, Quality.BAD: BAD}
CLIENT: dict[CommandState, Answer] = {
    CommandState.DONE: True,
    CommandState.REFUSED: REFUSED,
    CommandState.FAILED: FAILED,
}
"""Answers to a client's commands."""


class Part(Compound):
    """What stands around the actuator."""

    valves: Sequence[DigitalActuator] = ()
    parts: Sequence[Part] = ()


class Equipped(Part, equipment=True):
    pass


class Machine(Compound):
    timer: DigitalSensor
    beside: DigitalActuator
    around: Part
    locks: tuple[Lock, ...] = ()

    def setup(self) -> None:
        self.conditions = [0] * len(self.locks)

    def interlocks(self) -> Iterator[Interlock]:
        for number, lock in enumerate(self.locks):
            effect: Any = "stop" if lock.stops else "inhibit"
            condition = partial(self.holds, number)
            yield Interlock(condition, [self.around], f"lock {number}", latched=lock.latched, effect=effect)

    def holds(self, number: int) -> bool:
        return [False, True][self.conditions[number]]  # 2: it cannot be evaluated


class Rig:
    """A connected machine with one actuator of a kind, and another one beside it that nothing is to happen to."""

    def __init__(self, kind: Kind) -> None:
        limits: dict[str, Any] = {"expires": kind.expires * PERIOD} if kind.expires else {}
        limits |= {"slew_rate": kind.rate / PERIOD} if kind.rate else {}
        limits |= {"on_error": "retry", "max_age": kind.retries * PERIOD} if kind.retries else {}
        default = float(DEFAULT)
        self.valve = actuator(default=default, resolution=1.0, synchronous=kind.synchronous, **limits)
        made: Any = Equipped if kind.levels else Part
        rated = type("Rated", (made,), {}, every=kind.every) if kind.every else made
        self.levels: list[Part] = [(made if kind.levels > 1 else rated)(valves=[self.valve])]
        while len(self.levels) < kind.levels:
            self.levels.insert(0, rated(parts=self.levels[:1]))
        self.m = Machine(timer=timer(), beside=actuator(), around=self.levels[0], locks=kind.locks)
        self.box, self.ticks, self.life = Scripted(), 1, 1.0
        wire = {
            "timer": {"driver": "clock", "period": PERIOD},
            "beside": {"driver": "other"},
            self.valve.path: {"driver": "box", "channel": "valve"},
        }
        missed: Any = iter(lambda: self.ticks, None)
        drivers = {"clock": VirtualTimer(missed), "box": self.box, "other": Scripted()}
        process = {"outputs": "at next tick"} if kind.late else {}
        self.connection = connect(self.m, {"drivers": drivers, "wire": wire, "process": process})

    def __enter__(self) -> Rig:
        self.connection.__enter__()
        machine: Any = self.connection.machine
        self.machine, self.image = machine, machine.image
        self.image.transfer.now = lambda: 0.0  # on a busy computer a call takes its time: it is no timeout
        self.slot = self.image.slot_of[id(self.valve)]
        self.vector, self.resting = Vector([self.valve]), Resting(self.m.around, [])
        self.letters, self.number = Letters(), 0
        self.clients = ClientControl(self.letters, self.letters, Mode.MANUAL, lambda: self.life)
        machine.attach(self.clients)
        self.ask("lease", seconds=60.0)
        self.m.beside.write(7.0)
        self.m.update()
        self.m.sample()
        self.words = {f"{part._path} is in fault": f"level {number}" for number, part in enumerate(self.levels)}
        self.seen = machine.events.number
        return self

    def __exit__(self, *_: object) -> None:
        """The machine stops."""
        self.box.broken = None
        self.connection.__exit__(None, None, None)

    # The events of the model ----------------------------------------------------------------------------

    def write(self, value: int) -> Answer:
        return self.valve.write(float(value))

    def write_vector(self, value: int) -> Answer:
        return self.vector.write(float(value))

    def client_writes(self, value: int) -> Answer:
        return self.ask("write", self.valve.path, float(value))

    def let_go(self) -> Answer:
        return self.ask("let go", self.valve.path)

    def dead_man(self) -> None:
        self.life += 1.0
        self.look("")

    def equipment_fails(self, level: int) -> None:
        self.machine.equipment.contain(self.levels[level], TaskFailed("it was asked to"))

    def clear(self) -> None:
        self.m.cycle.clear()

    def reset(self) -> None:
        self.m.around.reset()

    def acknowledge(self) -> Answer:
        return self.m.around.acknowledge()

    def rest(self) -> None:
        self.resting.begin()

    def go_on(self) -> None:
        self.resting.end()

    def initialized_again(self) -> Answer:
        return None if self.image.initialize_again(self.slot) is None else FAILED

    def breaks(self, broken: bool) -> None:
        self.box.broken = OSError("cut") if broken else None

    def begin(self, ticks: int, conditions: Sequence[int]) -> None:
        self.m.conditions = list(conditions)
        if ticks:
            self.ticks = ticks
            self.m.timer.read()
        self.m.sample()

    def update(self) -> Answer:
        return self.m.update()

    # Clients --------------------------------------------------------------------------------------------

    def ask(self, do: str, path: str = "", value: Any = None, **more: Any) -> Answer:
        """What a client is answered."""
        self.number += 1
        self.letters.waiting.append(ClientCommand(self.number, "ann", "key", do, path, value, **more))
        self.look("", path)
        told = self.machine.events.recent(3) if self.machine.events.number else ()
        return CLIENT[next(event.state for event in told if event.command == self.number)]

    def look(self, *signed: str) -> None:
        """The clients' turn in a period, with heartbeats for these."""
        self.letters.signs |= dict.fromkeys(signed, (self.clients.lease.number, self.life))
        self.clients.look()

    # Seen from outside ----------------------------------------------------------------------------------

    def apply(self, event: str, *arguments: Any) -> Seen:
        answer: Answer
        try:
            answer = getattr(self, event)(*arguments)
        except Interlocked:
            answer = STOPS
        except DriverError:
            answer = FAILED
        assert self.m.beside.pending == self.m.beside.read() == 7.0, "what is beside it has moved"
        reason = self.reason
        rank = self.rank(reason)
        self.check_restriction(rank, reason)
        sure = SURE[Quality(self.image.quality[self.slot])]
        return Seen(answer, self.valve.pending, rank, reason, self.box.get("valve"), sure, self.told())

    @property
    def reason(self) -> str:
        said = self.words.get(self.valve.inhibited or "", self.valve.inhibited or "")
        said = said.removeprefix("taken by client: ").replace(" (latched: acknowledge it)", " (latched)")
        return re.sub(r"the condition '(.*)' cannot be evaluated: .*", r"\1", said)

    def rank(self, reason: str) -> Rank:
        if reason.startswith("level"):
            return Rank.FAULT
        if reason.startswith("lock"):
            return Rank.INTERLOCK
        return Rank.CLIENT if self.machine.claims.client_of(self.slot) else Rank.PROGRAM

    def check_restriction(self, rank: Rank, reason: str) -> None:
        """The byte that C code, frames and pages read says the same."""
        found = self.image.restrictions[self.slot]
        if rank is Rank.CLIENT:
            assert found == TAKEN_BY_CLIENT
        elif rank is Rank.PROGRAM:
            assert found in (FREE, ASKED)
        else:
            assert FREE < found < ASKED

    def told(self) -> list[str]:
        """What the guards have told since the last step."""
        number = self.machine.events.number
        new, self.seen = self.machine.events.recent(number - self.seen), number
        found = []
        for event in new:
            if event.text.startswith("command expired"):
                found.append("expired")
            elif event.text.startswith("inhibited"):
                found += [f"inhibited {lock}" for lock in re.findall("lock .", event.text)]
            elif event.text.startswith("not restored"):
                found.append("not restored")
        return sorted(found)


# Both side by side --------------------------------------------------------------------------------------


def at_random(kind: Kind, random: Random, count: int) -> list[Step]:
    """So many events: of a third of them a period begins, of another one its outputs are sent."""
    by_name: dict[str, list[Step]] = {}
    for step in steps_of(kind, (DEFAULT, 3, -9), (0, 1, 1, 1, 2, 3), (0, 0, 0, 1, 2)):
        by_name.setdefault(step[0], []).append(step)
    others = [name for name in by_name if name not in ("begin", "update")]
    names = random.choices([*others, "begin", "update"], [1] * len(others) + [len(others)] * 2, k=count)
    return [random.choice(by_name[name]) for name in names]


def difference(kind: Kind, steps: Sequence[Step]) -> str:
    """What the machine does otherwise than the model, and where; "" if nothing."""
    with Rig(kind) as rig:
        model = Output(kind)
        for number, (event, *arguments) in enumerate(steps):
            expected, seen = model.apply(event, *arguments), rig.apply(event, *arguments)
            if seen != expected:
                return f"step {number}, {event}{tuple(arguments)}: {seen}, expected {expected}"
    left = rig.box.get("valve")
    return "" if left == DEFAULT else f"the machine has stopped, and left {left}"


def shrunk(kind: Kind, steps: list[Step]) -> list[Step]:
    """As few of these steps as still make a difference."""
    size = len(steps)
    while size := size // 2:
        for begin in range(len(steps) - size, -1, -size):
            fewer = steps[:begin] + steps[begin + size :]
            if difference(kind, fewer):
                steps = fewer
    return steps


def compare(kind: Kind, seed: int, count: int) -> None:
    steps = at_random(kind, Random(seed), count)
    if difference(kind, steps):
        steps = shrunk(kind, steps)
        pytest.fail(f"{kind}: {difference(kind, steps)}, after {steps}")


@pytest.fixture(autouse=True)
def quiet() -> Iterator[None]:
    """A log of so many faults takes longer than all else."""
    logging.disable(logging.CRITICAL)
    yield
    logging.disable(logging.NOTSET)


@pytest.mark.parametrize("way", first(1, CHOSEN_FIRST))
def test_the_machine_does_what_the_table_says(way: str, monkeypatch: pytest.MonkeyPatch) -> None:
    choose(monkeypatch, way)
    for kind in KINDS:
        compare(kind, 0, 150)


@pytest.mark.full
@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("seed", range(1, 6))
def test_the_machine_does_what_the_table_says_for_long(way: str, seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    choose(monkeypatch, way)
    for kind in ALL:
        compare(kind, seed, 300)


# Planted faults -----------------------------------------------------------------------------------------

FAULTS: dict[str, tuple[Any, str, str]] = {
    "a write in a fault is admitted": (Command.admits, "if fault.held:", "if False:"),
    "an interlock does not latch": (Inhibition.ask, "self.held and latch and self.interlock.latched", "False"),
    "a client survives a fault": (Claims.hold, 'known[slot].client = ""', "pass"),
    "a client survives an interlock": (Claims.interlocked, 'self.by_slot[slot].client = ""', "pass"),
    "the program writes what a client holds": (Command.admits, "if self.client and", "if False and"),
    "an expiry is not armed": (CommandStage.accept, "command.written = self._image.clock.now", "pass"),
    "what a client holds expires": (Command.has_expired, "and not self.client", ""),
    "what is let go stays where it is": (
        Claims.release_from_client, "self._image.settle(slots, ToDefault.SEND)", "pass"
    ),
    "work goes on with what a client holds": (
        CommandStage, "return self._image.go_on(slot, value)", "self._image.pending[slot] = value; return True"
    ),
    "a client survives a reset": (MachineView.reset, "self.whole.claims.end_client(slot)", "pass"),
    "a client survives a device that was away": (Image.was_initialized_again, "self.claims.end_client(slot)", "pass"),
    "what is not restored is not told": (CommandStage.go_on, "image.events.add(", "(lambda event, logged: None)("),
    "resting takes from a client": (Resting.begin, "if not image.claims.client_of(slot)", ""),
    "what holds is acknowledged": (Inhibition.acknowledge, "if not self.held:", "if True:"),
    "an owed default is forgotten": (AtOnce.refused, "owed.add if", "owed.discard if"),
    "a rate counts for an owed default": (ImageDefaults, "self.stepped[slot] = inf", "pass"),
    "a Vector asks nobody": (Image.write_many, "np.count_nonzero(self.columns.restrictions[slots])", "False"),
    "an interlock does not stop the program": (Command.admits, 'each.interlock.effect == "stop"', "False"),
    "a default is refused": (Command.admits, "if value == self.default:", "if False:"),
    "restrictions outlast a fault": (
        Claims.free, "self._restrict([slot for fault in faults for slot in fault.slots])", "pass"
    ),
    "an interlock during a fault is not told": (Guards.free, "each.reason is not None:", "False:"),
    "what was written is lost with a device": (
        ImageDefaults, "self._give_default(slot)\n    self.does",
        "self._give_default(slot); self.set_default(slot)\n    self.does"
    ),
    "each attempt is the first one": (
        AtOnce.is_sent_again, "self._image.unconfirmed.setdefault", "(lambda slot, now: now)"
    ),
    "it latches before the first period": (Guards, "self._image.clock.number > 0", "True"),
    "a late output does not expire": (Guards.expire, "self._expired(", "len("),
}  # fmt: skip
"""What umo's code would do otherwise: a function, or its class, and what stands in it in the place of what."""
OFTEN = ("a write in a fault is admitted", "a client survives a fault", "work goes on with what a client holds")
"""Those that are planted in each run of the tests."""


def plant(patch: pytest.MonkeyPatch, function: Any, right: str, wrong: str) -> None:
    """Put a copy with this change in the place of a method, or of that of a class which has this text."""
    owner = function
    if not isinstance(function, type):
        owner = getattr(import_module(function.__module__), function.__qualname__.split(".")[0])
    name = function_with(owner, right) if function is owner else function.__name__
    patch.setattr(owner, name, changed(Edit(owner, name, (right, wrong))))


@pytest.mark.parametrize("name", some(lambda name: name in OFTEN, FAULTS))
def test_a_planted_fault_is_found(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    choose(monkeypatch, "numpy")
    plant(monkeypatch, *FAULTS[name])
    assert any(is_found(kind, seed) for seed in range(40) for kind in KINDS)


def is_found(kind: Kind, seed: int) -> bool:
    try:
        return bool(difference(kind, at_random(kind, Random(seed), 200)))
    except (AssertionError, UmoError):
        return True
