"""Message that changes something."""

from __future__ import annotations

from contextlib import suppress

from helpers.written_programs import Program


class MessageThatChangesSomething(Program):
    def bump(self) -> float:
        self.k += 1.0
        return self.k

    def control(self) -> None:
        with suppress(ValueError):
            if self.u > 1.0:
                # refused: it is not proved that the text has no effect and cannot fail: refusals/message_that_changes_something.py:12: self.k += 1.0: it may change something or fail; assign it to a name first
                raise ValueError(f"{self.bump()}")
