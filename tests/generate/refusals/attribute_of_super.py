"""Attribute of super that no class above has."""

from __future__ import annotations

from helpers.written_programs import Program


class AttributeOfSuper(Program):
    def control(self) -> None:
        # refused: no class has this attribute of super(); a method, a property, a number
        self.k = super().gain  # type: ignore[misc]
