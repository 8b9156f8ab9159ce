"""The state of an interlock, or of a fault of equipment, in a connected machine."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from math import inf
from typing import Any

import numpy as np

from umo.errors import DeclarationError
from umo.objects import Compound, Interlock
from umo.objects.paths import atoms, walk
from umo.user_code import briefly, raise_as, told

QUIET_TIME = 600.0
"""Time in s without a beginning after which the beginnings of an interlock are counted anew."""
MAX_RESULT_TEXT = 100
"""Largest length of a wrong result of a condition in its message, in characters."""


@dataclass(eq=False)
class Inhibition:
    """One interlock, or the fault of one equipment, with its actuators. `reason` is not None while the actuators are
    inhibited."""

    interlock: Interlock
    slots: list[int]
    """The actuators that the interlock inhibits, in stop order."""
    reason: str | None = None
    """The reason; None while the actuators are not inhibited."""
    held: bool = False
    """The last result of the condition."""
    condition: Callable[[], Any] = field(init=False)
    """The function that is evaluated: the condition of the interlock, or its compiled form."""
    _latched: bool = False
    """True if the interlock inhibits until it is acknowledged."""
    _begun: int = 0
    """Number of the last beginnings, with less than `QUIET_TIME` between them."""
    _last_begun: float = -inf
    """Time of the last beginning in s."""

    def __post_init__(self) -> None:
        self.condition = self.interlock.condition
        self._known = self.interlock.reason, latched(self.interlock)
        self._unevaluated = unevaluated(self.interlock)

    def ask(self, latch: bool) -> bool:
        """Evaluate the condition. Return True if the interlock now starts to inhibit. `latch`: whether a latched
        interlock stays latched from now on."""
        before, found = self.reason, None
        try:
            holds = self.condition()  # not by `attempt`: there may be a thousand
            if holds is False and before is None:  # nearly always
                self.held = False
                return False
            found = _reason(self.interlock, holds)
        except BaseException as error:
            found = _cannot(self.interlock, told(error).text)
        self.held = found is not None
        self._latched = self._latched or (self.held and latch and self.interlock.latched)
        self.reason = latched(self.interlock) if self._latched and not self.held else found
        return before is None and self.held

    def count(self, now: float) -> int:
        """Count a beginning at a time in s. Return the number of beginnings so far with less than `QUIET_TIME` between
        them."""
        self._begun = self._begun + 1 if now - self._last_begun < QUIET_TIME else 1
        self._last_begun = now
        return self._begun

    @property
    def reason_key(self) -> str:
        """The reason, without the error text if a condition cannot be evaluated. Each interlock therefore has only a
        few different keys."""
        return self.reason if self.reason in self._known else self._unevaluated

    @property
    def cause(self) -> str:
        """The reason why the condition cannot be evaluated; empty if it can be evaluated."""
        if self.reason is None or self.reason == self.interlock.reason:
            return ""
        start = f"{self._unevaluated}: "
        return self.reason.removeprefix(start) if self.reason.startswith(start) else ""

    def acknowledge(self) -> None:
        """Free the actuators, unless the condition is still true."""
        if not self.held:
            self.reason, self._latched = None, False


def inhibitions_of(root: Compound, slot_of: Mapping[int, int], order: Sequence[int]) -> list[Inhibition]:
    """Return every interlock of a machine, as declared. `slot_of` maps the id of an object to its slot, `order` is the
    stop order."""
    place = {slot: number for number, slot in enumerate(order)}
    found = []
    for interlock in interlocks_of(root):
        slots = {slot_of[id(item)] for item in interlock.actuators()}
        found.append(Inhibition(interlock, sorted(slots, key=place.__getitem__)))
    return found


def _reason(interlock: Interlock, holds: Any) -> str | None:
    """Return why the interlock inhibits now, or None. A result that is not a bool also inhibits, for example None from
    a function without a return."""
    if isinstance(holds, bool | np.bool_):
        return interlock.reason if holds else None
    return _cannot(interlock, f"it gives {briefly(holds, MAX_RESULT_TEXT)}, which is not True or False")


def latched(interlock: Interlock) -> str:
    """Return the reason of a latched interlock whose condition is false again."""
    return f"{interlock.reason} (latched: acknowledge it)"


def unevaluated(interlock: Interlock) -> str:
    """Return the reason of an interlock whose condition cannot be evaluated."""
    return f"the condition {interlock.reason!r} cannot be evaluated"


def _cannot(interlock: Interlock, cause: str) -> str:
    return f"{unevaluated(interlock)}: {cause}"


def interlocks_of(root: Compound) -> list[Interlock]:
    """Return every interlock of a machine, as declared. Raises DeclarationError for an object that is not an interlock,
    and for an interlock that forbids objects of another machine."""
    return [interlock for _, interlock in owned_interlocks(root)]


def owned_interlocks(root: Compound) -> list[tuple[Compound, Interlock]]:
    """Return every interlock with the compound that declares it."""
    own = set(map(id, atoms(root)))
    compounds = (node for node in (root, *walk(root)) if isinstance(node, Compound))
    declaring = (node for node in compounds if _declares(node))
    found = [(node, each) for node in declaring for each in _declared_by(node)]
    for _, interlock in found:
        for item in interlock.actuators():
            if id(item) not in own:
                raise DeclarationError(f"interlock {interlock.reason!r} forbids {item!r} of another machine")
    return found


def _declares(node: Compound) -> bool:
    return type(node).interlocks is not Compound.interlocks or "interlocks" in vars(node)


def _declared_by(node: Compound) -> list[Interlock]:
    with raise_as(DeclarationError, f"{node._path or type(node).__name__}.interlocks failed"):
        declared = node.interlocks()
        each = list(declared) if isinstance(declared, Iterable) else [declared]
    for interlock in each:
        if not isinstance(interlock, Interlock):
            owner = node._path or type(node).__name__
            raise DeclarationError(f"{owner}.interlocks gives {interlock!r}; it must return or yield Interlocks")
    return each
