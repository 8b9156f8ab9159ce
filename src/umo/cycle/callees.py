"""The targets of calls of drivers: the driver, or a stand-in while the driver is away (`drivers_away.py`)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, NoReturn

from umo.cycle.columns import Block
from umo.cycle.stand_ins import NobodyAway
from umo.drivers.contract import Driver
from umo.errors import DriverError
from umo.objects.scaling import IntArray
from umo.wiring.wired import Wire

BlockTransfer = Callable[[Any, IntArray], None]


def refuse_write(*_: object) -> NoReturn:
    raise DriverError("the machine has been reset; nothing is written any more")


class Callees:
    """The driver, or its stand-in, that gets the calls of each object and of each block."""

    def __init__(self, wires: Sequence[Wire]) -> None:
        self.of: Any = [wire.driver for wire in wires]
        """The callee of each object, by slot."""
        self.slots: dict[int, list[int]] = {}
        """The objects of each driver, by its id."""
        for slot, wire in enumerate(wires):
            self.slots.setdefault(id(wire.driver), []).append(slot)
        self.away = NobodyAway()
        self.written = True
        """True if writes are carried out."""
        self.watched: Callable[[Block, BlockTransfer], BlockTransfer] = lambda block, call: call
        """Function that wraps a block's transfer to watch it."""
        self._blocks: list[Block] = []
        self._outputs: list[Block] = []

    def bind(self, inputs: Iterable[Block], outputs: Iterable[Block]) -> None:
        """Set the `transfer` of each block to the transfer of its driver or of the stand-in."""
        self._outputs = list(outputs)
        self._blocks = [*inputs, *self._outputs]
        for block in self._blocks:
            self._bind(block)

    def _bind(self, block: Block) -> None:
        callee = self.of[block.start]
        if block not in self._outputs:
            block.unwatched = callee.read_many
        else:
            block.unwatched = callee.write_many if self.written else refuse_write
        block.was_moved = None
        block.transfer = self.watched(block, block.unwatched)

    def exchange(self, driver: Driver[Any], callee: Any) -> None:
        """Let calls of this driver go to `callee` from now on."""
        for slot in self.slots.get(id(driver), ()):
            self.of[slot] = callee
        for block in self._blocks:
            if block.driver is driver:
                self._bind(block)

    def end_writing(self) -> None:
        """Let no write reach a driver any more, except resets."""
        self.written = False
        for block in self._outputs:
            block.transfer = block.unwatched = refuse_write

    def end_absences(self) -> None:
        """Let every call reach its driver again and wait for the device, because the machine stops."""
        self.away.end()
        self.away = NobodyAway()

    def refuse(self, instead: Callable[..., NoReturn]) -> None:
        """Replace every call of a block's transfer, and every look, by `instead`, so that no call reaches a driver any
        more."""
        self.slots = {}
        self.away.refuse(instead)
        for block in self._blocks:
            block.transfer = block.unwatched = instead
