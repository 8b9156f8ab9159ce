"""Cached function."""

from __future__ import annotations

import functools

from helpers.written_programs import Program


class CachedFunction(Program):
    @functools.lru_cache  # noqa: B019
    def scaled(self, number: float) -> float:
        return number + self.k

    def control(self) -> None:
        # refused: scaled is a _lru_cache_wrapper, a user-defined descriptor; an attribute, a property or a method
        self.k = self.scaled(1.0)
