"""Attribute of a state that is no function."""

from __future__ import annotations

from enum import Enum

from helpers.written_programs import Program


class Mode(Enum):
    OFF = 1
    ON = 2


class AttributeOfAStateThatIsNoFunction(Program):
    def control(self) -> None:
        # refused: the attribute '_sort_order_' of a state cannot be translated; value, name, a method, a property
        self.k = Mode.ON._sort_order_ * 1.0
