"""The conditions of a machine's interlocks, compiled with its laws.

Like those of laws, the results of compiled conditions are first compared with those of Python. If a compiled condition
has a fault, Python evaluates the condition again and raises the error. If a condition changes something or reads other
interlocks, all conditions stay in Python."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from umo.cycle.clock import Clock
from umo.cycle.conversion import extension
from umo.cycle.inhibition import Inhibition
from umo.generate.check.form_effects import ASSIGNS
from umo.generate.law_library import TRUE, LawLibrary
from umo.generate.translation import Translation
from umo.user_code import attempt

WRITES, CHANGES = "writes", "changes an attribute"
ONLY_PYTHON = {
    "umo_inhibited": "reads interlocks, which are evaluated in order",
    "umo_digital_write": WRITES,
    "umo_binary_write": WRITES,
    "umo_write_many": WRITES,
    ASSIGNS: CHANGES,
}
"""Reasons why a condition behaves differently in C, by its effects."""
Asked = Callable[[], Any]


def only_in_python(translation: Translation, conditions: Sequence[Asked]) -> str:
    """Return the reason why translated conditions stay in Python; empty if there is none."""
    if translation.problems:
        return str(translation.problems[0]) if translation.refused_conditions else ""
    effects = set[str | int]().union(*(translation.effects[translation.entry[each].name] for each in conditions))
    told = {number for number, each in enumerate(translation.text_makers) if each.field is not None}
    what = [what for effect, what in ONLY_PYTHON.items() if effect in effects]
    return f"one {[*what, CHANGES][0]}" if what or effects & told else ""


class CompiledConditions:
    """The compiled conditions of one connected machine. The numbers of the conditions in the library begin at
    `first`."""

    def __init__(
        self, library: LawLibrary, first: int, inhibitions: Sequence[Inhibition], clock: Clock, compared: int, why: str
    ) -> None:
        """`compared`: the number of periods in which the conditions are compared. Without `inhibitions` there are no
        compiled conditions, and `why` is the reason."""
        self._library, self._first, self._clock = library, first, clock
        self._inhibitions = inhibitions
        self._native: list[Any] = []
        self._look: Callable[[], bool] = lambda: True
        self.left = compared if inhibitions else 0
        """The number of periods in which the conditions are still compared."""
        self.left_out = why
        """Why the conditions stay in Python; empty if they are compiled or there are none."""

    def compare(self) -> None:
        """Compare the present results with those of Python. If they differ, Python continues to evaluate the
        conditions. The fields of the library must be up to date."""
        self.left -= 1
        for number, each in enumerate(self._inhibitions, self._first):
            found, error = attempt(each.interlock.condition)
            fault = self._library.call(number, self._clock)
            if fault <= 0 if error is not None else fault != (TRUE if found else 0):
                self.left_out = f"the condition {each.interlock.reason!r} is not the same in C"
                self._inhibitions, self.left = (), 0
                return

    def use(self) -> None:
        """Evaluate the compiled conditions from now on."""
        for number, each in enumerate(self._inhibitions, self._first):
            each.condition = self._compiled(number, each.interlock.condition)

    def look_first(self, look: Callable[[], bool]) -> None:
        """Call `look` before the first condition. `look` returns True if the compiled conditions are still valid.
        Otherwise it has called `release`."""
        self._look = look
        if self._native:
            self._native[0].guard(look)

    def release(self) -> None:
        """Evaluate the conditions in Python from now on."""
        for each in self._inhibitions:
            each.condition = each.interlock.condition

    def _compiled(self, number: int, condition: Asked) -> Asked:
        native = getattr(extension, "Law", None)
        if native is not None:
            self._native.append(native(*self._library.addresses, number, self._clock, lambda fault: condition()))
            found: Asked = self._native[-1].holds
            return found

        def holds() -> Any:
            if number == self._first and not self._look():
                return condition()
            fault = self._library.call(number, self._clock)
            return fault == TRUE if fault in (0, TRUE) else condition()

        return holds
