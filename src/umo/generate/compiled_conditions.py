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
from umo.generate.law_library import BESIDE_PYTHON, TRUE, LawLibrary
from umo.generate.translation import Translation
from umo.generate.translator import translate
from umo.objects import Compound
from umo.user_code import attempt

WRITES = "writes"
ONLY_PYTHON = {
    "umo_inhibited": "looks at interlocks, which are evaluated one after the other",
    "umo_digital_write": WRITES,
    "umo_binary_write": WRITES,
    "umo_write_many": WRITES,
}
"""What a condition would not do in C as in Python, by the function of the runtime."""
Asked = Callable[[], Any]


def translated_conditions(
    root: Compound, conditions: Sequence[Asked], laws: Sequence[Asked], without: Translation
) -> tuple[Translation | None, str]:
    """The translation of laws and conditions; None, and why: the conditions stay in Python. `without` is that of the
    laws alone."""
    if not conditions:
        return None, ""
    found = translate(root, conditions, laws, BESIDE_PYTHON)
    if found.problems:
        return None, str(found.problems[0])
    for call, what in ONLY_PYTHON.items():
        if found.calls.get(call, 0) > without.calls.get(call, 0):
            return None, f"one {what}"
    if _states(found) != _states(without) or _texts(found) != _texts(without):
        return None, "one changes an attribute"
    return found, ""


def _states(translation: Translation) -> set[tuple[str, str]]:
    return {(each.path, each.name) for each in translation.layout if each.owner == "STATE"}


def _texts(translation: Translation) -> set[tuple[int, str]]:
    """The attributes that texts are assigned to."""
    return {(id(each.field[0]), each.field[1]) for each in translation.tellers if each.field is not None}


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
