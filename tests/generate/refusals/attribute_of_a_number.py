"""An attribute of a number is set."""

from __future__ import annotations

from typing import Any

from helpers.written_programs import Program


class AttributeOfANumber(Program):
    def control(self) -> None:
        value: Any = self.u
        # refused: the object of this attribute is not known when the code is generated
        value.other = 1.0
