"""Durations of the phases of a period: timer, attempts for each driver that is away, sample of each driver, control
code, update of each driver.

Measuring takes about 0.3 us per transfer, so umo measures only while frames are published (`umo.process.frames`).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial
from time import monotonic_ns
from typing import Any

from umo.cycle.callees import BlockTransfer
from umo.cycle.columns import Block
from umo.cycle.image import Image
from umo.cycle.journal import NO_TRANSFER, Journal, Kind
from umo.cycle.rate_groups import PartGroup
from umo.drivers.contract import Channel, Driver
from umo.errors import ChannelsFailed

UNKNOWN = -1
"""The value in place of an unknown duration."""
CONTROL = "control"
"""The name of the phase of the control code. For a part that does not have the machine's rate, the path of the part
follows."""
TRY = "try"
"""The beginning of the name of a phase in which umo tried a driver that is away. The driver's name follows."""


class PhaseTimes:
    """The measurement on one connected image. `names` are in the order of a period, `ns` has the times of the last
    period."""

    def __init__(self, image: Image, drivers: Mapping[str, Driver[Any]], parts: Sequence[PartGroup] = ()) -> None:
        """`parts`: the parts that do not have the machine's rate."""
        names = {id(driver): name for name, driver in drivers.items()}
        part_of = {block.start: f" for {part.path}" for part in parts for block in (*part.inputs, *part.outputs)}
        inputs = [f"sample {names[id(block.driver)]}{part_of.get(block.start, '')}" for block in image.inputs]
        outputs = [f"update {names[id(block.driver)]}{part_of.get(block.start, '')}" for block in image.outputs]
        slow = [f"{CONTROL} {part.path}" for part in parts]
        used = {id(wire.driver) for slot, wire in enumerate(image.wires) if slot != image.timer}
        tried = [name for name, driver in drivers.items() if id(driver) in used]
        tries = [f"{TRY} {name}" for name in tried]
        self.names = ["timer", *tries, *inputs, CONTROL, *outputs, *slow]
        self._none = [0] * len(self.names)
        self.ns = list(self._none)
        """The duration of each phase in ns. "control" is the rest of the period's time, which was not spent in drivers
        and parts."""
        first = 1 + len(tries)
        self._tries = {name: number for number, name in enumerate(tried, 1)}
        self._control = first + len(inputs)
        self._image, self._parts = image, parts
        for number, part in enumerate(parts, len(self.names) - len(slow)):
            part.took = partial(self.ns.__setitem__, number)
        self._timer = None if image.timer < 0 else image.wires[image.timer].driver
        self._moved: set[int] = set()
        """The blocks that were moved in this period."""
        places = [*enumerate(image.inputs, first)], [*enumerate(image.outputs, self._control + 1)]
        kinds = zip(places, (Kind.READ, Kind.WRITE), strict=True)
        self._places = {block.start: (number, kind) for blocks, kind in kinds for number, block in blocks}
        """The number and the kind of the transfer of each block, by its first slot."""
        image.transfer.callees.watched = self._watched
        image.transfer.bind(image.inputs, image.outputs)
        image.transfer.callees.away.tried = self._tried
        if image.timer >= 0:
            image.transfer.tick = self._timed(image.transfer.tick)
            image.transfer.has_ticked = partial(self.ns.__setitem__, 0)

    def remove(self) -> None:
        """Stop measuring: call the drivers directly again."""
        for part in self._parts:
            part.took = lambda ns: None
        self._image.transfer.callees.watched = lambda block, transfer: transfer
        self._image.transfer.bind(self._image.inputs, self._image.outputs)
        self._image.transfer.callees.away.tried = lambda name, ns: None

    def _tried(self, name: str, ns: int) -> None:
        self.ns[self._tries[name]] += ns

    def finish(self, execution: int) -> None:
        """End the period: the part of its execution time (in ns) that is not measured yet was spent in control code and
        in umo."""
        ns = self.ns
        ns[self._control] = execution - sum(ns) + ns[0]

    def clear(self) -> None:
        """Set all times to 0 before a period, so that a part that is not transferred in this period has the time 0."""
        self.ns[:] = self._none
        self._moved.clear()

    @property
    def wake(self) -> int:
        """Return the time in ns from the tick until the timer woke up; UNKNOWN if the timer has no time grid."""
        ticker = getattr(self._timer, "ticker", None)
        return UNKNOWN if ticker is None else ticker.woke - ticker.due

    def _watched(self, block: Block, transfer: BlockTransfer) -> BlockTransfer:
        """Return a function that makes and times a block's transfer. The first transfer of a period records its
        position in the journal. A repeated transfer records itself, and each object that it has moved."""
        ns, whole, moved = self.ns, self._image.transfer, self._moved
        number, kind = self._places[block.start]
        reads = kind is Kind.READ

        def begins(journal: Journal) -> None:
            moved.add(number)
            if reads:
                if journal.sampled == NO_TRANSFER:
                    journal.sampled = journal.count
            elif journal.updated == NO_TRANSFER:
                journal.updated = journal.count

        def was_moved(took: int) -> None:
            if whole.journal is not None:
                begins(whole.journal)
            ns[number] = took

        def watched(channels: Any, raws: Any) -> None:
            journal = whole.journal
            again = number in moved
            if journal is not None and not again:
                begins(journal)
            elif journal is not None:
                whole.note(block.start, Kind.AGAIN)
            failed: Collection[str] = ()
            began = monotonic_ns()
            try:
                transfer(channels, raws)
            except ChannelsFailed as error:
                failed = error.causes
                again = again and any(channel.text in failed for channel in block.channels)  # else all have failed
                raise
            except BaseException:
                again = False
                raise
            finally:
                ns[number] = monotonic_ns() - began
                if again and journal is not None:
                    _note_block(journal, block, kind, whole.raws, failed)

        block.was_moved = was_moved
        return watched

    def _timed(self, tick: Callable[[Channel], int]) -> Callable[[Channel], int]:
        """Return a function that reads the timer and measures the time of the reading."""
        ns = self.ns

        def timed(channel: Channel) -> int:
            began = monotonic_ns()
            try:
                return tick(channel)
            finally:
                ns[0] = monotonic_ns() - began

        return timed


def _note_block(journal: Journal, block: Block, kind: Kind, raws: Any, failed: Collection[str]) -> None:
    """Add a journal entry for each object that a block has moved. `failed`: the texts of the channels that were not
    moved."""
    for slot, (channel, raw) in enumerate(zip(block.channels, block.view, strict=True), block.start):
        if channel.text not in failed:
            journal.add(slot, kind, raw, raws[slot])
