"""A motor behind a step and a direction output (the paper's DIO-StepperDrive-StepperMotor, section 4.4)."""

from __future__ import annotations

from dataclasses import dataclass, field

from umo.errors import RangeError
from umo.objects import BinaryActuator
from umo.states import Rotation, UpDown

STEPS_PER_PERIOD = 0.4
"""Largest step rate of a profile, in steps per period: a step takes two periods, a reversal one more."""


@dataclass
class Stepping:
    """Converts a position in steps (a real number) into step edges: a phase accumulator.

    UP and DOWN last at least one period each. The direction output is stable for at least one period before UP.
    CW counts up. Both outputs are written in every period.
    """

    step: BinaryActuator[UpDown]
    direction: BinaryActuator[Rotation]
    count: int = field(default=0, init=False)
    """Sum of the steps sent, CW positive."""
    refused: bool = field(default=False, init=False)
    """Whether an interlock inhibits the outputs: this period's write was not taken."""

    def control(self, position: float) -> bool:
        """One period towards `position` in steps; True once it is within half a step and the output is DOWN. RangeError
        if the position is not finite; then nothing is written."""
        due = position - self.count
        if due - due != 0.0:  # NaN, or infinite
            raise RangeError(f"{self.step.path}: {position} is no position to step to")
        is_up, stands = self.step.read() is UpDown.UP, self.direction.read()
        rests = is_up or abs(due) <= 0.5
        wanted = stands if rests else Rotation.CW if due > 0 else Rotation.CCW
        turned, steps = self.direction.write(wanted), not rests and wanted is stands
        taken = self.step.write(UpDown.UP if steps else UpDown.DOWN)
        if steps and taken:
            self.count += 1 if due > 0 else -1
        self.refused = not rests and not (taken if steps else turned)
        return rests and not is_up
