"""Descriptor that is set."""

from __future__ import annotations

from typing import Any

from helpers.written_programs import Program


class Descriptor:
    def __get__(self, owner: Any, kind: Any = None) -> float:
        return 3.0 if owner is None else 2.0 * owner.u

    def __set__(self, owner: Any, value: float) -> None:
        owner.u = value + 1.0


class DescriptorThatIsSet(Program):
    level = Descriptor()

    def control(self) -> None:
        # refused: level is a Descriptor, a user-defined descriptor; the attribute belongs to another object
        self.level = 2.0
