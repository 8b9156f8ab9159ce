"""The whole period of a machine with compiled laws in C (`umo/cycle/period.c`), where nothing of it needs Python.

A phase is in C where all that it has is there: the driver's transfers (`MovesInC`), plain conversions, compiled
conditions and laws. `looks` say what else it rests on, for each phase; where one of them is not as usual, Python
carries the phase out in this period, by the same function as without this. Python also does what is called in COMMANDS
and SHOW.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from functools import partial
from types import MethodType
from typing import Any, NamedTuple

from umo.cycle.capability import Capability
from umo.cycle.columns import Block
from umo.cycle.conversion import extension
from umo.cycle.events import Event
from umo.cycle.machine import ConnectedMachine
from umo.cycle.part_periods import PartPeriods
from umo.cycle.period import or_guard
from umo.drivers.optional import TransferInC, transfer_in_c
from umo.generate import compiled_laws
from umo.text import some

IS, IS_NOT, EMPTY, NOTHING_IN = range(4)
"""Kinds of looks, as in period.c."""
PhaseLook = tuple[object, str, int, object]
MOST = 1_000
"""Periods in C after which Python looks, also where nothing has come in."""
NOT_COMPILED = "they are not compiled"
NO_TICK = (*(0,) * 8, None)
"""What period.c takes of a timer that Python reads."""
PHASES = "TICK", "SAMPLE", "GUARD", "COMMANDS", "SEQUENCES", "LAWS", "SETTLE", "SEND", "SHOW"
"""The phases that period.c knows, in their order (`umo.cycle.period.PHASES`)."""


def nothing_in(container: object) -> PhaseLook:
    """Of a list or a set that is never replaced by another one."""
    return container, "", NOTHING_IN, None


class Moved(NamedTuple):
    """A block that is moved and converted in C: what period.c takes of it."""

    native: Any
    function: int
    context: int
    watch: Callable[[int], object] | None


def _is_there(block: Block, write: bool) -> bool:
    """Whether it is the driver itself that is called."""
    return block.unwatched == (block.driver.write_many if write else block.driver.read_many)


class PeriodInC(Capability):
    """Carries out the periods of one machine: `several` in the place of the standard loop's calls."""

    def __init__(self) -> None:
        self.reasons: dict[str, str] = {}
        """Why a phase is carried out by Python in each period, by its name."""
        self._native: Any = None
        self._is_told = False
        self._awaited: list[Callable[[], bool]] = []
        """Tell whether a driver that was away is back."""
        self._kept: list[Any] = []

    def attach(self, machine: ConnectedMachine) -> None:
        self._machine, self._image, self._period = machine, machine.image, machine.phases
        self._group, self._parts = machine.acting_laws.whole, machine.find(PartPeriods)
        self._laws: list[MethodType] = []
        if why := self._unfit():
            self._say(f"the period is carried out by Python: {why}")
        else:
            self._period.several = self.several

    def _say(self, text: str, *, logged: bool = True) -> None:
        self._machine.events.add(Event(self._machine.clock.now, "", text), logged=logged)

    def _unfit(self) -> str:
        """Why no period of this machine can be in C; empty if it can."""
        period = self._period
        if extension is None or sys.platform == "win32":
            return "the extension in C was not built"
        if self._image.timer < 0:
            return "it has no timer"
        if period.late:
            return 'its outputs wait for the next tick (`outputs = "at next tick"`)'
        if period.before_tick or period.receiving or period.before_send:
            return "it has drivers off the cycle"
        return ""

    # A period ------------------------------------------------------------------------------------------

    def several(self) -> int:
        """Carry out the next period, or several; how many. 0: a stop has ended the wait for a tick."""
        return self.run(MOST, None)

    def run(self, most: int, rows: Any) -> int:
        """The same, at most so many. `rows`: memory for three int64 of each: the ticks missed, and when it began and
        ended, in ns of the monotonic clock."""
        native = self._native
        if native is None or native.stale or self._laws is not self._group.laws or self._is_back():
            native = self._bind()
        found: int = native.run(most, rows)
        return found

    def _is_back(self) -> bool:
        return bool(self._awaited) and any(is_back() for is_back in self._awaited)

    def _bind(self) -> Any:
        self.reasons, self._kept, self._awaited, self._laws = {}, [], [], self._group.laws
        inputs, outputs = self._moved(self._group.inputs, False), self._moved(self._group.outputs, True)
        conditions, acting = self._conditions(), self._acting()
        tick = self._tick(is_all_in_c=inputs is not None and outputs is not None)
        looks = {
            "TICK": self._of_tick() if tick else None,
            "SAMPLE": None if inputs is None else [*self._of_inputs()],
            "GUARD": None if conditions is None else [*self._of_guards()],
            "COMMANDS": [nothing_in(self._period.commanding)],
            "SEQUENCES": [(self._machine.sequences, "_tasks", EMPTY, None)],
            "LAWS": None if acting is None else [(self._machine.acting_laws, "stale", EMPTY, None)],
            "SETTLE": [] if self._parts else [(self._period, "settling", EMPTY, None)],
            "SEND": None if outputs is None else [*self._of_outputs()],
            "SHOW": [
                nothing_in(self._period.observers),
                nothing_in(self._period.showing),
                (self._image.events, "untold", EMPTY, None),
            ],
        }
        self._native = extension.Period(
            self._machine.clock,
            self._period,
            self._machine.sequences.current,
            self._group,
            tick or NO_TICK,
            self._machine.clock.period,
            tuple(None if (each := looks[name]) is None else tuple(each) for name in PHASES),
            self._calls(),
            tuple(inputs or ()),
            tuple(outputs or ()),
            tuple(conditions or ()),
            tuple(self._laws if acting is not None else ()),
            tuple(acting or ()),
            self._image.columns.written.data,
        )
        self._tell()
        return self._native

    def _tell(self) -> None:
        """Once, when C drives: what of the period Python carries out."""
        if self._is_told or self.reasons.get("LAWS") == NOT_COMPILED:
            return
        self._is_told = True
        left = "; ".join(f"{phase} ({why})" for phase, why in self.reasons.items())
        self._say(f"the period is carried out in C{f', but by Python: {left}' if left else ''}", logged=bool(left))

    def _calls(self) -> tuple[Callable[..., object], ...]:
        """What Python does, in the order of period.c."""
        period, machine, image = self._period, self._machine, self._image
        evaluate = period.guards.evaluate
        return (
            lambda: image.read_now(image.timer),
            image.ticked,
            lambda: or_guard(period.read, evaluate),
            evaluate,
            machine.sequences.advance,
            period.act,
            machine.acting_laws.act,
            period.settle,
            period.update,
            period.finish,
        )

    # TICK ----------------------------------------------------------------------------------------------

    def _tick(self, is_all_in_c: bool) -> tuple[Any, ...] | None:
        """What period.c takes of the timer; None: Python reads it. `is_all_in_c`: whether it moves all blocks."""
        image, slot = self._image, self._image.timer
        wire = image.wires[slot]
        found = transfer_in_c(wire.driver, (wire.channel,), False) if is_all_in_c else "it warms the caches for that"
        found = self._unless_away(found, self._is_ticking)
        if isinstance(found, str):
            self.reasons["TICK"] = found
            return None
        self._kept.append(found.keep)
        columns = image.columns
        places = (column.ctypes.data + 8 * slot for column in (columns.raws, columns.values, columns.times))
        of_image = (*places, columns.quality.ctypes.data + slot)
        limits = image._least_ticks, image._most_ticks
        return found.function, found.context, *limits, *of_image, image.transfer.has_ticked

    def _is_ticking(self) -> bool:
        """Whether nothing else is called at the tick, as it is while a driver is away."""
        transfer, slot = self._image.transfer, self._image.timer
        is_read = transfer.has_ticked is not None or transfer.tick == self._image.wires[slot].driver.read
        return is_read and self._machine.clock.on_tick == self._period.on_tick

    def _unless_away(self, found: TransferInC | str, is_there: Callable[[], bool]) -> TransferInC | str:
        if isinstance(found, str) or is_there():
            return found
        self._awaited.append(is_there)
        return "a driver is away"

    def _of_tick(self) -> list[PhaseLook]:
        transfer, clock = self._image.transfer, self._machine.clock
        return [
            (self._machine.stop, "requested", EMPTY, None),
            (self._period, "open", EMPTY, None),
            (transfer, "tick", IS, transfer.tick),
            (clock, "on_tick", IS, clock.on_tick),
        ]

    # SAMPLE, SEND --------------------------------------------------------------------------------------

    def _moved(self, blocks: list[Block], write: bool) -> list[Moved] | None:
        """These blocks, as C moves and converts them; None: Python does."""
        moved = list[Moved]()
        for block in blocks:
            native = getattr(block.give if write else block.convert, "__self__", None)
            found = transfer_in_c(block.driver, block.channels, write)
            found = self._unless_away(found, partial(_is_there, block, write))
            if not isinstance(native, extension.Outputs if write else extension.Inputs):
                found = "its values are not only scaled"
            if isinstance(found, str):
                self.reasons["SEND" if write else "SAMPLE"] = f"{self._image.transfer.words_of(block.driver)}: {found}"
                return None
            self._kept.append(found.keep)
            moved.append(Moved(native, found.function, found.context, block.was_moved))
        return moved

    def _of_inputs(self) -> Iterator[PhaseLook]:
        yield self._image, "sampled_good", IS_NOT, None
        if self._parts is not None:
            yield self._parts, "sampled", EMPTY, None
        for block in self._group.inputs:
            yield block, "transfer", IS, block.transfer
            yield block, "convert", IS, block.convert
            yield nothing_in(block.unsettled)

    def _of_outputs(self) -> Iterator[PhaseLook]:
        if self._parts is not None:  # what of them is due follows in the same call
            yield self._parts, "any_due", EMPTY, None
            yield self._parts, "sampled", EMPTY, None
        for block in self._group.outputs:
            yield block, "transfer", IS, block.transfer
            yield block, "give", IS, block.give
            yield nothing_in(block.unsettled)

    # GUARD, LAWS ---------------------------------------------------------------------------------------

    def _conditions(self) -> list[Any] | None:
        """The conditions of the interlocks, compiled; None: Python asks them."""
        guards, machine = self._period.guards, self._machine
        if not guards.any:
            return []
        if guards._expiring:
            paths = [self._image.items[each.slot].path for each in guards._expiring]
            self.reasons["GUARD"] = f"commands expire: {some(paths)}"
            return None
        found = [getattr(each.condition, "__self__", None) for each in machine.claims.inhibitions]
        if all(isinstance(each, extension.Law) for each in found):
            return found
        self.reasons["GUARD"] = "conditions of interlocks are not compiled"
        return None

    def _of_guards(self) -> Iterator[PhaseLook]:
        guards = self._period.guards
        yield nothing_in(self._image.owed)
        yield guards, "_inhibiting", EMPTY, None
        for each in self._machine.claims.inhibitions:
            yield each, "condition", IS, each.condition

    def _acting(self) -> list[Any] | None:
        """The laws, compiled; None: Python calls them."""
        functions = [law.__func__ for law in self._laws]
        found = [getattr(each, "__self__", None) for each in functions]
        if all(isinstance(each, extension.Law) for each in found):
            return found
        laws = self._machine.find(compiled_laws.CompiledLaws)
        has_deques = laws is not None and laws.state == "compiled" and laws.has_deques
        self.reasons["LAWS"] = "Python has the elements of their deques, too" if has_deques else NOT_COMPILED
        return None
