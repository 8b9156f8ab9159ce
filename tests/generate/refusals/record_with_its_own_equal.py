"""Record with its own equal."""

from __future__ import annotations

from typing import NamedTuple

from helpers.written_programs import Program


class Counted(NamedTuple):
    count: int

    def __eq__(self, other: object) -> bool:
        return False

    __hash__ = None  # type: ignore[assignment]


class RecordWithItsOwnEqual(Program):
    def control(self) -> None:
        # refused: Counted changes the behaviour of a tuple; a NamedTuple with fields only
        one, other = Counted(self.n), Counted(1)
        self.c = int(one == other)
