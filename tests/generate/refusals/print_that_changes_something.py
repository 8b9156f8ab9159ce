"""Print that changes something."""

from __future__ import annotations

from helpers.written_programs import Program


class PrintThatChangesSomething(Program):
    def bump(self) -> float:
        self.k += 1.0
        return self.k

    def control(self) -> None:
        # refused: it is not proved that the text has no effect and cannot fail: refusals/print_that_changes_something.py:10: self.k += 1.0: it may change something or fail; assign it to a name first
        print(self.bump())
