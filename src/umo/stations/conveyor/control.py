"""The control of the conveyor: one unit with the states of PackML, which sorts parts by length (tracking.py)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Annotated

from umo import Compound, DigitalSensor, Interlock, Number, action
from umo.control import next_period, state_of, until, value_of
from umo.operation import PackML, PackMLState
from umo.operation.alarms import Alarm, Priority
from umo.states import OpenClosed

from .belt import Beam, Belt, covered
from .tracking import Part, Tracking

__all__ = ["Beam", "Belt", "Conveyor", "Lot", "Part", "Sorter", "Sorting", "covered"]


@dataclass
class Lot:
    """The parts to sort, and those that were sorted."""

    parts: int = 10
    speed: float = 0.3  # of the belt, m/s
    nominal: float = 80.0  # length, mm
    tolerance: float = 4.0  # largest deviation of an accepted part from it, mm
    measured: list[Part] = field(default_factory=list)  # parts that have passed the diverter
    lost: int = 0  # parts that were on the belt at a stop or a fault

    @property
    def done(self) -> int:
        """The number of parts that were sorted or lost."""
        return len(self.measured) + self.lost


class Sorting(PackML):
    """The states of the sorter, which sorts the parts of its lot and then is complete. Without parts, or with a full
    bin, the sorter suspends itself. While it is held or suspended, the belt stands still, and the positions of the
    parts remain known. After a stop or a fault they are not known."""

    part: Sorter

    def refusal(self, command: str) -> str | None:
        if command in ("start", "unsuspend") and self.part.bin_full:
            return "the reject bin is full: empty it and call bin_emptied"
        inhibited = self.part.belt.setpoint.inhibited
        return f"{inhibited}: release it and acknowledge" if command == "start" and inhibited else None

    async def starting(self) -> None:
        belt, speed = self.part.belt, self.part.lot.speed
        self.part.track()
        belt.run_at(speed)
        await until(lambda: value_of(belt.speed) >= 0.9 * speed)

    async def execute(self) -> None:
        part = self.part
        while part.lot.done < part.lot.parts:
            if part.starved or part.bin_full:
                self.suspend()
            await next_period()

    async def holding(self) -> None:
        await self.part.belt.halt()

    unholding = unsuspending = starting
    suspending = completing = holding

    async def stopping(self) -> None:
        await self.part.belt.halt()
        self.part.lose()

    async def clearing(self) -> None:
        self.part.lose()


class Sorter(
    Tracking,
    equipment=True,
    numbers={"in_bin": Number(shown=True, kept=True)},
    alarms={
        "jam": Alarm(lambda sorter: sorter.jammed, "parts are jammed: remove them", priority=Priority.HIGH),
        "bin": Alarm(lambda sorter: sorter.bin_full, "the reject bin is full"),
        "no parts": Alarm(lambda sorter: sorter.waits, "no parts come", on_delay="10 s", priority=Priority.LOW),
    },
    stop_order=("belt", "diverter"),
    max_period="10 ms",
):
    """A belt with two barriers and a diverter, which sorts parts by length. `in_bin` counts the parts in the reject
    bin at the end of the chute."""

    bin_capacity: Annotated[int, Number(minimum=1, maximum=100_000, tunable=True)] = 200
    """The number of parts at which the reject bin counts as full. The parts that are then on the belt must still fit
    into the bin."""

    def setup(self) -> None:
        super().setup()
        self.unit = Sorting(self)
        self.lot = Lot()
        self.in_bin = 0

    def interlocks(self) -> Iterator[Interlock]:
        yield Interlock(self._stop_pressed, [self.belt, self.diverter], "the emergency stop was pressed", latched=True)

    def _stop_pressed(self) -> bool:
        return state_of(self.emergency_stop) is OpenClosed.OPEN

    @property
    def bin_full(self) -> bool:
        return self.in_bin >= self.bin_capacity

    @property
    def waits(self) -> bool:
        """True if the sorter is suspended because no parts come."""
        return self.starved and self.unit.state is PackMLState.SUSPENDED

    @property
    def cause(self) -> str:
        """The reason why nothing is sorted, as text."""
        if self.cycle.fault is None and self.waits:
            return f"no part came on {self.distance + self.spacing:.0f} mm of belt"
        return self.cycle.fault or self.unit.refusal("start") or self.unit.state.name.lower()

    @action(harmless=True)
    def bin_emptied(self) -> None:
        """Record that the reject bin was emptied."""
        self.in_bin = 0

    def accepts(self, length: float) -> bool:
        return abs(length - self.lot.nominal) <= self.lot.tolerance

    def passed(self, part: Part) -> None:
        lot = self.lot
        lot.measured.append(part)
        self.cycle.progress(f"part {lot.done} of {lot.parts}: {part.length:.1f} mm", done=lot.done)
        if part.accepted:
            self.unit.produced += 1
        else:
            self._reject(1)

    def lose(self) -> None:
        """Discard the positions of the parts on the belt. The next start pushes these parts onto the chute."""
        lost = len(self.forget())
        self.lot.lost += lost
        self._reject(lost)

    def _reject(self, number: int) -> None:
        self.unit.rejected += number
        self.in_bin += number


class Conveyor(Compound):
    """The sorter, and the timer of its cycle."""

    sorter: Sorter
    timer: DigitalSensor
