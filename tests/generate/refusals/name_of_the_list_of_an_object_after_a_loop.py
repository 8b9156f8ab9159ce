"""Which object's list it is depends on where the loop was left."""

from __future__ import annotations

from helpers.written_programs import Program


class ObjectWithAList:
    def __init__(self, value: float) -> None:
        self.row = [value, 1.0]


class NameOfTheListOfAnObject(Program):
    def begin(self) -> None:
        self.rows = ObjectWithAList(0.5), ObjectWithAList(2.0)

    def control(self) -> None:
        for each in self.rows:
            row = each.row
            row[0] += 1.0
            if row[0] > self.u:
                break
        # refused: on some branches it has no value or another object; give it a value first, or use one name per object
        self.k = row[0]
