"""The connected machine: carries out `sample`, `control`, `update` and `reset` of the root and its parts."""

from __future__ import annotations

from collections.abc import Callable, Coroutine, Sequence
from functools import partial
from inspect import iscoroutine
from random import Random
from time import monotonic_ns
from typing import TYPE_CHECKING, Any, NamedTuple, NoReturn, Protocol, cast

from umo.cycle.acting_laws import ActingLaws
from umo.cycle.capability import Capability
from umo.cycle.client_commands import Inbox, Lease, Mode
from umo.cycle.clock import Clock
from umo.cycle.columns import TAKEN_BY_CLIENT
from umo.cycle.command_stage import CommandStage
from umo.cycle.directory import Directory
from umo.cycle.equipment import CLEANING_UP, Containment, Equipment
from umo.cycle.events import Event, Events
from umo.cycle.frame import Frame, Signal, show, signals_of, velocities
from umo.cycle.image import Image
from umo.cycle.period import Period
from umo.cycle.piling_up import FEW, PilingUp
from umo.cycle.rate_groups import MachineOfGroup, RateGroups
from umo.cycle.sequences import Sequences, Task
from umo.cycle.stage import Stage
from umo.cycle.stopping import StopFlag
from umo.cycle.supervisors import Supervisors
from umo.cycle.two_writers import TwoWriters
from umo.drivers.contract import Direction
from umo.drivers.faults.wrapper import Injection
from umo.errors import EquipmentFault
from umo.objects import Atomic, Compound, Node, atoms, described, walk
from umo.objects.link import Machine
from umo.objects.stop_order import stop_sequence
from umo.presentation.run_facts import driven_text, facts_of
from umo.user_code import Raised, attempt, check_acts_at_once, read_numbers, told
from umo.wiring.rates import WHOLE, Rate
from umo.wiring.wired import AT_ONCE

if TYPE_CHECKING:
    from umo.alarms import AlarmEngine

INJECTED = "injected_faults"
"""The signal of a run with faults: how many are in effect."""


class Commanding(Protocol):
    """The clients that command a machine (`umo.cycle.client_control`), as far as it needs them."""

    mode: Mode
    lease: Lease
    inbox: Inbox

    @property
    def at_work(self) -> Sequences | None:
        """The sequences of the action that is being carried out at this moment: what it starts belongs here."""

    def progress(self, text: str) -> None:
        """What is at work tells its progress."""

    def end_in(self, equipment: Equipment, fault: Callable[[], EquipmentFault]) -> list[BaseException]:
        """End the actions and sequences of one equipment; the errors of their cleaning up."""

    def look(self) -> None:
        """Once per period, before the sequences: take what has come in, go on with what runs."""

    def cancel(self) -> None:
        """The machine stops."""


class ConnectedMachine:
    """Behind the compounds of one machine from `connect` to its end (`umo.objects.link.Machine`)."""

    def __init__(
        self,
        root: Compound,
        image: Image,
        stop: StopFlag,
        injection: Injection | None = None,
        outputs: str = AT_ONCE,
        rates: Sequence[Rate] = (),
        attached: Sequence[Capability] = (),
    ) -> None:
        self.root = root
        self.image = image
        self.clock: Clock = image.clock
        self.stop = stop
        self.alarms: AlarmEngine | None = None
        """Its alarms; None: it has none."""
        self.clients: Commanding | None = None
        """The commands from outside, where there may be any: they have attached themselves to the period."""
        self.result_so_far: Any = None
        """What the application has told of its result (`Cycle.result`): data, or a function that returns them."""
        faults = () if injection is None else (Signal(INJECTED, "", injection, "active"),)
        self.directory = Directory(root)
        """What is looked up by its path."""
        signals = signals_of(self.directory.numbers)
        self.frame = Frame(image, (*signals, *velocities(image.items), *faults))
        self.commands = CommandStage(root, image)
        self.equipment = Containment(root, image, self.commands, lambda: self.is_manual, self._equipment_changed)
        self.sequences = Sequences(self.equipment)
        self._piling_up = PilingUp()
        self._moved_in: dict[int, list[Compound]] = {}
        """What moves in each equipment by itself, by the id of the compound: told of its fault."""
        for equipment in self.equipment.all:
            nodes = (node for node in (equipment.compound, *walk(equipment.compound)) if isinstance(node, Compound))
            moving = [each for each in nodes if type(each)._enter_fault is not Compound._enter_fault]
            self._moved_in[id(equipment.compound)] = moving
        self._axis_states: Any = image.columns.axes.data
        self.events: Events = image.events
        """The last 1,000 actions of guards and clients."""
        self.stop_order = [image.slot_of[id(item)] for item in stop_sequence(root)]
        self.random = Random(0)
        """The random numbers of control code, which a replay repeats."""
        self._slots: dict[int, _PartSlots] = {}
        self.turn = self.sequences.current
        """Who takes a step at this moment."""
        self.groups = RateGroups(image, rates)
        """What acts at one rate."""
        self.acting_laws = ActingLaws(root, self.equipment, self.groups, self.turn)
        self.phases = Period(image, self.commands, self.sequences, self.acting_laws, self.groups, self._show, outputs)
        """What is called in each period."""
        self.observers = self.phases.observers
        """Called after every period with its frame."""
        self.supervisors = Supervisors(self.directory, self.equipment, self.acting_laws)
        if self.supervisors.all:
            self.phases.commanding.append(self.supervisors.act)
        self.attached = attached
        for each in attached:
            each.attach(self)
        self.phases.bind()
        if injection is not None:
            injection.say = self.events.log
        image.connect(self.commands, TwoWriters(image, self.turn).writes)
        self._compounds = [root, *(node for node in walk(root) if isinstance(node, Compound))]
        self._connect_compounds()
        self.acting_laws.choose()

    def _connect_compounds(self) -> None:
        """The root has the calls of the period, each part those of its own."""
        groups, period = self.groups, self.phases
        seen: dict[int, Machine] = {}
        for group in groups.all if groups.parts else ():
            seen[group.number] = cast(Machine, MachineOfGroup(self, group.clock))
        root, *parts = self._compounds
        root._connect(seen.get(WHOLE, self), period.sample, period.control, period.update)
        for part in parts:
            calls = partial(self.sample, part), partial(self.acting_laws.act_for, part), partial(self.update, part)
            part._connect(seen.get(groups.of(part).number, self), *calls)

    @property
    def period(self) -> float:
        return self.clock.period

    def contain_failures(self, yes: bool) -> None:
        """Whether equipment contains failures of its objects: between connecting and disconnecting."""
        if yes and self.equipment.all:
            self.image.fail = self.equipment.failed
        else:
            vars(self.image).pop("fail", None)

    @property
    def current_task(self) -> Task | None:
        task: Task | None = self.turn.task
        return None if task is None else task.started

    @property
    def is_manual(self) -> bool:
        return self.clients is not None and self.clients.mode is Mode.MANUAL

    def end(self) -> None:
        """No period follows: from now on every driver is called again, and each call waits."""
        self.image.end()
        for each in self.attached:
            each.end()

    def refuse(self, instead: Callable[..., NoReturn]) -> None:
        """Let no call reach a driver any longer: in its place `instead` is called, which does not return."""
        self.image.refuse(instead)
        for each in self.attached:
            each.refuse(instead)

    def cancel_sequences(self) -> None:
        """Cancel the sequences of clients and of the application, the last started first; the first error of their
        cleaning up is raised."""
        try:
            if self.clients is not None:
                self.clients.cancel()
        finally:
            self.sequences.cancel()

    def disconnect(self) -> None:
        for compound in self._compounds:
            compound._disconnect()
        self.image.disconnect()

    @property
    def running(self) -> bool:
        return not self.stop.requested

    def sample(self, part: Node) -> bool:
        return self.image.sample_some(self._slots_of(part).inputs)

    # Equipment -----------------------------------------------------------------------------------------

    def fault_of(self, part: Node) -> EquipmentFault | None:
        return self.equipment.fault_of(part)

    def fail(self, part: Node, error: BaseException) -> bool:
        return self.equipment.contain(part, error)

    def clear(self, part: Node) -> list[str]:
        return self.equipment.clear(part)

    @property
    def laws(self) -> Sequence[tuple[Compound, str, Any]]:
        return self.directory.laws

    def _equipment_changed(self, changed: Sequence[Equipment]) -> None:
        """It is in fault, or was cleared."""
        self.acting_laws.stale = True
        faults = [(each, each.error_of_this_fault()) for each in changed if each.in_fault]
        for equipment in changed if faults else ():
            self.acting_laws.let_idle(equipment)
        self.supervisors.note_faults(equipment for equipment, _ in faults)
        for equipment, fault in faults:  # the cleaning up of one may clear the others: their reasons were taken before
            self._end_in(equipment, fault)

    def _end_in(self, equipment: Equipment, fault: Callable[[], EquipmentFault]) -> None:
        """Whatever is under way in equipment that is in fault now."""
        raised: list[Raised] = []
        if moved := self._moved_in.get(id(equipment.compound)):
            raised = [error for node in moved if (error := attempt(node._enter_fault)[1]) is not None]
        errors = self.sequences.end_in(equipment.nodes, fault) if self.sequences.running else []
        if self.clients is not None:
            errors += self.clients.end_in(equipment, fault)
        for each in [*raised, *map(told, errors)] if raised or errors else ():
            self.events.add(Event(self.clock.now, equipment.path, f"{CLEANING_UP}{each.text}"))

    def update(self, part: Node) -> bool:
        return self.image.update_some(self._slots_of(part).outputs)

    def reset(self, part: Node) -> None:
        slots = self._slots_of(part).all
        for slot in slots:
            self.commands.end_client(slot)
        self.image.reset_some(slots)

    def acknowledge(self, part: Node) -> bool:
        return self.commands.acknowledge(self._slots_of(part).actuators)

    def actuators_of(self, part: Node) -> frozenset[int]:
        """The slots of its actuators."""
        return self._slots_of(part).actuators

    def progress(self, text: str, done: int | None, total: int | None) -> None:
        self.frame.progress = self.frame.progress.then(text, done, total)
        if self.clients is not None and self.clients.at_work is not None:
            self.clients.progress(self.frame.progress.text)

    def result(self, so_far: Any) -> None:
        if iscoroutine(so_far):
            so_far.close()
            raise TypeError(f"`{so_far.__name__}` is a sequence, no result: write `await` before its call")
        check_acts_at_once("the function of a result", so_far)
        self.result_so_far = so_far

    def tell(self, path: str, text: str, *, logged: bool = False) -> None:
        self.events.add(Event(self.clock.now, path, text), logged=logged)

    def facts(self) -> dict[str, str]:
        """The state of the machine in words."""
        stage = Stage.RUNNING if self.running else Stage.STOPPING
        mode, holder = (None, "") if self.clients is None else (self.clients.mode, self.clients.lease.holder)
        now, missed = self.clock.now, self.clock.missed_in_all
        faults = {each.path: each.reason() for each in self.equipment.all if each.in_fault}
        driven = self._driven(holder) if mode is Mode.MANUAL else ""
        progress = self.frame.progress
        return facts_of(stage, mode, holder, progress, driven=driven, time=now, missed=missed, faults=faults)

    def _driven(self, holder: str) -> str:
        image, taken = self.image, TAKEN_BY_CLIENT
        slots = (slot for slot, item in enumerate(image.items) if item.direction is Direction.OUTPUT)
        each = ((described(image.items[slot]), image.values[slot], image.restrictions[slot] == taken) for slot in slots)
        return driven_text(each, holder)

    def start(self, sequence: Coroutine[Any, Any, Any], part: Node) -> Task:
        if self.equipment.is_in_fault(part):
            Task(sequence).cancel()  # it never begins
            raise cast(EquipmentFault, self.fault_of(part))  # no local name: the frame of an error must not refer to it
        by_client = None if self.clients is None else self.clients.at_work
        sequences = self.sequences if by_client is None else by_client
        task = sequences.start(sequence, part)
        group = self.groups.of(part)
        if by_client is None and group is not self.groups.whole:
            task.clock = group.clock  # it takes its steps in the periods of its part
        task.started_in = self.clock.number
        beside = sequences.of(part)
        if len(beside) >= FEW and (text := self._piling_up.look(task, beside)):
            self.tell(part._path, text, logged=True)
        return task

    def _show(self) -> None:
        frame, clock = self.frame, self.clock
        began = self.phases.began
        frame.began = began
        frame.execution = (monotonic_ns() - began) * 1e-9
        frame.number, frame.time, frame.missed = clock.number, clock.now, clock.missed
        frame.signal_values = read_numbers(frame.signals)
        for number, axis in enumerate(self.directory.axes):
            self._axis_states[number] = axis.shown_state()
        show(frame, self.phases.observers)

    def _slots_of(self, part: Node) -> _PartSlots:
        if id(part) not in self._slots:
            slot_of = self.image.slot_of
            items = {slot_of[id(item)]: item for item in ([part] if isinstance(part, Atomic) else atoms(part))}
            sensors = [slot for slot, item in items.items() if item.direction is Direction.INPUT]
            place = self.commands.place
            actuators = sorted((slot for slot in items if slot in place), key=place.__getitem__)
            self._slots[id(part)] = _PartSlots(
                [slot for slot in sensors if items[slot].synchronous],
                [slot for slot, item in items.items() if item.synchronous and item.direction is Direction.OUTPUT],
                [*actuators, *sensors],
                frozenset(actuators),
            )
        return self._slots[id(part)]


class _PartSlots(NamedTuple):
    """The slots of a part."""

    inputs: list[int]
    """Slots to sample."""
    outputs: list[int]
    """Slots to update."""
    all: list[int]
    """Slots to reset: the actuators in stop order, then the sensors."""
    actuators: frozenset[int]
