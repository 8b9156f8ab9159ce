"""The connected machine: carries out `sample`, `control`, `update` and `reset` of the root and its parts."""

from __future__ import annotations

from collections.abc import Callable, Coroutine, Iterable, Iterator, Mapping, Sequence
from functools import cached_property, partial
from inspect import iscoroutine
from operator import attrgetter
from random import Random
from time import monotonic_ns
from types import MethodType
from typing import TYPE_CHECKING, Any, NamedTuple, NoReturn, Protocol, cast

from umo.cycle.client_commands import Inbox, Lease, Mode
from umo.cycle.client_experiments import Loops
from umo.cycle.clock import Clock, WallClock
from umo.cycle.columns import TAKEN_BY_CLIENT
from umo.cycle.command_stage import CommandStage
from umo.cycle.equipment import CLEANING_UP, Containment, Equipment
from umo.cycle.events import Event, Events
from umo.cycle.frame import Frame, Observer, Signal, show, signals_of, velocities
from umo.cycle.image import Image
from umo.cycle.not_awaited import expects_errors
from umo.cycle.piling_up import FEW, PilingUp
from umo.cycle.restoring import kept_kind
from umo.cycle.sequences import Sequences, Task
from umo.cycle.stage import Stage
from umo.cycle.stopping import StopFlag
from umo.cycle.two_writers import TwoWriters
from umo.drivers.contract import Direction
from umo.drivers.faults.wrapper import Injection
from umo.errors import DriverError, EquipmentFault, forget_frames, text_later
from umo.objects import Action, Atomic, Compound, Node, actions_of, atoms, described, numbers_of, walk
from umo.objects.laws import has_loops, laws_in
from umo.objects.link import Machine
from umo.objects.stop_order import stop_sequence
from umo.presentation.run_facts import driven_text, facts_of
from umo.user_code import Raised, attempt, check_acts_at_once, is_interrupt, read_numbers, refuse_exit, told
from umo.wiring.wired import AT_NEXT_TICK, AT_ONCE

if TYPE_CHECKING:
    from umo.alarms import AlarmEngine

SUPERVISES = ("begin", "supervise", "note_faults", "describe")
"""The methods by which a law is a `Supervisor`."""
INJECTED = "injected_faults"
"""The signal of a run with faults: how many are in effect."""


_IS_IN_FAULT = attrgetter("in_fault")


def _idle(part: Node) -> None:
    """The law of equipment in fault."""


def _has_all(law: object, *names: str) -> bool:
    """Whether its class has all of these methods."""
    return all(callable(getattr(law.__class__, name, None)) for name in names)


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


class Supervisor(Protocol):
    """A law that looks after the sequences of its part, such as a state machine (`umo.operation`)."""

    part: Compound
    """Its part: what `supervise` raises is a failure of this."""

    def begin(self, path: str) -> None:
        """The machine is being connected; the law has this place in it. DeclarationError where it cannot be."""

    def supervise(self) -> None:
        """Called once per period, before the sequences; also in manual mode, and while its part is in fault."""

    def note_faults(self) -> None:
        """Equipment has come into fault, perhaps that around its part. It may be cleared before the next period; what
        was under way in it is ended after this call."""

    def describe(self) -> Mapping[str, Any]:
        """Its path, its states and its commands, as plain data."""


class MotionAxis(Protocol):
    """A compound that is an axis of motion (`umo.control.Axis`)."""

    def shown_state(self) -> int:
        """What it does, for frames: the number of one of its states. It raises nothing."""

    def describe_axis(self) -> Mapping[str, Any]:
        """Its path, states, position, limits and actions, as plain data."""


def axes_in(root: Compound) -> list[MotionAxis]:
    """The axes of a machine, in the order of frames."""
    nodes: list[Any] = [root, *walk(root)]
    return [each for each in nodes if callable(getattr(each.__class__, "describe_axis", None))]


class Book(Protocol):
    """A law from which a client chooses what comes next, such as a book of recipes (`umo.operation.recipe_book`)."""

    def choose(self, name: str, content: str = "") -> str:
        """Choose one by its name."""

    def describe(self) -> Mapping[str, Any]:
        """What can be chosen, as plain data: `fields` (name, unit, bounds) and `recipes` (name, hash, values)."""


class ConnectedMachine:
    """Behind the compounds of one machine from `connect` to its end (`umo.objects.link.Machine`)."""

    alarms: AlarmEngine | None = None
    """Its alarms; None: it has none."""
    parts: Sequence[Any] = ()
    """The parts that have rates of their own (`umo.cycle.rated_machine`)."""

    def __init__(
        self,
        root: Compound,
        image: Image,
        stop: StopFlag,
        injection: Injection | None = None,
        outputs: str = AT_ONCE,
    ) -> None:
        self.root = root
        self.image = image
        self.clock: Clock = image.clock
        self.stop = stop
        self.clients: Commanding | None = None
        """The commands from outside, where there may be any."""
        self.result_so_far: Any = None
        """What the application has told of its result (`Cycle.result`): data, or a function that returns them."""
        self.observers: list[Observer] = []
        """Called after every period with its frame."""
        faults = () if injection is None else (Signal(INJECTED, "", injection, "active"),)
        numbers = numbers_of(root)
        self.frame = Frame(image, (*signals_of(numbers), *velocities(image.items), *faults))
        self.kept = {path: kept_kind(each) for path, each in numbers.items() if each.declared.kept}
        """What is kept over a restart, by path: its type as plain data."""
        self.tunables = {path: each for path, each in numbers.items() if each.declared.tunable}
        """The numbers that may be changed from outside, by path."""
        self.commands = CommandStage(root, image)
        self.equipment = Containment(root, image, self.commands, lambda: self.is_manual, self._equipment_changed)
        self.sequences = Sequences(self.equipment)
        self._piling_up = PilingUp()
        self.supervisors: list[Supervisor] = []
        """The laws that look after the sequences of their parts."""
        self.laws: list[tuple[Compound, str, Any]] = []
        """Its laws with loops when it was connected, each with the compound that has it and its path."""
        for part, path, law in laws_in(root):
            if has_loops(law):
                self.laws.append((part, path, law))
            if _has_all(law, *SUPERVISES):
                law.begin(path)
                self.supervisors.append(law)
        self._moved_in: dict[int, list[Compound]] = {}
        """What moves in each equipment by itself, by the id of the compound: told of its fault."""
        for equipment in self.equipment.all:
            nodes = (node for node in (equipment.compound, *walk(equipment.compound)) if isinstance(node, Compound))
            moving = [each for each in nodes if type(each)._enter_fault is not Compound._enter_fault]
            self._moved_in[id(equipment.compound)] = moving
        self._supervisors_in: dict[int, list[Supervisor]] = {}
        """The supervisors of the parts in each compound, by its id."""
        for each in self.supervisors:
            node: Node | None = each.part
            while node is not None:
                self._supervisors_in.setdefault(id(node), []).append(each)
                node = node._parent
        self.axes = axes_in(root)
        self._axis_states: Any = image.columns.axes.data
        self.events: Events = image.events
        """The last 1,000 actions of guards and clients."""
        self.stop_order = [image.slot_of[id(item)] for item in stop_sequence(root)]
        self.random = Random(0)
        """The random numbers of control code, which a replay repeats."""
        self._slots: dict[int, _PartSlots] = {}
        self._acts: dict[int, list[MethodType]] = {}
        self._elsewhere: set[int] = set()
        """Ids of what runs on controllers."""
        self._laws: list[MethodType] = []
        self._laws_are_stale = False
        """Whether equipment was cleared, or has come into fault, since they were chosen."""
        self._places: dict[int, list[tuple[list[MethodType], int]]] = {}
        """Where the laws of each equipment stand, by its id; made at its first fault since they were chosen."""
        self._after_laws: list[Callable[[], None]] = []
        self.before_laws: Callable[[], object] | None = None
        """Called in each period before the laws of the whole machine; it may replace them."""
        self._started = 0
        self._unsent = False
        """Whether an `update` waits for the next tick."""
        self.period_open = False
        """Whether a period has begun and its frame was not shown yet."""
        self.clock.on_tick = self._tick
        image.before_tick = self.finish_period
        if injection is not None:
            injection.say = self.events.log
        self.turn = self.sequences.current
        """Who takes a step at this moment."""
        image.connect(self.commands, TwoWriters(image, self.turn).writes)
        self._compounds = [root, *(node for node in walk(root) if isinstance(node, Compound))]
        asynchronous = (item for item in image.items if not item.synchronous)
        commanded = self.commands.by_slot or any(item.direction is Direction.OUTPUT for item in asynchronous)
        self.sample_all = self._guarded_sample if commanded else image.sample
        sample = self._way_to_sample()
        if outputs == AT_NEXT_TICK:
            root._connect(self._seen_from(root), partial(self._send_and_sample, sample), self._update_later)
        else:
            root._connect(self._seen_from(root), sample, self._update)
        for compound in self._compounds[1:]:
            compound._connect(self._seen_from(compound), partial(self.sample, compound), partial(self.update, compound))
        self._choose_laws()

    def _seen_from(self, compound: Compound) -> Machine:
        """The machine as its compound sees it."""
        return self

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

    @cached_property
    def actions(self) -> dict[str, Action]:
        """The actions that may be called from outside, by path."""
        return actions_of(self.root)

    def action_at(self, path: str) -> Action | None:
        """An action by its path, also one on a loop. PathError for one on no law."""
        return self.actions.get(path) or self.loops.action(path)

    @cached_property
    def loops(self) -> Loops:
        """The loops of its laws."""
        return Loops(self.root, self.laws)

    @cached_property
    def books(self) -> dict[str, Book]:
        """The laws from which clients choose what comes next, by path."""
        found = ((path, law) for _, path, law in laws_in(self.root))
        return {path: law for path, law in found if _has_all(law, "choose", "next", "describe")}

    @property
    def running(self) -> bool:
        return not self.stop.requested

    def sample(self, part: Node) -> bool:
        return self.image.sample_some(self._slots_of(part).inputs)

    def _way_to_sample(self) -> Callable[[], bool]:
        """The `sample` of the whole machine, without a detour for parts that it does not have."""
        if self.image.timer >= 0:
            return self.sample_all

        look, sample_all = cast(WallClock, self.clock).look, self.sample_all

        def timeless() -> bool:
            self.finish_period()
            look()
            return sample_all()

        return timeless

    def _guarded_sample(self) -> bool:
        """Guards are evaluated even if sensors failed; one DriverError lists the failures of both."""
        try:
            good = self.image.sample()
        except DriverError as unread:
            go_on(unread, self.commands.evaluate, "could not be read or reset")
        self.commands.evaluate()
        return good

    @expects_errors
    def control(self, part: Node) -> None:
        """Sequences first (the root's alone), then each overridden `control`, a parent before its parts."""
        if part is self.root:
            if self.clients is not None:
                self.clients.look()
            if self.supervisors:
                self._supervise()
            self.sequences.advance(self.clock)
            if self.before_laws is not None:
                self.before_laws()
            if self._laws_are_stale:
                self._choose_laws()
            laws = iter(self._laws)
        else:
            laws = iter(self._overrides(part))
        turn = self.turn
        before = turn.law
        try:
            for law in laws:
                turn.law = law
                law()
        except BaseException as error:
            equipment = self._containing(law.__self__, error) if part is self.root else None
            if equipment is None:
                refuse_exit(error, "control")
                raise
            failed = {equipment: text_later(error)}
            forget_frames(error)
            self._act_on(laws, failed)
        finally:
            turn.law = before

    def _supervise(self) -> None:
        """The laws that look after the sequences of their parts."""
        self.equipment.gather()
        try:
            for each in self.supervisors:
                try:
                    each.supervise()
                except BaseException as error:
                    if not self._contain_supervisor(each, error):
                        refuse_exit(error, "supervise")
                        raise
        finally:
            self.equipment.settle()

    def _contain_supervisor(self, law: Supervisor, error: BaseException) -> bool:
        """Its part fails; False if that is the machine itself. While the part is in fault, the law is called all the
        same, and what it raises is not told in every period."""
        if self._containing(law.part, error) is None:
            return False
        if not self.equipment.is_in_fault(law.part):
            self.equipment.contain(law.part, error)
        forget_frames(error)
        return True

    @expects_errors
    def _act_on(self, laws: Iterator[MethodType], failed: dict[Equipment, Callable[[], str]]) -> None:
        """The laws after one that has failed: what equipment contains of their errors keeps no other from acting."""
        turn = self.turn
        while True:
            try:
                for law in laws:
                    turn.law = law
                    law()
                break
            except BaseException as error:
                equipment = self._containing(law.__self__, error)
                if equipment is None:
                    refuse_exit(error, "control")
                    raise
                failed.setdefault(equipment, text_later(error))
                forget_frames(error)
            finally:
                turn.law = None
        self.equipment.enter(failed)

    def _containing(self, part: object, error: BaseException) -> Equipment | None:
        """The equipment whose failure this is; None: that of the machine."""
        return self.equipment.innermost(part) if isinstance(part, Node) and not is_interrupt(error) else None

    # Equipment -----------------------------------------------------------------------------------------

    def fault_of(self, part: Node) -> EquipmentFault | None:
        return self.equipment.fault_of(part)

    def fail(self, part: Node, error: BaseException) -> bool:
        return self.equipment.contain(part, error)

    def clear(self, part: Node) -> list[str]:
        return self.equipment.clear(part)

    def _equipment_changed(self, changed: Sequence[Equipment]) -> None:
        """It is in fault, or was cleared."""
        self._laws_are_stale = True
        faults = [(each, each.error_of_this_fault()) for each in changed if each.in_fault]
        for equipment in changed if faults else ():
            self._let_idle(equipment)
        compounds = (id(equipment.compound) for equipment, _ in faults) if self.supervisors else ()
        supervisors = {id(law): law for each in compounds for law in self._supervisors_in.get(each, ())}
        for law in supervisors.values():
            law.note_faults()
        for equipment, fault in faults:  # the cleaning up of one may clear the others: their reasons were taken before
            self._end_in(equipment, fault)

    def _choose_laws(self) -> None:
        """What is called in each period: the laws but those of equipment in fault; then what waits for them."""
        self._laws_are_stale = False
        self._places = {}
        laws = self._acting_laws()
        self._laws = [*laws, MethodType(type(self)._laws_have_acted, self)] if self._after_laws else laws

    def _let_idle(self, equipment: Equipment) -> None:
        """Its laws are not called any more, also if they are being called one after another at this moment."""
        if not self._places:
            for laws in self._law_lists():
                for number, law in enumerate(laws):
                    for each in self._around_law(law):
                        self._places.setdefault(id(each), []).append((laws, number))
        for laws, number in self._places.get(id(equipment), ()):
            laws[number] = MethodType(_idle, laws[number].__self__)

    def _law_lists(self) -> list[list[MethodType]]:
        """The laws that are called, in the lists in which they stand."""
        return [self._laws]

    def _around_law(self, law: MethodType) -> tuple[Equipment, ...]:
        return self.equipment.around(law.__self__ if isinstance(law.__self__, Node) else None)

    def replace_laws(self, laws: Sequence[MethodType]) -> None:
        """Other functions for the laws of the whole machine, each of the same object, in the same order."""
        self._acts[id(self.root)] = list(laws)
        self._choose_laws()

    def _acting_laws(self) -> list[MethodType]:
        around = self._around_law
        return [law for law in self._overrides(self.root) if not any(map(_IS_IN_FAULT, around(law)))]

    def leave_to_controllers(self, parts: Iterable[Node]) -> None:
        """The laws of these parts are not called here: they run on controllers."""
        self._elsewhere = {id(node) for part in parts for node in (part, *walk(part))}
        self._acts.clear()
        self._choose_laws()

    def after_laws(self, call: Callable[[], None]) -> None:
        """Call it once, after the laws of this period."""
        if call not in self._after_laws:
            self._after_laws.append(call)
            if len(self._after_laws) == 1:
                self._laws = [*self._laws, MethodType(type(self)._laws_have_acted, self)]
                self._places = {}

    def _laws_have_acted(self) -> None:
        calls, self._after_laws = self._after_laws, []
        self._laws = self._laws[:-1]
        self._places = {}
        for call in calls:
            call()

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

    def _update(self) -> bool:
        try:
            accepted = self.image.update()
        except BaseException:
            self.period_open = True  # also where this is not the first time in the period
            raise
        if self.observers or self.alarms is not None or self.events.untold:
            self._finish()
        else:
            self.period_open = False  # as `_finish` does, of which a call is 3 % of the period of a small machine
        return accepted

    def _finish(self) -> None:
        """The outputs of the period are sent: it is over, and what has happened in it is told. A period in which
        sending fails is finished when the machine has been reset, or before the next one."""
        self.period_open = False
        if self.alarms is not None:
            self.alarms.look()
        if self.events.untold:
            self.events.tell()
        if self.observers:
            self._show()

    def _update_later(self) -> bool:
        """The next `sample` sends what this period has computed. If there was none since the last `update`, it is sent
        now."""
        waiting, self._unsent = self._unsent, True
        self.period_open = True
        accepted = not waiting or self.image.update()
        self._finish()
        return accepted

    def _send_and_sample(self, sample: Callable[[], bool]) -> bool:
        """Send what the period before has computed and has not expired since, then read the sensors; one DriverError
        lists the failures of both."""
        if not self._unsent:
            return sample()
        self._unsent = False
        self.commands.expire()
        try:
            self.image.update()
        except DriverError as unsent:
            go_on(unsent, sample, "could not be written or read")
        return sample()

    def reset(self, part: Node) -> None:
        self.image.reset_some(self._slots_of(part).all)

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
        task.started_in = self.clock.number
        beside = sequences.of(part)
        if len(beside) >= FEW and (text := self._piling_up.look(task, beside)):
            self.tell(part._path, text, logged=True)
        return task

    def skip_ticks(self) -> None:
        """Read the timer before the first period: the ticks until here belong to no period, and none is missed."""
        if self.image.timer >= 0:
            self.image.read_now(self.image.timer)
            self.period_open, self.clock.missed_in_all = False, 0

    def finish_period(self) -> None:
        """Before the wait for the next tick: tell and show a period that was not finished, since it failed or nobody
        called `update`."""
        if self.period_open:
            self._finish()

    def _tick(self) -> None:
        self.period_open = True
        self._started = monotonic_ns()

    def _show(self) -> None:
        frame, clock = self.frame, self.clock
        frame.began = self._started
        frame.execution = (monotonic_ns() - self._started) * 1e-9
        frame.number, frame.time, frame.missed = clock.number, clock.now, clock.missed
        frame.signal_values = read_numbers(frame.signals)
        for number, axis in enumerate(self.axes):
            self._axis_states[number] = axis.shown_state()
        show(frame, self.observers)

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

    def _overrides(self, part: Node) -> list[MethodType]:
        """The `control` of every class that has its own, in pre-order; collected once, called flat."""
        if id(part) not in self._acts:
            nodes = [node for node in (part, *walk(part)) if id(node) not in self._elsewhere]
            own = [(type(node).control, node) for node in nodes if type(node).control is not Node.control]
            # not node.control: that of a connected compound drives the whole part
            self._acts[id(part)] = [MethodType(control, node) for control, node in own]
        return self._acts[id(part)]


class _PartSlots(NamedTuple):
    """The slots of a part."""

    inputs: list[int]
    """Slots to sample."""
    outputs: list[int]
    """Slots to update."""
    all: list[int]
    """Slots to reset: the actuators in stop order, then the sensors."""
    actuators: frozenset[int]


def go_on(failed: DriverError, then: Callable[[], object], what: str) -> NoReturn:
    """One step of a period has failed: take the next one all the same, and raise what failed of both."""
    try:
        then()
    except DriverError as error:
        raise DriverError(what, [*failed.failures, *error.failures]) from failed
    raise failed
