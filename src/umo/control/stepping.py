"""A motor behind a step and a direction output (the paper's DIO-StepperDrive-StepperMotor, section 4.4)."""

from __future__ import annotations

from dataclasses import dataclass, field

from umo.errors import RangeError
from umo.objects import BinaryActuator
from umo.states import Rotation, UpDown

_UP, _DOWN, _CW, _CCW = UpDown.UP, UpDown.DOWN, Rotation.CW, Rotation.CCW  # an attribute of an Enum is a call

STEPS_PER_PERIOD = 0.4
"""Largest step rate of a profile, in steps per period: a step takes two periods, and a reversal takes one more."""


@dataclass
class Stepping:
    """A phase accumulator: it converts a position in steps (a real number) into step edges. UP and DOWN last at least
    one period each. The direction output is stable for at least one period before UP. CW counts up.
    """

    step: BinaryActuator[UpDown]
    direction: BinaryActuator[Rotation]
    count: int = field(default=0, init=False)
    """Sum of the steps sent, CW positive."""
    refused: bool = field(default=False, init=False)
    """True if an interlock inhibits the outputs: the write of this period was not accepted."""

    def control(self, position: float) -> bool:
        """Carry out one period towards `position` in steps. Returns True when the sent position is within half a step
        of `position` and the output is DOWN. Raises RangeError if the position is not finite; then nothing is
        written."""
        due = position - self.count
        if due - due != 0.0:  # NaN, or infinite
            raise RangeError(f"{self.step.path}: {position} is not a position to step to")
        self.refused = False
        if self.step.read() is _UP:
            self.step.write(_DOWN)
            return False
        if abs(due) <= 0.5:
            return True
        wanted = _CW if due > 0 else _CCW
        if self.direction.read() is not wanted:
            self.refused = not self.direction.write(wanted)
            return False
        self.refused = not self.step.write(_UP)
        if not self.refused:
            self.count += 1 if due > 0 else -1
        return False
