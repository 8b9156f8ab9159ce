"""The state of an interlock in a connected machine."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from umo.errors import UmoError
from umo.objects import Compound, Interlock
from umo.objects.interlock import interlocks_of
from umo.text import located, text_of


@dataclass(eq=False)
class Inhibition:
    """One interlock: its actuators, and whether it inhibits them."""

    interlock: Interlock
    slots: list[int]
    """The actuators that it inhibits, in stop order."""
    reason: str | None = None
    """The reason while it inhibits; None: it does not."""
    held: bool = False
    """The last result of its condition."""

    def ask(self) -> bool:
        """Evaluate the condition. True if it starts to inhibit now."""
        before, found = self.reason, _reason(self.interlock)
        self.held = found is not None
        self.reason = before if self.interlock.latched and not self.held else found
        return before is None and self.held

    def acknowledge(self) -> None:
        """Free its actuators, unless its condition is still true."""
        if not self.held:
            self.reason = None


def inhibitions_of(root: Compound, slot_of: Mapping[int, int], order: Sequence[int]) -> list[Inhibition]:
    """Every interlock of a machine, as declared. `slot_of` tells the slot of an object's id, `order` is the stop
    order."""
    found = []
    for interlock in interlocks_of(root):
        slots = {slot_of[id(item)] for item in interlock.actuators()}
        found.append(Inhibition(interlock, [slot for slot in order if slot in slots]))
    return found


def _reason(interlock: Interlock) -> str | None:
    """Why it inhibits now, None if it does not. A condition that cannot be evaluated counts as true."""
    try:
        holds: Any = interlock.condition()
        if holds is False:  # nearly always
            return None
        if not isinstance(holds, bool | np.bool_):  # None, for want of a return, would never forbid
            raise TypeError(f"{holds!r} is not True or False")
        return interlock.reason if holds else None
    except (Exception, SystemExit) as error:
        cause = text_of(error) if isinstance(error, UmoError) else located(error)
        return f"the condition {interlock.reason!r} cannot be evaluated: {cause}"
