"""What becomes of the outputs of a part while its work waits, where the part does not say so itself.

The reactions are those to a suspension (`umo.objects.reaction`): an actuator goes to its default, or holds its value
where it, or a compound around it, is declared so. What a law writes, the law writes on. When the work goes on, each
actuator that is still at its default has the value again that the work had left.
"""

from __future__ import annotations

from typing import Any

from umo.cycle.image import ToDefault
from umo.objects import Actuator, Compound, atoms
from umo.objects.paths import is_within


class Resting:
    """The outputs of one part, but for those of parts within it that have states of their own (`others`)."""

    def __init__(self, part: Compound, others: list[Compound]) -> None:
        self._actuators = [
            item
            for item in atoms(part)
            if isinstance(item, Actuator) and not any(is_within(item, other) for other in others)
        ]
        self._left: dict[int, float] = {}
        """The values that the work has left, by place in the list."""

    def begin(self) -> None:
        """The work waits. What was left before stays known."""
        for place, item in enumerate(self._actuators):
            image: Any = item._image
            left = image.pending[item._slot]
            if left != item._default_value() and item.when_suspended != "hold":
                self._left[place] = left
                image.settle((item._slot,), ToDefault.SEND)

    def end(self) -> None:
        """The work goes on."""
        left, self._left = self._left, {}
        for place, value in left.items():
            item = self._actuators[place]
            image: Any = item._image
            if image.pending[item._slot] == item._default_value():
                image.go_on(item._slot, value)

    def forget(self) -> None:
        """The work has ended."""
        self._left.clear()
