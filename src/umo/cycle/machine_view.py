"""The machine, seen from its compounds (`umo.objects.link.Machine`): what `m.cycle` and the calls of a part ask for.

In a machine with parts of another rate the compounds of each rate share a view, which has the clock of their rate. In
any other machine there is one view; its clock is a plain attribute, as each `m.now` asks for it.
"""

from __future__ import annotations

from collections.abc import Coroutine, Sequence
from functools import partial
from inspect import iscoroutine
from random import Random
from typing import Any, cast

from umo.cycle.clock import Clock
from umo.cycle.events import Event
from umo.cycle.machine import ConnectedMachine
from umo.cycle.piling_up import FEW
from umo.cycle.sequences import Task
from umo.cycle.stage import Stage
from umo.errors import EquipmentFault
from umo.objects import Compound, Node, walk
from umo.presentation.run_facts import facts_of
from umo.user_code import check_acts_at_once


class MachineView:
    """What compounds ask of their machine."""

    clock: Clock

    def __init__(self, machine: ConnectedMachine) -> None:
        self.whole = machine
        self.clock, self.period = machine.clock, machine.clock.period

    @property
    def running(self) -> bool:
        return not self.whole.stop.requested

    @property
    def is_manual(self) -> bool:
        return self.whole.is_manual

    @property
    def random(self) -> Random:
        return self.whole.random

    @property
    def laws(self) -> Sequence[tuple[Compound, str, Any]]:
        return self.whole.directory.laws

    @property
    def current_task(self) -> Task | None:
        task: Task | None = self.whole.sequences.current.task
        return None if task is None else task.started

    # A part --------------------------------------------------------------------------------------------

    def sample(self, part: Node) -> bool:
        return self.whole.image.sample_some(self.whole.parts.of(part).inputs)

    def update(self, part: Node) -> bool:
        return self.whole.image.update_some(self.whole.parts.of(part).outputs)

    def reset(self, part: Node) -> None:
        slots = self.whole.parts.of(part).all
        for slot in slots:
            self.whole.claims.end_client(slot)
        self.whole.image.reset_some(slots)

    def acknowledge(self, part: Node) -> bool:
        return self.whole.claims.acknowledge(self.whole.parts.of(part).actuators)

    def fault_of(self, part: Node) -> EquipmentFault | None:
        return self.whole.equipment.fault_of(part)

    def fail(self, part: Node, error: BaseException) -> bool:
        return self.whole.equipment.contain(part, error)

    def clear(self, part: Node) -> list[str]:
        return self.whole.equipment.clear(part)

    def start(self, sequence: Coroutine[Any, Any, Any], part: Node) -> Task:
        machine = self.whole
        if machine.equipment.is_in_fault(part):
            Task(sequence).cancel()  # it never begins
            raise cast(EquipmentFault, self.fault_of(part))  # no local name: the frame of an error must not refer to it
        sequences = machine.at_work
        task = sequences.start(sequence, part)
        group = machine.groups.of(part)
        if sequences is machine.sequences and group is not machine.groups.whole:
            task.clock = group.clock  # it takes its steps in the periods of its part
        task.started_in = machine.clock.number
        beside = sequences.of(part)
        if len(beside) >= FEW and (text := machine.piling_up.look(task, beside)):
            machine.events.add(Event(machine.clock.now, part._path, text), logged=True)
        return task

    # What is told --------------------------------------------------------------------------------------

    def tell(self, path: str, text: str) -> None:
        self.whole.events.add(Event(self.whole.clock.now, path, text))

    def progress(self, text: str, done: int | None, total: int | None) -> None:
        machine = self.whole
        machine.progress = machine.progress.then(text, done, total)
        machine.at_work.progress = machine.progress.text

    def result(self, so_far: Any) -> None:
        if iscoroutine(so_far):
            so_far.close()
            raise TypeError(f"`{so_far.__name__}` is a sequence, no result: write `await` before its call")
        check_acts_at_once("the function of a result", so_far)
        self.whole.result_so_far = so_far

    def facts(self) -> dict[str, str]:
        """The state of the machine in words."""
        machine = self.whole
        stage = Stage.RUNNING if self.running else Stage.STOPPING
        now, missed = machine.clock.now, machine.clock.missed_in_all
        faults = {each.path: each.reason() for each in machine.equipment.all if each.in_fault}
        found = facts_of(stage, progress=machine.progress, time=now, missed=missed, faults=faults)
        for facts in machine.facts:
            found |= facts()
        return found


class GroupView(MachineView):
    """The machine, seen from compounds of one rate. `period` in s: of their laws, which may act on a controller.
    Default: the clock's."""

    def __init__(self, machine: ConnectedMachine, clock: Clock, period: float | None = None) -> None:
        self.whole, self._clock = machine, clock
        self.period = clock.period if period is None else period

    @property
    def clock(self) -> Clock:  # type: ignore[override]
        """In a sequence, whoever's it is, the clock by which that takes its steps."""
        task = self.current_task
        return self._clock if task is None else task.clock or self.whole.clock


def connect_compounds(machine: ConnectedMachine) -> None:
    """The root has the calls of the period, each part those of its own."""
    groups, period, whole = machine.groups, machine.phases, MachineView(machine)
    views = {group.number: GroupView(machine, group.clock) for group in groups.all if groups.parts}
    root, *parts = machine.compounds
    root._connect(views.get(groups.whole.number, whole), period.sample, period.control, period.update)
    for part in parts:
        calls = partial(whole.sample, part), partial(machine.acting_laws.act_for, part), partial(whole.update, part)
        part._connect(views.get(groups.of(part).number, whole), *calls)
    machine.acting_laws.choose()


def give_period(machine: ConnectedMachine, part: Compound, period: float) -> None:
    """The laws of a part act elsewhere, with this period in s, which its compounds see."""
    for each in (part, *walk(part)):
        if isinstance(each, Compound):
            vars(each)["_machine"] = GroupView(machine, machine.clock, period)
