"""The conditions of a machine's interlocks, compiled with its laws.

They are compared with Python's first, as laws are. Where a compiled condition has a fault, Python's is evaluated: it
raises its own error. A condition that changes something, or that looks at other interlocks, stays in Python, and so do
the others.
"""

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
    "umo_inhibited": "looks at interlocks, which are evaluated one after the other",
    "umo_digital_write": WRITES,
    "umo_binary_write": WRITES,
    "umo_write_many": WRITES,
    ASSIGNS: CHANGES,
}
"""What a condition would not do in C as in Python, by its effects."""
Asked = Callable[[], Any]


def only_in_python(translation: Translation, conditions: Sequence[Asked]) -> str:
    """Why translated conditions stay in Python; empty: they need not."""
    if translation.problems:
        return str(translation.problems[0]) if translation.refused_conditions else ""
    effects = set[str | int]().union(*(translation.effects[translation.entry[each].name] for each in conditions))
    told = {number for number, each in enumerate(translation.tellers) if each.field is not None}
    what = [what for effect, what in ONLY_PYTHON.items() if effect in effects]
    return f"one {[*what, CHANGES][0]}" if what or effects & told else ""


class CompiledConditions:
    """The compiled conditions of one connected machine. In the library they have the numbers from `first` on."""

    def __init__(
        self, library: LawLibrary, first: int, inhibitions: Sequence[Inhibition], clock: Clock, compared: int, why: str
    ) -> None:
        """`compared`: periods in which they are compared. Without inhibitions there are none; `why`: the reason."""
        self._library, self._first, self._clock = library, first, clock
        self._inhibitions = inhibitions
        self._native: list[Any] = []
        self._look: Callable[[], bool] = lambda: True
        self.left = compared if inhibitions else 0
        """Periods in which they are still to be compared."""
        self.left_out = why
        """Why they stay in Python; empty: they do not, or there are none."""

    def compare(self) -> None:
        """Whether they give what Python gives at this moment; a difference leaves them to Python. The fields of the
        library have their values."""
        self.left -= 1
        for number, each in enumerate(self._inhibitions, self._first):
            found, error = attempt(each.interlock.condition)
            fault = self._library.call(number, self._clock)
            if fault <= 0 if error is not None else fault != (TRUE if found else 0):
                self.left_out = f"the condition {each.interlock.reason!r} is not the same in C"
                self._inhibitions, self.left = (), 0
                return

    def use(self) -> None:
        """The compiled conditions are evaluated from now on."""
        for number, each in enumerate(self._inhibitions, self._first):
            each.condition = self._compiled(number, each.interlock.condition)

    def look_first(self, look: Callable[[], bool]) -> None:
        """`look` tells, before the first of them, whether they are still right; if not, it has given them back to
        Python."""
        self._look = look
        if self._native:
            self._native[0].guard(look)

    def release(self) -> None:
        """Python's are evaluated from now on."""
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
