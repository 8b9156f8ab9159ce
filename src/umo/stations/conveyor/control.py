"""The control of the conveyor: it measures parts at the entry barrier, expects them at the exit, and sorts them.

Everything is measured in mm of belt travel, the integral of the belt's actual speed, and not in time. So nothing
depends on the speed, and it may change at any moment, also in the middle of a part.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import count
from math import inf, nan
from typing import Annotated

from umo import BinaryActuator, BinarySensor, Compound, DigitalActuator, DigitalSensor, Interlock, Number, Range, action
from umo.control import state_of, until, value_of, wait
from umo.states import OnOff, OpenClosed, TwoState

from .errors import BarrierStuck, DriveError, EmergencyStop, Jam, PartMissing


class Beam(TwoState):
    CLEAR = "clear"
    COVERED = "covered"


def covered(barrier: BinarySensor[Beam]) -> bool:
    return state_of(barrier) is Beam.COVERED


@dataclass(eq=False)
class Part:
    """A part on the belt."""

    number: int
    front: float  # the belt's position at which its front covered the entry barrier, mm
    length: float = inf  # mm; infinite until it has left the entry barrier
    accepted: bool = False  # set by the application; other parts are pushed onto the chute
    gone: bool = False  # it has passed the diverter


class Belt(Compound):
    """A belt on a frequency drive. `speed` is the drive's reading: it does not show that the belt slips."""

    run: BinaryActuator[OnOff]
    setpoint: DigitalActuator
    speed: DigitalSensor
    deviation: Annotated[float, Number("m/s", 0.01, 0.2, tunable=True)] = 0.05
    """Largest difference between setpoint and speed, m/s; while the belt is to move, at most half of the setpoint."""
    settling_time: Annotated[float, Number("s", 0.1, 5.0, tunable=True)] = 0.5
    """Time for which the deviation may be larger, s."""

    def setup(self) -> None:
        self.position = 0.0  # what the belt has travelled, mm
        self._speed = 0.0
        self._deviating = 0.0

    def control(self) -> None:
        before, self._speed = self._speed, value_of(self.speed)
        self.position += 1000.0 * (before + self._speed) / 2 * self.dt
        commanded = self.setpoint.read() if self.run.read() is OnOff.ON else 0.0
        largest = min(self.deviation, commanded / 2) if commanded else self.deviation
        self._deviating = self._deviating + self.dt if abs(self._speed - commanded) > largest else 0.0
        if self._deviating > self.settling_time:
            raise DriveError(f"the drive runs at {self._speed:.3f} m/s, {commanded:.3f} m/s were commanded")

    @action(speed=lambda belt: Range.of(belt.setpoint), release="brake")
    def run_at(self, speed: float) -> None:
        """Accelerate or brake to `speed` m/s, as fast as the slew rate of the setpoint allows."""
        self.setpoint.write(speed)
        self.run.write(OnOff.ON)

    def brake(self) -> None:
        """Brake to standstill; a drive that is switched on stays so."""
        self.setpoint.write(0.0)

    @action
    async def halt(self) -> None:
        """Brake to standstill, then switch the drive off."""
        self.setpoint.write(0.0)
        await until(lambda: value_of(self.speed) < 0.01, timeout="10 s")
        self.run.write(OnOff.OFF)


class Conveyor(
    Compound,
    numbers={"length": Number("mm", shown=True)},
    stop_order=("belt", "diverter"),
    max_period="10 ms",
):
    """A conveyor that sorts parts by length. Parts are shorter than `distance` and do not touch each other.

    What two barriers cannot tell apart: a barrier that is covered at the start is stuck, or a part lies there
    (BarrierStuck). A part is jammed at a barrier, or the exit barrier got stuck when a part was due, or the entry
    barrier got stuck and no part followed (Jam). The last part on the belt was taken away, or is jammed (PartMissing).
    """

    belt: Belt
    entry: BinarySensor[Beam]
    exit: BinarySensor[Beam]
    diverter: BinaryActuator[OnOff]
    emergency_stop: BinarySensor[OpenClosed]
    timer: DigitalSensor
    distance: float = 300.0
    """Distance from the entry barrier to the exit barrier, mm."""
    diverter_at: float = 450.0
    """Distance from the entry barrier to the middle of the diverter, mm."""
    spacing: float = 200.0
    """Largest distance between the fronts of two parts that follow each other, mm."""
    window: Annotated[float, Number("mm", 1.0, 100.0, tunable=True)] = 20.0
    """Distance that a part may slip on the belt from one barrier to the other, mm."""
    push_time: Annotated[float, Number("s", 0.01, 0.2, tunable=True)] = 0.05
    """Time from the command to the diverter until it reaches a part, s."""

    def setup(self) -> None:
        self.length = nan  # of the last part measured
        self._between: deque[Part] = deque()  # the parts between the barriers, the foremost first
        self._measured: deque[Part] = deque()  # for `next_part`
        self._pushes = 0  # under way; they overlap when parts follow each other closely
        self._parts: list[Part] = []  # on the belt
        self._barriers: tuple[bool, bool] | None = None  # whether each was covered
        self._edges = 0  # seen at the barriers, whoever watches them
        self._unwatched_from = (0.0, 0)  # position and edges when the application was suspended

    def control(self) -> None:
        if (barriers := (covered(self.entry), covered(self.exit))) != self._barriers:
            self._barriers, self._edges = barriers, self._edges + 1

    def on_suspend(self) -> None:
        """Nobody watches the barriers while the belt brakes."""
        self._unwatched_from = self.belt.position, self._edges

    async def on_resume(self) -> None:
        """PartMissing if parts cannot be where they are taken to be."""
        position, edges = self._unwatched_from
        moved = self.belt.position - position
        if self._edges != edges or (moved > self.window and not all(part.gone for part in self._parts)):
            raise PartMissing(f"the belt has moved parts by {moved:.0f} mm unwatched: stop the run and clear it")

    def interlocks(self) -> Iterator[Interlock]:
        yield Interlock(self._stop_pressed, [self.belt, self.diverter], "the emergency stop was pressed", latched=True)

    def _stop_pressed(self) -> bool:
        return state_of(self.emergency_stop) is OpenClosed.OPEN

    def begin(self, speed: float) -> None:
        """Start the belt at `speed` m/s. From now on parts are measured, tracked, and rejected if not accepted."""
        for barrier in (self.entry, self.exit):
            if covered(barrier):
                raise BarrierStuck(f"the {barrier.path} barrier is covered at the start: stuck, or a part lies there")
        self.setup()  # nothing is left of a run before
        self.belt.run_at(speed)
        for sequence in (self._watch_stop(), self._watch_entry(), self._watch_exit()):
            self.cycle.start(sequence)

    async def next_part(self) -> Part:
        """The next part that was measured. Accept it before its front is at the exit barrier."""
        limit = self.belt.position + self.distance + self.spacing
        await until(lambda: bool(self._measured) or (self.belt.position > limit and not self._between))
        if not self._measured:
            raise PartMissing(f"no part came on {self.distance + self.spacing:.0f} mm of belt")
        return self._measured.popleft()

    async def _watch_stop(self) -> None:
        await until(lambda: self.belt.setpoint.inhibited is not None)
        raise EmergencyStop(f"{self.belt.setpoint.inhibited}: release it and clear the belt before the next run")

    async def _watch_entry(self) -> None:
        """Measure the parts."""
        for number in count(1):
            await until(lambda: covered(self.entry))
            part = Part(number, front=self.belt.position)
            self._between.append(part)
            self._parts = [*(each for each in self._parts if not each.gone), part]
            await until(lambda: not covered(self.entry))
            self.length = part.length = self.belt.position - part.front
            self._measured.append(part)

    async def _watch_exit(self) -> None:
        """See the parts arrive and leave."""
        while True:
            await until(lambda: covered(self.exit) or self._overdue())
            if not covered(self.exit):
                raise self._missing()
            part = self._arrived()
            part.front = self.belt.position - self.distance  # what it slipped on the way does not matter any more
            self.cycle.start(self._sort(part))
            await self._leave(part)

    async def _leave(self, part: Part) -> None:
        end = self.belt.position + part.length + self.window
        await until(lambda: not covered(self.exit) or self.belt.position > end)
        if covered(self.exit):
            raise Jam(f"part {part.number} is jammed at the exit barrier, or the barrier is stuck")

    @action
    async def push(self) -> None:
        """Push whatever is before the diverter onto the chute."""
        self._pushes += 1
        self.diverter.write(OnOff.ON)
        await wait(1.5 * self.push_time)
        self._pushes -= 1
        self.diverter.write(OnOff.ON if self._pushes else OnOff.OFF)

    async def _sort(self, part: Part) -> None:
        """See a part from the exit barrier past the diverter."""
        middle = part.front + self.diverter_at + part.length / 2
        await until(lambda: self.belt.position + 1000.0 * value_of(self.belt.speed) * self.push_time >= middle)
        if not part.accepted:
            await self.push()
        await until(lambda: self.belt.position >= middle + part.length / 2 + self.window)
        part.gone = True

    def _overdue(self) -> bool:
        """A part has not arrived, and neither has the next one: that tells a jam from a part that was taken away."""
        if not self._between:
            return False
        first, *others = self._between
        margin = self.window if first.length < inf else self.spacing  # the next one shows whether the entry is stuck
        return self.belt.position > (others or [first])[0].front + self.distance + margin

    def _missing(self) -> Exception:
        """Reason why the foremost part does not arrive."""
        part, *others = self._between
        if part.length < inf and not others:
            return PartMissing(f"part {part.number} did not arrive: taken away, or jammed with no part behind it")
        where = "between the barriers" if part.length < inf else "at the entry barrier, or the barrier is stuck"
        return Jam(f"part {part.number} is jammed {where}")

    def _arrived(self) -> Part:
        """The part that has covered the exit barrier."""
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
