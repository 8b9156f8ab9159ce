"""Attribute of super."""

from __future__ import annotations

from helpers.written_programs import Program


class Base(Program):
    gain = 2.0


class AttributeOfSuper(Base):
    def control(self) -> None:
        # refused: an attribute of super() that is no method; a method
        self.k = super().gain()
