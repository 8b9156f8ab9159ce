"""The state of each actuator during a reset, in memory that the guardian shares with the child process that resets.

The child writes and the guardian reads this memory, so that no pipe or message between the two can be full or broken.
"""

from __future__ import annotations

import mmap
from collections.abc import Sequence
from enum import IntEnum

from umo.system import calls

BEAT, AT, DEAD = range(3)
HEADER = 64
CAUSE_BYTES = 300
"""Size in bytes for the cause of a failure."""
CAUSE_ENTRY = 1 + CAUSE_BYTES


class Reached(IntEnum):
    """The result of an attempt for an actuator."""

    UNTRIED = 0
    ONCE = 1
    """The actuator was reset. It is reset again, because a pending request may have undone the reset. If the second
    attempt does not end, the actuator counts as reached."""
    YES = 2
    NO = 3


class ResetState:
    """The state of each actuator, by number."""

    def __init__(self, paths: Sequence[str]) -> None:
        self.paths = list(paths)
        self._memory = mmap.mmap(-1, HEADER + CAUSE_ENTRY * max(len(paths), 1))  # anonymous and shared
        self._cells = memoryview(self._memory)[:HEADER].cast("q")
        self.clear()

    def clear(self) -> None:
        """Clear the states before an attempt, except `dead`."""
        for number in range(len(self.paths)):
            self._memory[HEADER + number * CAUSE_ENTRY] = Reached.UNTRIED
        self.begin(-1)

    # The child -----------------------------------------------------------------------------------------

    def beat(self) -> None:
        self._cells[BEAT] = calls.boottime_ns()

    def begin(self, number: int) -> None:
        """Record that a call for this actuator begins; -1 for no actuator."""
        self._cells[AT] = number
        self.beat()

    def note(self, number: int, reached: Reached, cause: str = "") -> None:
        at = HEADER + number * CAUSE_ENTRY
        text = cause.encode(errors="replace")[:CAUSE_BYTES]
        self._memory[at + 1 : at + CAUSE_ENTRY] = text.ljust(CAUSE_BYTES, b"\0")
        self._memory[at] = reached

    @property
    def dead(self) -> bool:
        """True if the old control process has certainly ended."""
        return bool(self._cells[DEAD])

    # The guardian --------------------------------------------------------------------------------------

    def declare_dead(self) -> None:
        self._cells[DEAD] = 1

    @property
    def silence(self) -> float:
        """Time in s since the last call began."""
        return (calls.boottime_ns() - self._cells[BEAT]) * 1e-9

    @property
    def at(self) -> int:
        """The actuator whose call began last; -1 for none."""
        return int(self._cells[AT])

    def reached(self, number: int) -> Reached:
        return Reached(self._memory[HEADER + number * CAUSE_ENTRY])

    def cause(self, number: int) -> str:
        at = HEADER + number * CAUSE_ENTRY
        return bytes(self._memory[at + 1 : at + CAUSE_ENTRY]).rstrip(b"\0").decode(errors="replace")
