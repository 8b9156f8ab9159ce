"""The courier of the plant, and the plant's report on each part. The control code sees neither. The courier brings one
part after another under the cup. It takes a part away when the cup has lifted and released the part, the part lies
still, and z is above `CLEAR_UM`. The first part comes when z has risen above `CLEAR_UM` for the first time, so that
homing over the low stop does not hit a part.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from .devices import STEP

CLEAR_UM = 100_000.0
"""Height of z above which the courier moves, um."""
TRAVEL = 0.7
"""The duration of every journey of the courier, s. The courier has settled 0.1 s later."""
SETTLE = 0.1
QUIET = 0.05
"""Time for which a released part must have lain still before the courier leaves, s."""
STILL_UM = 5.0
"""Motion in one physics step below which a part lies still, um."""
LIFT_UM = 5_000.0
"""Smallest rise at which a part counts as lifted, um."""
TOLERANCE_UM = 200.0
"""Largest distance between the centre of a placed part and its target, and largest error of its height, um."""
TOLERANCE_DEG = 1.0
"""Largest error of the yaw of a placed part, deg."""


class Pose(NamedTuple):
    """A part on the courier, seen from above, with the theta axis at the origin.

    x to the right and y to the back, um; yaw clockwise (as positive theta), deg; height of the centre, um.
    """

    x: float
    y: float
    yaw: float
    height: float

    def turned(self) -> Pose:
        """Return this pose turned by +90 deg about the theta axis. A part that is off centre swings around the axis."""
        return Pose(self.y, -self.x, self.yaw + 90.0, self.height)


@dataclass(frozen=True, slots=True)
class PartReport:
    """Report on one part. Errors are None until it has been delivered and lifted."""

    index: int
    delivered: bool
    lifted: bool
    start: Pose | None
    final: Pose | None
    error_um: float | None
    error_deg: float | None
    placed: bool

    def __str__(self) -> str:
        if self.error_um is None or self.error_deg is None:
            return f"part {self.index}: {'not lifted' if self.delivered else 'not delivered'}"
        verdict = "placed" if self.placed else "not placed"
        return f"part {self.index}: {verdict}, {self.error_um:.0f} um and {self.error_deg:.3f} deg off"


@dataclass(frozen=True, slots=True)
class Report:
    """The actual results for every part, in the order of delivery."""

    parts: tuple[PartReport, ...]

    @property
    def placed(self) -> int:
        return sum(part.placed for part in self.parts)

    def __str__(self) -> str:
        return "\n".join(map(str, self.parts))


class _Part:
    """Memory of the courier for one part."""

    def __init__(self) -> None:
        self.start: Pose | None = None
        self.final: Pose | None = None
        self.lifted = False
        self.held = False


class Courier:
    """The courier: its target position, and the parts that it has observed. Positions are in m along its track.

    `stops` are its positions with each part under the cup; `look` returns the true pose of a part."""

    def __init__(
        self, stops: Sequence[float], look: Callable[[int], Pose], *, park: float, absent: bool = False
    ) -> None:
        self._stops = [*stops, -park]
        self._parts = [_Part() for _ in stops]
        self._look = look
        self._absent = absent
        self._from = self._to = park
        self.moving = False
        """True if the courier is under way."""
        self._clock = 0.0
        self._quiet = 0.0
        self._height = 0.0
        self.current = -1
        """Index of the part under the cup or on its way to it; -1 before the first one."""
        self.present = False
        """True if the current part stands under the cup."""

    @property
    def lifted(self) -> bool:
        """True if the cup has lifted the current part."""
        return self.present and self._parts[self.current].lifted

    def stop(self, part: int) -> float:
        """Return the position of the courier with the part under the cup, m."""
        return self._stops[part]

    def target(self, z_um: float) -> float:
        """Return the position at which the courier must be after one physics step, m."""
        if self.moving:
            return self._travel()
        if self.current < 0 and z_um > CLEAR_UM and not self._absent:
            self._depart()
        return self._to

    def _depart(self) -> None:
        self.current += 1
        self.present = False
        self._from, self._to = self._to, self._stops[self.current]
        self.moving = True
        self._clock = self._quiet = 0.0

    def _travel(self) -> float:
        self._clock += STEP
        if self._clock < TRAVEL:  # the smoothest way: least jerk
            s = self._clock / TRAVEL
            return self._from + (self._to - self._from) * s * s * s * (10.0 + s * (6.0 * s - 15.0))
        if self._clock >= TRAVEL + SETTLE:
            self.moving = False
            self.present = self.current < len(self._parts)
        return self._to

    def watch(self, height: float, *, z_um: float, held: bool) -> None:
        """Observe the height of the current part's centre, um; called once a physics step while a part is present."""
        part = self._parts[self.current]
        if part.start is None:
            part.start = self._look(self.current)
        part.held = held
        still = abs(height - self._height) < STILL_UM
        self._height = height
        if not part.lifted:
            part.lifted = held and height - part.start.height > LIFT_UM
        elif held or not still or z_um <= CLEAR_UM:
            self._quiet = 0.0
        else:
            self._quiet += STEP
            if self._quiet >= QUIET:
                part.final = self._look(self.current)
                self._depart()

    def report(self) -> Report:
        if self.present and self._parts[self.current].lifted:
            self._parts[self.current].final = self._look(self.current)
        return Report(tuple(_judge(i, part) for i, part in enumerate(self._parts)))


def _judge(index: int, part: _Part) -> PartReport:
    start, final = part.start, part.final
    if start is None or final is None:
        return PartReport(index, start is not None, part.lifted, start, final, None, None, False)
    goal = start.turned()
    error_um = math.hypot(final.x - goal.x, final.y - goal.y)
    error_deg = abs((final.yaw - goal.yaw + 180.0) % 360.0 - 180.0)
    lies_flat = not part.held and abs(final.height - goal.height) <= TOLERANCE_UM
    placed = lies_flat and error_um <= TOLERANCE_UM and error_deg <= TOLERANCE_DEG
    return PartReport(index, True, True, start, final, error_um, error_deg, placed)
