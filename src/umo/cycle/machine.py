"""The running parts of a connected machine."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from random import Random
from types import MappingProxyType
from typing import Any, NoReturn, TypeVar

from umo.cycle.acting_laws import ActingLaws
from umo.cycle.capability import Capability
from umo.cycle.claim_table import Claims
from umo.cycle.clock import Clock
from umo.cycle.command_stage import CommandStage
from umo.cycle.directory import Directory
from umo.cycle.equipment import Containment, Equipment
from umo.cycle.events import Event, Events
from umo.cycle.guards import Guards
from umo.cycle.image import Image
from umo.cycle.part_slots import SlotsOfParts
from umo.cycle.period import Period
from umo.cycle.piling_up import PilingUp
from umo.cycle.sampled_writes import SampledWrites
from umo.cycle.sequences import Sequences
from umo.cycle.stage import Progress
from umo.cycle.stopping import StopFlag
from umo.cycle.two_writers import TwoWriters
from umo.cycle.under_way import ActiveWork
from umo.errors import text_of
from umo.objects import Compound, walk
from umo.wiring.wired import AT_ONCE

K = TypeVar("K", bound=Capability)


class ConnectedMachine:
    """The running parts of one machine, from `connect` to its end. The compounds of the machine access it through a
    view (`machine_view.py`)."""

    def __init__(
        self,
        root: Compound,
        image: Image,
        stop: StopFlag,
        outputs: str = AT_ONCE,
        attached: Sequence[Capability] = (),
        states: Mapping[str, Any] = MappingProxyType({}),
    ) -> None:
        self.root = root
        self.image = image
        self.clock: Clock = image.clock
        self.stop = stop
        self.states = states
        """The states of the machine's capabilities at the end of the last run, by the names of the capabilities."""
        self.is_manual = False
        """True in manual mode, in which clients operate the machine instead of the application."""
        self.progress = Progress()
        """The last progress of the machine (`Cycle.progress`)."""
        self.result_so_far: Any = None
        """The result so far (`Cycle.result`): data, or a function that returns them."""
        self.directory = Directory(root)
        """The table of everything that can be looked up by path."""
        self.claims = Claims(root, image)
        """The claims, which decide who drives each actuator."""
        self.commands = CommandStage(self.claims, image)
        guards = Guards(self.claims, image)
        self.equipment = Containment(root, image, self.claims, guards, lambda: self.is_manual, self._equipment_changed)
        self.sequences = Sequences(self.equipment)
        self.at_work = self.sequences
        """The group of sequences that a sequence joins if it is started now: the sequences of the application, or of an
        action."""
        self.piling_up = PilingUp()
        """The detection of sequences of one part that are started faster than they end."""
        self.under_way = ActiveWork(self.equipment, self.sequences)
        """The work that a fault of equipment, or a stop, ends."""
        self.facts: list[Callable[[], Mapping[str, str]]] = []
        """Functions that return facts of the run as text, by their names."""
        self.events: Events = image.events
        """The last 1,000 actions of guards and clients."""
        self.random = Random(0)
        """The random numbers of control code, which a replay repeats."""
        self.parts = SlotsOfParts(image, self.claims.place)
        """The slots of each part."""
        self.acting_laws = ActingLaws(root, image, self.equipment, self.sequences.current)
        self.groups = self.acting_laws.groups
        """The groups of parts that act at one rate."""
        self.phases = Period(image, guards, self.sequences, self.acting_laws, outputs)
        """The calls of each period."""
        self.observers = self.phases.observers
        """Functions that are called after every period with its frame."""
        self.attached: list[Capability] = []
        self.has_begun = False
        """True if `begin` of the capabilities was called."""
        for each in attached:
            self.attach(each)
        self.phases.bind()
        writers = TwoWriters(image, self.sequences.current)
        image.connect(self.claims, self.commands, writers.writes)
        if writers.writes is None:
            sampled = SampledWrites(image, self.commands, self.sequences.current, writers.changed)
            self.phases.commanding.insert(0, sampled.begin_period)
        self.compounds = [root, *(node for node in walk(root) if isinstance(node, Compound))]

    def skip_ticks(self) -> None:
        """Read the timer before the first period: the ticks until now belong to no period and do not count as
        missed."""
        if self.image.timer >= 0:
            self.image.read_now(self.image.timer)
            self.phases.open, self.clock.missed_in_all = False, 0
        self.groups.restart()

    def contain_failures(self, yes: bool) -> None:
        """Set whether equipment contains failures of its objects. It does so between connecting and disconnecting."""
        if yes and self.equipment.all:
            self.image.fail = self.equipment.failed
        else:
            vars(self.image).pop("fail", None)

    def attach(self, capability: K) -> K:
        """Attach a capability. After the phases are bound, the capability may add only to `commanding`, `before_laws`
        and `showing`. If the machine has begun, `begin` of the capability is called, too."""
        capability.attach(self)
        self.attached.append(capability)
        if self.has_begun:
            capability.begin()
        return capability

    def find(self, kind: type[K]) -> K | None:
        """Return the capability of a class, or None."""
        return next((each for each in self.attached if isinstance(each, kind)), None)

    def end(self, *, parts: bool = True) -> None:
        """End the periods. From now on every call reaches its driver again and waits, even if a driver was away. An
        error of a capability is reported and does not prevent a reset. `parts`: whether to call also the capabilities
        that are parts of the machine, which are the user's code."""
        self.image.end()
        for each in self.attached:
            if parts or not isinstance(each, Compound):
                try:
                    each.end()
                except BaseException as error:
                    text = f"{type(each).__name__}.end failed: {text_of(error)}"
                    self.events.add(Event(self.clock.now, "", text), logged=True)

    def refuse(self, instead: Callable[..., NoReturn]) -> None:
        """Replace every call of a driver by `instead`, which does not return."""
        self.image.refuse(instead)
        for each in self.attached:
            each.refuse(instead)

    def disconnect(self) -> None:
        for compound in self.compounds:
            compound._disconnect()
        self.image.disconnect()

    def _equipment_changed(self, changed: Sequence[Equipment]) -> None:
        """Called when equipment enters a fault or is cleared."""
        self.acting_laws.stale = True
        faults = [(each, each.error_of_this_fault()) for each in changed if each.in_fault]
        for equipment in changed if faults else ():
            self.acting_laws.let_idle(equipment)
        self.under_way.note([equipment for equipment, _ in faults])
        for equipment, fault in faults:  # the cleaning up of one may clear the others: their reasons were taken before
            for event in self.under_way.end(equipment, fault, self.clock.now):
                self.events.add(event)
