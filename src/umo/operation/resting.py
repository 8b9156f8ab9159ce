"""The rest of a part's outputs while the work of the part waits, unless the part brings its outputs to rest itself.

The reactions are those in manual mode (`umo.objects.keywords`): an actuator goes to its default, or holds its value if
the actuator or a compound around it declares "hold". Laws continue to write their outputs. When the work continues,
each actuator that is still at its default gets back the value that the work had written last."""

from __future__ import annotations

from typing import Any

from umo.cycle.to_defaults import ToDefault
from umo.objects import Actuator, Compound, atoms
from umo.objects.paths import is_within


class Resting:
    """The outputs of one part, without the outputs of inner parts that have states themselves (`others`)."""

    def __init__(self, part: Compound, others: list[Compound]) -> None:
        self._actuators = [
            item
            for item in atoms(part)
            if isinstance(item, Actuator) and not any(is_within(item, other) for other in others)
        ]

    @property
    def _image(self) -> Any:
        return self._actuators[0]._image

    def begin(self) -> None:
        """Begin the rest, because the work waits. Values that were stored before are kept. Actuators that a client has
        taken are left out, because the work does not drive them."""
        if not self._actuators:
            return
        image = self._image
        pending = {item._slot: image.pending[item._slot] for item in self._actuators if not item._holds}
        driven = {slot: value for slot, value in pending.items() if value != image.scales.defaults[slot]}
        resting = {slot: value for slot, value in driven.items() if not image.claims.client_of(slot)}
        image.claims.left.setdefault(self, {}).update(resting)
        image.settle(resting, ToDefault.SEND)

    def end(self) -> None:
        """End the rest, because the work continues."""
        left = self.forget()
        if left:
            image = self._image
            still = {slot: value for slot, value in left.items() if image.pending[slot] == image.scales.defaults[slot]}
            image.commands.go_on(still)

    def forget(self) -> dict[int, float]:
        """Return the values that the work had written last, and delete them, because the work has ended or
        continues."""
        return self._image.claims.left.pop(self, {}) if self._actuators else {}
