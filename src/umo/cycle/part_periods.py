"""The periods of parts that do not have the machine's rate, as a capability: the phases GROUPS and OWED, and the views
of the parts' compounds."""

from __future__ import annotations

from functools import partial
from time import monotonic_ns

from umo.cycle.capability import Capability
from umo.cycle.clock import Clock
from umo.cycle.machine import ConnectedMachine
from umo.cycle.machine_view import MachineView
from umo.cycle.period import go_on, then_guard
from umo.cycle.rate_groups import PartGroup
from umo.errors import DriverError, Failure
from umo.objects import Compound, Node, walk


class GroupView(MachineView):
    """The machine as seen by the compounds with one rate. `period`: the period in s of their laws, which may act on a
    controller. Default: the period of the clock."""

    def __init__(self, machine: ConnectedMachine, clock: Clock, period: float | None = None) -> None:
        self.whole, self._clock = machine, clock
        self.period = clock.period if period is None else period
        self.task_clock = None if clock is machine.clock else clock

    @property
    def clock(self) -> Clock:  # type: ignore[override]
        """The clock by which a sequence of any part takes its steps."""
        task = self.current_task
        return self._clock if task is None else task.clock or self.whole.clock


def give_period(machine: ConnectedMachine, part: Compound, period: float) -> None:
    """Set the period in s that the compounds of a part see, if the laws of the part act on a controller."""
    for each in (part, *walk(part)):
        if isinstance(each, Compound):
            vars(each)["_machine"] = GroupView(machine, machine.groups.of(each).clock, period)


class PartPeriods(Capability):
    """The periods of the parts of one machine. The period of the whole machine transfers only the blocks with the
    machine's rate."""

    def attach(self, machine: ConnectedMachine) -> None:
        self._image, self._claims, self._sequences = machine.image, machine.claims, machine.sequences
        self._groups, self._laws, self._period = machine.groups, machine.acting_laws, machine.phases
        self.sampled = False
        """True if a period was sampled and not updated yet."""
        self._period.read, self._period.carry_out = self._read, self._carry_out
        self._period.send = partial(self._image.update, self._groups.whole.outputs)
        image = self._image
        self._sent = frozenset(slot for block in image.outputs for slot in range(block.start, block.stop))
        """The actuators that are sent in periods."""
        self._urgent: set[int] = set()
        """The actuators whose pending value is sent in this period even if their part is not due."""
        image.does_not_wait = self._hasten
        self._views = {group.number: GroupView(machine, group.clock) for group in self._groups.all}

    def view_of(self, part: Node) -> MachineView:
        """Return the view of a compound; the compounds of one rate share it."""
        return self._views[self._groups.of(part).number]

    def _read(self) -> bool:
        """Read the sensors of the whole machine's rate. If the last period had no `update`, also read those of the
        parts."""
        blocks = self._image.inputs if self.sampled else self._groups.whole.inputs
        self.sampled = True
        return self._image.sample(blocks)

    @property
    def any_due(self) -> bool:
        """True if the phases GROUPS or OWED have work in this period."""
        return bool(self._urgent or self._period.settling) or self._groups.any_due

    def _carry_out(self) -> bool:
        """Carry out GROUPS and OWED. If the outputs of one part are not accepted, the other parts still act. The
        outputs of parts are sent at once, even if those of the whole machine wait for the next tick."""
        self.sampled = False
        settling = bool(self._period.settling)
        if not (settling or self._groups.any_due):
            return self._send_urgent()
        due = self._groups.take_due()
        late = [part for part in self._groups.parts if part not in due] if settling else []
        for part in late:
            part.clock.measure()
        if self._laws.stale:
            self._laws.choose()
        sample = partial(self._image.sample, [block for part in (*due, *late) for block in part.inputs])
        if self._claims.by_slot:
            then_guard(sample, self._period.guards.evaluate)
        else:
            sample()
        accepted = True
        failed: list[Failure] = []
        for part in (*due, *late):
            self._control(part, in_turn=part not in late)
            try:
                accepted &= self._image.update(part.outputs, 0.0)  # a slew rate counts from the last step
            except DriverError as error:
                failed += error.failures
        if self._period.settling:
            self._period.settle()
        if failed:
            unsent = "could not be written"
            go_on(DriverError(unsent, failed), self._send_urgent, unsent)
        return self._send_urgent() and accepted

    def _control(self, part: PartGroup, in_turn: bool) -> None:
        """Advance the sequences of a part, if it is due, then call its laws."""
        began = monotonic_ns()
        try:
            if in_turn:
                self._sequences.advance(part.clock, part.clock)
            for call in self._period.before_laws:
                call()
            self._laws.act(part.laws)
        finally:
            part.took(monotonic_ns() - began)

    def _send_urgent(self) -> bool:
        """Send the values that do not wait for the period of their part: defaults, and the values that an application
        wrote before it was suspended."""
        image, urgent = self._image, self._urgent
        if not urgent:
            return True
        urgent &= {slot for slot in urgent if image.values[slot] != image.pending[slot]}
        return not urgent or image.update_some([slot for slot in self._claims.order if slot in urgent])

    def _hasten(self, slot: int) -> None:
        if slot in self._sent:
            self._urgent.add(slot)
