"""The machine as its compounds see it (`umo.objects.link.Machine`), through `m.cycle` and the calls of a part.

All compounds share one view, whose clock is a plain attribute, because each `m.now` reads it. If parts of the machine
have other rates, all compounds with the same rate share a view (`part_periods.py`).
"""

from __future__ import annotations

from collections.abc import Callable, Coroutine, Sequence
from functools import partial
from inspect import iscoroutine
from random import Random
from typing import Any

from umo.cycle.clock import Clock
from umo.cycle.events import Event
from umo.cycle.machine import ConnectedMachine
from umo.cycle.piling_up import FEW
from umo.cycle.sequences import Task
from umo.cycle.stage import Stage
from umo.errors import EquipmentFault
from umo.objects import Compound, Node
from umo.objects.presentation.run_facts import facts_of
from umo.user_code import check_acts_at_once


class MachineView:
    """The interface of the machine for its compounds."""

    clock: Clock

    def __init__(self, machine: ConnectedMachine) -> None:
        self.whole = machine
        self.clock, self.period = machine.clock, machine.clock.period
        self.task_clock: Clock | None = None
        """The clock by which sequences of these compounds take their steps; None means the machine's clock."""

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

    def is_in_fault(self, part: Node) -> bool:
        return self.whole.equipment.is_in_fault(part)

    def fail(self, part: Node, error: BaseException) -> bool:
        return self.whole.equipment.contain(part, error)

    def clear(self, part: Node) -> list[str]:
        return self.whole.equipment.clear(part)

    def start(self, sequence: Coroutine[Any, Any, Any], part: Node) -> Task:
        machine = self.whole
        try:
            machine.equipment.check_may_begin(part)
        except EquipmentFault:
            Task(sequence).cancel()  # it never begins
            raise
        sequences = machine.at_work
        task = sequences.start(sequence, part)
        if sequences is machine.sequences:
            task.clock = self.task_clock
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
            raise TypeError(f"`{so_far.__name__}` is a sequence, not a result: write `await` before its call")
        check_acts_at_once("the function of a result", so_far)
        self.whole.result_so_far = so_far

    def facts(self) -> dict[str, str]:
        """Return the state of the machine as text."""
        machine = self.whole
        stage = Stage.RUNNING if self.running else Stage.STOPPING
        now, missed = machine.clock.now, machine.clock.missed_in_all
        faults = {each.path: each.reason() for each in machine.equipment.all if each.in_fault}
        found = facts_of(stage, progress=machine.progress, time=now, missed=missed, faults=faults)
        for facts in machine.facts:
            found |= facts()
        return found


def connect_compounds(machine: ConnectedMachine, view_of: Callable[[Node], MachineView] | None = None) -> None:
    """Give the root the calls of the period, and each part its own calls. `view_of`: a function that returns the view
    of a compound; by default all compounds share one view."""
    period, whole = machine.phases, MachineView(machine)
    view_of = view_of or (lambda part: whole)
    root, *parts = machine.compounds
    root._connect(view_of(root), period.sample, period.control, period.update)
    for part in parts:
        calls = partial(whole.sample, part), partial(machine.acting_laws.act_for, part), partial(whole.update, part)
        part._connect(view_of(part), *calls)
    machine.acting_laws.choose()
