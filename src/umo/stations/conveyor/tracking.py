"""The tracking of parts: they are measured at the entry barrier, expected at the exit barrier, and sorted.

Everything is measured in mm of belt travel, which is the integral of the belt's actual speed, and not in time. So
nothing depends on the speed, which may change at any time, even in the middle of a part.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Coroutine
from dataclasses import dataclass
from itertools import count
from math import inf, nan
from typing import Annotated, Any

from umo import BinaryActuator, BinarySensor, Compound, Number, action
from umo.control import Task, until, value_of, wait
from umo.states import OnOff, OpenClosed

from .belt import Beam, Belt, covered
from .errors import BarrierStuck, EmergencyStop, Jam, PartMissing


@dataclass(eq=False)
class Part:
    """A part on the belt."""

    number: int
    front: float  # the belt's position at which its front covered the entry barrier, mm
    length: float = inf  # mm; infinite until it has left the entry barrier
    accepted: bool = False  # other parts are pushed onto the chute
    gone: bool = False  # it has passed the diverter


class Tracking(Compound, numbers={"length": Number("mm", shown=True)}):
    """The known parts on the belt. Parts are shorter than `distance` and do not touch each other.

    Two barriers cannot distinguish these cases: an entry barrier that stays covered at the start is stuck, or a part is
    jammed there (BarrierStuck). A part is jammed at a barrier, or the exit barrier got stuck when a part was due, or
    the entry barrier got stuck and no part followed (Jam). The last part on the belt was taken away, or is jammed
    (PartMissing).
    """

    belt: Belt
    entry: BinarySensor[Beam]
    exit: BinarySensor[Beam]
    diverter: BinaryActuator[OnOff]
    emergency_stop: BinarySensor[OpenClosed]
    distance: float = 300.0
    """Distance from the entry barrier to the exit barrier, mm."""
    diverter_at: float = 450.0
    """Distance from the entry barrier to the middle of the diverter, mm."""
    spacing: float = 200.0
    """The largest distance between the fronts of two consecutive parts, mm."""
    window: Annotated[float, Number("mm", 1.0, 100.0, tunable=True)] = 20.0
    """Distance that a part may slip on the belt from one barrier to the other, mm."""
    push_time: Annotated[float, Number("s", 0.01, 0.2, tunable=True)] = 0.05
    """Time from the command until the diverter reaches a part, s."""

    def setup(self) -> None:
        self._tasks: list[Task] = []  # those that watch; none: where the parts are is not known
        self._parts: list[Part] = []  # on the belt
        self._barriers: tuple[bool, bool] | None = None  # whether each was covered
        self._edges = 0  # seen at the barriers, whoever watches them
        self._unwatched_from = (0.0, 0)  # position and edges when the application was suspended
        self._between: deque[Part] = deque()  # the parts between the barriers, the foremost first
        self._pushes = 0  # under way; they overlap when parts follow each other closely
        self.length = nan  # of the last part measured
        self._zero = 0.0  # position of the belt from which on parts are measured, mm
        self.fed_at = 0.0  # position of the belt when the last part came, mm
        self.jammed = False

    def accepts(self, length: float) -> bool:
        """Return True if a part of this length in mm stays on the belt."""
        raise NotImplementedError

    def passed(self, part: Part) -> None:
        """Record that a part has passed the diverter."""

    def control(self) -> None:
        if (barriers := (covered(self.entry), covered(self.exit))) != self._barriers:
            self._barriers, self._edges = barriers, self._edges + 1

    def on_suspend(self) -> None:
        """Stop watching the barriers. Called when the belt brakes."""
        self._unwatched_from = self.belt.position, self._edges

    async def on_resume(self) -> None:
        """Check the parts. Called before the belt runs again. Raises PartMissing if parts cannot be at their assumed
        positions."""
        position, edges = self._unwatched_from
        moved = self.belt.position - position
        if self.tracked and (self._edges != edges or (moved > self.window and self.on_belt)):
            raise PartMissing(f"the belt has moved parts by {moved:.0f} mm unwatched: clear the belt")

    # The belt as a whole -------------------------------------------------------------------------------

    @property
    def tracked(self) -> bool:
        """True if the positions of the parts are known."""
        return any(not task.done for task in self._tasks)

    @property
    def on_belt(self) -> list[Part]:
        """The parts that are tracked."""
        return [part for part in self._parts if not part.gone]

    @property
    def starved(self) -> bool:
        """True if no part is on the belt, and none came while the belt moved by `distance` plus `spacing`."""
        return self.belt.position > self.fed_at + self.distance + self.spacing and not self.on_belt

    def track(self) -> None:
        """Measure, track and sort parts from now on, unless this is already being done. Parts that lie on the belt at
        the beginning were not measured; they are pushed onto the chute."""
        self.fed_at = self.belt.position
        if not self.tracked:
            self._between.clear()
            self._zero = self.belt.position
            watch = (self._watch_stop(), self._watch_entry(), self._watch_exit(), self._clear_belt())
            self._tasks = [self.cycle.start(sequence) for sequence in watch]

    def forget(self) -> list[Part]:
        """End the tracking. Return the parts that were on the belt."""
        tasks, self._tasks = self._tasks, []
        for task in tasks:
            task.cancel()
        lost, self._parts, self.jammed = self.on_belt, [], False
        return lost

    async def _watch_stop(self) -> None:
        await until(lambda: self.belt.setpoint.inhibited is not None)
        raise EmergencyStop(f"{self.belt.setpoint.inhibited}: release it, acknowledge, and clear the belt")

    async def _clear_belt(self) -> None:
        await self._push(until(lambda: self.belt.position >= self._zero + self.diverter_at - self.window))

    # A part on its way ---------------------------------------------------------------------------------

    async def _watch_entry(self) -> None:
        """Measure the parts. If something covers the barrier at first, begin when it has left the barrier."""
        limit = self.belt.position + self.spacing
        await until(lambda: not covered(self.entry) or self.belt.position > limit)
        if covered(self.entry):
            raise BarrierStuck("the entry barrier stays covered at the start: stuck, or a part is jammed there")
        self._zero = self.belt.position
        for number in count(1):
            await until(lambda: covered(self.entry))
            self.fed_at = self.belt.position
            part = Part(number, front=self.fed_at)
            self._between.append(part)
            self._parts = [*self.on_belt, part]
            await until(lambda: not covered(self.entry))
            self.length = part.length = self.belt.position - part.front
            part.accepted = self.accepts(part.length)

    async def _watch_exit(self) -> None:
        """Watch the parts arrive and leave, after those that were not measured have left."""
        await until(lambda: self.belt.position >= self._zero + self.distance - self.window)
        await until(lambda: not covered(self.exit) or self.belt.position >= self._zero + self.distance + self.window)
        while True:
            await until(lambda: covered(self.exit) or self._overdue())
            if not covered(self.exit):
                raise self._missing()
            part = self._arrived()
            part.front = self.belt.position - self.distance  # what it slipped on the way does not matter any more
            self._tasks = [*(task for task in self._tasks if not task.done), self.cycle.start(self._sort(part))]
            await self._leave(part)

    async def _leave(self, part: Part) -> None:
        end = self.belt.position + part.length + self.window
        await until(lambda: not covered(self.exit) or self.belt.position > end)
        if covered(self.exit):
            raise self._jam(f"part {part.number} is jammed at the exit barrier, or the barrier is stuck")

    @action
    async def push(self) -> None:
        """Push anything in front of the diverter onto the chute."""
        await self._push(wait(1.5 * self.push_time))

    async def _push(self, time: Coroutine[Any, Any, None]) -> None:
        """Keep the diverter out until the sequence `time` has ended."""
        self._pushes += 1
        self.diverter.write(OnOff.ON)
        try:
            await time
        finally:
            self._pushes -= 1
            self.diverter.write(OnOff.ON if self._pushes else OnOff.OFF)

    async def _sort(self, part: Part) -> None:
        """Watch a part from the exit barrier until it is past the diverter."""
        middle = part.front + self.diverter_at + part.length / 2
        await until(lambda: self.belt.position + 1000.0 * value_of(self.belt.speed) * self.push_time >= middle)
        if not part.accepted:
            await self.push()
        await until(lambda: self.belt.position >= middle + part.length / 2 + self.window)
        part.gone = True
        self.passed(part)

    def _overdue(self) -> bool:
        """True if neither a part nor the next one has arrived. This distinguishes a jam from a part that was taken
        away."""
        if not self._between:
            return False
        first = self._between[0]
        following = self._between[1] if len(self._between) > 1 else first
        margin = self.window if first.length < inf else self.spacing  # the next one shows whether the entry is stuck
        return self.belt.position > following.front + self.distance + margin

    def _missing(self) -> Exception:
        """Return the error that says why the foremost part does not arrive."""
        part, *others = self._between
        if part.length < inf and not others:
            return PartMissing(f"part {part.number} did not arrive: taken away, or jammed with no part behind it")
        where = "between the barriers" if part.length < inf else "at the entry barrier, or the barrier is stuck"
        return self._jam(f"part {part.number} is jammed {where}")

    def _jam(self, text: str) -> Jam:
        self.jammed = True
        return Jam(text)

    def _arrived(self) -> Part:
        """Return the part that has covered the exit barrier."""
        front = self.belt.position - self.distance
        last = self._between[-1] if self._between else None
        if last is not None and last.length == inf and front >= last.front - self.window:
            raise BarrierStuck("the entry barrier is stuck: it stays covered while parts pass it")
        part = next((part for part in self._between if abs(front - part.front) <= self.window), None)
        if part is None:
            raise BarrierStuck("the exit barrier is covered and no part can be there: it is stuck")
        if (first := self._between.popleft()) is not part:
            raise PartMissing(f"part {first.number} was taken away: part {part.number} arrived without it")
        return part
