"""The procedure of a reactor: what it does in the states of ISA-88."""

from __future__ import annotations

from typing import TYPE_CHECKING

from umo.operation import Procedure

from .recipes import BOOK, Recipe

if TYPE_CHECKING:
    from .control import ChargingLine, Reactor


class Making(Procedure):
    """It makes a batch of its recipe at each start. While it is paused or held, the reactor keeps its temperature, the
    valves are closed, and the charging line waits if it works for this reactor."""

    part: Reactor
    line: ChargingLine

    def __init__(self, part: Reactor) -> None:
        super().__init__(part)
        self.recipe: Recipe = next(iter(BOOK.values()))

    async def execute(self) -> None:
        await self.part.produce(self.recipe, self.line)
        self.produced += 1

    async def pausing(self) -> None:
        self.part.close_valves(self.line)

    async def holding(self) -> None:
        self.part.close_valves(self.line)

    def supervise(self) -> None:
        super().supervise()
        if self.part.in_line is not None:
            self.part.in_line.paused = self.state in self.model.waiting
