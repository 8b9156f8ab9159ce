"""A machine whose parts have rates of their own (the class keyword `every`).

A period carries out the machine's own rate first, outputs included. Then come the parts that are due, the fastest
first: in the time that is left, they delay nothing. A part whose period has passed with a missed tick runs late, once;
its grid stays.
"""

from __future__ import annotations

from collections.abc import Callable, Coroutine, Sequence
from functools import cached_property
from heapq import heapify, heappop, heappush
from time import monotonic_ns
from types import MethodType
from typing import Any, cast

from umo.cycle.clock import Clock, WallClock
from umo.cycle.columns import Block
from umo.cycle.image import Image
from umo.cycle.machine import ConnectedMachine, go_on
from umo.cycle.sequences import Task
from umo.errors import DriverError, Failure
from umo.objects import Compound, Node
from umo.objects.link import Machine
from umo.wiring.rates import WHOLE, Rate, RateMap


class PartClock(Clock):
    """The clock of a part: its ticks are the part's own periods."""

    __slots__ = ("_base", "_last")
    _base: Clock

    def __init__(self, base: Clock, every: int) -> None:
        self._base = base
        self._last = 0, 0.0
        super().__init__(every * base.period)
        self.restart()

    @property
    def now(self) -> float:
        """The machine's time, also between the part's periods."""
        return self._base.now

    @now.setter
    def now(self, value: float) -> None:
        """`Clock` sets it; it is the machine's."""

    def read(self) -> float:
        return self._base.read()

    def restart(self) -> None:
        """The part begins now."""
        self._last = self._base.number, self._base.now

    def step(self, ticks: int) -> None:
        """A period of the part begins, `ticks` of its own after the last one. `dt` is the time since that."""
        self.missed = ticks if ticks > 1 else 0
        self.missed_in_all += max(ticks - 1, 0)
        self.ticks = max(ticks, 1)
        self.number += self.ticks
        self.measure()

    def measure(self) -> None:
        """`dt` is the time since the laws have acted last."""
        base, (number, then) = self._base, self._last
        self.dt = (base.number - number) * base.period if base.period else base.now - then
        self.restart()


class RatedPart:
    """A part with a rate of its own. `number` is its place in `Wired.rates`."""

    def __init__(self, number: int, rate: Rate, image: Image) -> None:
        self.path = rate.part._path
        self.every, self.phase = rate.every, rate.phase
        self.clock = PartClock(image.clock, rate.every)
        self.inputs = [block for block in image.inputs if block.part == number]
        self.outputs = [block for block in image.outputs if block.part == number]
        self.laws: list[MethodType] = []
        self.due = 0
        """Number of the period in which it is due next."""
        self.took: Callable[[int], object] = lambda ns: None
        """Function that is told the duration in ns of its control."""

    def schedule(self, number: int) -> int:
        """It was carried out in this period: it is due again at the next of its own. The number of its own that have
        begun since."""
        ticks = max((number - self.due) // self.every + 1, 0)
        self.due += ticks * self.every
        return ticks

    def restart(self, number: int) -> None:
        self.clock.restart()
        self.due = number + 1 + (self.phase - number - 1) % self.every


class PartMachine:
    """The machine, seen from compounds of one rate (`umo.objects.link.Machine`). `period` in s: of their laws, which
    may act on a controller. Default: the clock's."""

    def __init__(self, machine: ConnectedMachine, clock: Clock, period: float | None = None) -> None:
        self.whole, self._clock = machine, clock
        self.period = clock.period if period is None else period

    @property
    def clock(self) -> Clock:
        """In a sequence, whoever's it is, the clock by which that takes its steps."""
        task = self.whole.current_task
        return self._clock if task is None else task.clock or self.whole.clock

    def __getattr__(self, name: str) -> Any:
        return getattr(self.whole, name)


class RatedMachine(ConnectedMachine):
    """A connected machine with parts that have rates of their own."""

    def __init__(self, root: Compound, image: Image, *arguments: Any, rates: Sequence[Rate]) -> None:
        self._map = RateMap(rates)
        self._by_number = {n: RatedPart(n, rate, image) for n, rate in enumerate(rates) if rate.every > 1}
        self.parts = list(self._by_number.values())
        self._queue: list[tuple[int, int]] = []
        """When each part is due next, and its number: a heap."""
        self._open = False
        """Whether a period was sampled and not updated yet."""
        self._all_act = False
        self._late: list[RatedPart] = []
        """The parts whose laws act out of turn in this period."""
        image.due_outputs = [block for block in image.outputs if block.part == WHOLE]
        self._inputs = [block for block in image.inputs if block.part == WHOLE]
        super().__init__(root, image, *arguments)
        self._restart()

    def _restart(self) -> None:
        """Every part is due at its next phase."""
        for part in self.parts:
            part.restart(self.clock.number)
        self._queue = [(part.due, number) for number, part in self._by_number.items()]
        heapify(self._queue)

    def _part_of(self, node: Node) -> RatedPart | None:
        return self._by_number.get(self._map.number(node))

    def _seen_from(self, compound: Compound) -> Machine:
        part = self._part_of(compound)
        return self._views[WHOLE if part is None else id(part)]

    @cached_property
    def _views(self) -> dict[int, Machine]:
        """The machine as the compounds of each rate see it."""
        clocks = {WHOLE: self.clock, **{id(part): part.clock for part in self.parts}}
        return {key: cast(Machine, PartMachine(self, clock)) for key, clock in clocks.items()}

    def skip_ticks(self) -> None:
        super().skip_ticks()
        self._restart()

    # A period ------------------------------------------------------------------------------------------

    def _way_to_sample(self) -> Callable[[], bool]:
        look = self.clock.look if isinstance(self.clock, WallClock) and self.image.timer < 0 else None

        def sample() -> bool:
            if look is not None:
                self.finish_period()
                look()
            # where nobody calls `update`, the parts are read all the same
            self.image.due_inputs = self.image.inputs if self._open else self._inputs
            self._open = True
            return self.sample_all()

        return sample

    def _take_due(self) -> list[RatedPart]:
        """The parts that are due in this period: their own begins. The fastest first."""
        number, queue, due = self.clock.number, self._queue, []
        self._late = []
        while queue[0][0] <= number:
            key = heappop(queue)[1]
            part = self._by_number[key]
            part.clock.step(part.schedule(number))
            heappush(queue, (part.due, key))
            due.append(key)
        found = [self._by_number[key] for key in sorted(due)]  # numbered from the fastest on
        if self._all_act:
            self._late = [part for part in self.parts if part not in found]
            for part in self._late:
                part.clock.measure()
            found += self._late
        return found

    def _update(self) -> bool:
        self.period_open = True
        accepted = self._then_parts(self.image.update)
        self._finish()
        return accepted

    def _update_later(self) -> bool:
        """The outputs of the parts are sent at once all the same."""
        waiting, self._unsent = self._unsent, True
        self.period_open = True
        accepted = self._then_parts(self.image.update) if waiting else self._carry_out()
        self._finish()
        return accepted

    def _then_parts(self, send: Callable[[], bool]) -> bool:
        try:
            accepted = send()
        except DriverError as unsent:
            go_on(unsent, self._carry_out, "could not be written or read")
        return self._carry_out() and accepted

    def _carry_out(self) -> bool:
        """The parts that are due: all are sampled, then each is controlled and updated. One that does not accept its
        outputs does not stop the others."""
        self._open = False
        if self._queue[0][0] > self.clock.number and not self._all_act:
            return self._send_urgent()
        due = self._take_due()
        if self._laws_are_stale:
            self._choose_laws()
        self._sample_parts([block for part in due for block in part.inputs])
        failed: list[Failure] = []
        for part in due:
            self._control_part(part, in_turn=part not in self._late)
            try:
                self.image.update(part.outputs)
            except DriverError as error:
                failed += error.failures
        if self._all_act:
            self._all_act = False
            super()._laws_have_acted()
        if failed:
            raise DriverError("could not be written", failed)
        return self._send_urgent()

    def _send_urgent(self) -> bool:
        """What does not wait for its part's period: defaults, and what an application had before it was suspended."""
        image = self.image
        if not image.urgent:
            return True
        image.urgent = {slot for slot in image.urgent if image.values[slot] != image.pending[slot]}
        return not image.urgent or image.update_some([slot for slot in self.stop_order if slot in image.urgent])

    def _sample_parts(self, blocks: Sequence[Block]) -> None:
        """Guards are evaluated on what was read."""
        try:
            self.image.sample(blocks)
        except DriverError as unread:
            if self.commands.by_slot:
                go_on(unread, self.commands.evaluate, "could not be read or reset")
            raise
        if self.commands.by_slot:
            self.commands.evaluate()

    def _control_part(self, part: RatedPart, in_turn: bool) -> None:
        """Its sequences, in its own periods only, then its laws."""
        began = monotonic_ns()
        try:
            if in_turn:
                self.sequences.advance(part.clock, part.clock)
            self._act_on(iter(part.laws), {})
        finally:
            part.took(monotonic_ns() - began)

    # Laws and sequences --------------------------------------------------------------------------------

    def _choose_laws(self) -> None:
        for part in self.parts:
            part.laws = []
        super()._choose_laws()

    def _law_lists(self) -> list[list[MethodType]]:
        return [self._laws, *(part.laws for part in self.parts)]

    def _acting_laws(self) -> list[MethodType]:
        """Those at the machine's own rate; the others are the parts'."""
        own: list[MethodType] = []
        for law in super()._acting_laws():
            part = self._part_of(cast(Node, law.__self__))
            (own if part is None else part.laws).append(law)
        return own

    def _laws_have_acted(self) -> None:
        """Those of all parts act in this period, also out of turn, before what waits for them."""
        self._all_act = True

    def start(self, sequence: Coroutine[Any, Any, Any], part: Node) -> Task:
        """A sequence of the application takes its steps in the periods of its part."""
        task = super().start(sequence, part)
        own = self._part_of(part)
        if own is not None and (self.clients is None or self.clients.at_work is None):
            task.clock = own.clock
        return task


def machine_of(root: Compound, image: Image, rates: Sequence[Rate], *arguments: Any) -> ConnectedMachine:
    """The connected machine: without parts that have rates of their own the plain one, which knows nothing of them."""
    if any(rate.every > 1 for rate in rates):
        return RatedMachine(root, image, *arguments, rates=rates)
    return ConnectedMachine(root, image, *arguments)
