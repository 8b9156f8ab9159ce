"""Cached property."""

from __future__ import annotations

from functools import cached_property

from helpers.written_programs import Program


class Helper:
    def __init__(self) -> None:
        self.k = 0.0

    @cached_property
    def once(self) -> float:
        return self.k + 1.0


class WithHelper(Program):
    def begin(self) -> None:
        self.helper = Helper()


class CachedProperty(WithHelper):
    def control(self) -> None:
        self.helper.k = self.u
        # refused: once is a cached_property: it is computed when first read; an attribute, a property or a method
        self.k = self.helper.once
