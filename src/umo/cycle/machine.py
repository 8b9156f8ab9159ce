"""The connected machine: what runs of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from random import Random
from time import monotonic_ns
from typing import TYPE_CHECKING, Any, NoReturn, Protocol

from umo.cycle.acting_laws import ActingLaws
from umo.cycle.capability import Capability
from umo.cycle.client_commands import Inbox, Lease, Mode
from umo.cycle.clock import Clock
from umo.cycle.command_stage import CommandStage
from umo.cycle.directory import Directory
from umo.cycle.equipment import Containment, Equipment
from umo.cycle.events import Events
from umo.cycle.fault_ends import FaultEnds
from umo.cycle.frame import Frame, Signal, show, signals_of, velocities
from umo.cycle.image import Image
from umo.cycle.part_slots import SlotsOfParts
from umo.cycle.period import Period
from umo.cycle.piling_up import PilingUp
from umo.cycle.rate_groups import RateGroups
from umo.cycle.sequences import Sequences
from umo.cycle.stopping import StopFlag
from umo.cycle.two_writers import TwoWriters
from umo.drivers.faults.wrapper import Injection
from umo.objects import Compound, walk
from umo.objects.stop_order import stop_sequence
from umo.user_code import read_numbers
from umo.wiring.rates import Rate
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

    def cancel(self) -> None:
        """The machine stops."""


class ConnectedMachine:
    """What runs of one machine, from `connect` to its end. Its compounds see it by a view (`machine_view.py`)."""

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
        self.piling_up = PilingUp()
        """Sequences of one part that are started faster than they end."""
        self.fault_ends = FaultEnds(self.equipment, self.sequences)
        """What a fault of equipment ends."""
        self._axis_states: Any = image.columns.axes.data
        self.events: Events = image.events
        """The last 1,000 actions of guards and clients."""
        self.stop_order = [image.slot_of[id(item)] for item in stop_sequence(root)]
        self.random = Random(0)
        """The random numbers of control code, which a replay repeats."""
        self.parts = SlotsOfParts(image, self.commands.place)
        """The slots of each part."""
        self.turn = self.sequences.current
        """Who takes a step at this moment."""
        self.groups = RateGroups(image, rates)
        """What acts at one rate."""
        self.acting_laws = ActingLaws(root, self.equipment, self.groups, self.turn)
        self.phases = Period(image, self.commands, self.sequences, self.acting_laws, self.groups, self._show, outputs)
        """What is called in each period."""
        self.observers = self.phases.observers
        """Called after every period with its frame."""
        self.attached = attached
        for each in attached:
            each.attach(self)
        self.phases.bind()
        if injection is not None:
            injection.say = self.events.log
        image.connect(self.commands, TwoWriters(image, self.turn).writes)
        self.compounds = [root, *(node for node in walk(root) if isinstance(node, Compound))]

    def contain_failures(self, yes: bool) -> None:
        """Whether equipment contains failures of its objects: between connecting and disconnecting."""
        if yes and self.equipment.all:
            self.image.fail = self.equipment.failed
        else:
            vars(self.image).pop("fail", None)

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
        for compound in self.compounds:
            compound._disconnect()
        self.image.disconnect()

    def _equipment_changed(self, changed: Sequence[Equipment]) -> None:
        """It is in fault, or was cleared."""
        self.acting_laws.stale = True
        faults = [(each, each.error_of_this_fault()) for each in changed if each.in_fault]
        for equipment in changed if faults else ():
            self.acting_laws.let_idle(equipment)
        self.fault_ends.note([equipment for equipment, _ in faults])
        for equipment, fault in faults:  # the cleaning up of one may clear the others: their reasons were taken before
            for event in self.fault_ends.end(equipment, fault, self.clock.now):
                self.events.add(event)

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
