"""Carries out the period of a machine with compiled laws in C (`umo/cycle/period.c`), as far as the period does not
need Python.

A phase runs in C if all its parts exist in C: the driver's transfers (`MovesInC`), plain conversions, compiled
conditions and laws. `looks` are the further conditions for each phase. If one is not met, Python carries out the phase
in this period, with the functions that are also used without compilation. Python also carries out everything that is
called in COMMANDS and SHOW."""

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
from umo.drivers.optional import transfer_in_c
from umo.generate import compiled_laws
from umo.text import some

IS, IS_NOT, EMPTY, NOTHING_IN = range(4)
"""Kinds of checks, as in period.c."""
PhaseLook = tuple[object, str, int, object]
MOST = 1_000
"""Number of periods in C after which Python makes its checks, even if nothing has arrived."""
NOT_COMPILED = "the laws are not compiled"
AWAY = "a driver is away"
NO_TICK = (*(0,) * 8, None, None, None)
"""The data for period.c if Python reads the timer."""
PHASES = "TICK", "SAMPLE", "GUARD", "COMMANDS", "SEQUENCES", "LAWS", "SETTLE", "SEND", "SHOW"
"""The phases that period.c knows, in their order (`umo.cycle.period.PHASES`)."""


def nothing_in(container: object) -> PhaseLook:
    """Return the check that a list or a set is empty. The list or set must never be replaced by another one."""
    return container, "", NOTHING_IN, None


class Moved(NamedTuple):
    """The data that period.c needs about a block. The block is converted in C, and transferred in C or by a call of the
    driver."""

    native: Any
    function: int
    context: int
    watch: Callable[[int], object] | None
    call: Callable[[Any, Any], object] | None
    """The driver's block transfer in Python, or None if C moves it."""
    channels: Any
    buffer: Any


def _is_there(block: Block, write: bool) -> bool:
    """True if the driver itself is called."""
    return block.unwatched == (block.driver.write_many if write else block.driver.read_many)


class PeriodInC(Capability):
    """Carries out the periods of one machine. The loop calls `several` in place of its own steps."""

    def __init__(self) -> None:
        self.reasons: dict[str, str] = {}
        """Why Python carries out a phase in each period, by its name."""
        self.drivers: dict[str, str] = {}
        """Why the block transfers of a driver are calls of Python, by its name."""
        self._native: Any = None
        self._is_told = False
        self._awaited: list[Callable[[], bool]] = []
        """Functions that return True if a driver that was away is back."""
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
        """Return why no period of this machine can run in C; empty if periods can."""
        period = self._period
        if extension is None or sys.platform == "win32":
            return "the extension in C was not built"
        if self._image.timer < 0:
            return "the machine has no timer"
        if period.late:
            return 'the outputs wait for the next tick (`outputs = "at next tick"`)'
        if period.before_tick or period.receiving or period.before_send:
            return "the machine has drivers off the cycle"
        return ""

    # A period ------------------------------------------------------------------------------------------

    def several(self) -> int:
        """Carry out the next one or more periods, and return their number. 0 means that a stop has ended the wait for a
        tick."""
        return self.run(MOST, None)

    def run(self, most: int, rows: Any) -> int:
        """Carry out at most `most` periods, and return their number. `rows` is memory for three int64 per period:
        missed ticks, and the begin and the end in ns of the monotonic clock."""
        native = self._native
        if native is None or native.stale or self._laws is not self._group.laws or self._is_back():
            native = self._bind()
        found: int = native.run(most, rows)
        return found

    def _is_back(self) -> bool:
        return bool(self._awaited) and any(is_back() for is_back in self._awaited)

    def _bind(self) -> Any:
        self.reasons, self.drivers, self._kept, self._awaited, self._laws = {}, {}, [], [], self._group.laws
        inputs, outputs = self._moved(self._group.inputs, False), self._moved(self._group.outputs, True)
        conditions, acting = self._conditions(), self._acting()
        tick = self._tick(is_all_in_c=inputs is not None and outputs is not None and not self.drivers)
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
        """Print once which parts of the period Python carries out."""
        if self._is_told or self.reasons.get("LAWS") == NOT_COMPILED:
            return
        self._is_told = True
        drivers = {f"the transfers of {name}": why for name, why in self.drivers.items()}
        left = "; ".join(f"{what} ({why})" for what, why in (self.reasons | drivers).items())
        rest = f"; Python still carries out {left}" if left else ""
        self._say(f"the period is carried out in C{rest}", logged=bool(left))

    def _calls(self) -> tuple[Callable[..., object], ...]:
        """Return the Python functions, in the order in which period.c calls them."""
        period, machine, image = self._period, self._machine, self._image
        evaluate, group = period.guards.evaluate, self._group
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
            lambda error: image.not_read(image.timer, error),
            lambda place, error: or_guard(partial(image.sample_rest, group.inputs, place, error), evaluate),
            lambda place, error: period.update_by(partial(image.update_rest, group.outputs, place, error)),
        )

    # TICK ----------------------------------------------------------------------------------------------

    def _tick(self, is_all_in_c: bool) -> tuple[Any, ...] | None:
        """Return the data of the timer for period.c, or None if Python reads the timer. `is_all_in_c`: True if C
        transfers all blocks."""
        image, slot = self._image, self._image.timer
        wire = image.wires[slot]
        found = transfer_in_c(wire.driver, (wire.channel,), False)
        if not self._is_ticking():
            self._awaited.append(self._is_ticking)
            self.reasons["TICK"] = AWAY
            return None
        if not isinstance(found, str) and not is_all_in_c:
            self.reasons["TICK"] = "it warms the caches for the transfers of drivers"
            return None
        columns = image.columns
        places = (column.ctypes.data + 8 * slot for column in (columns.raws, columns.values, columns.times))
        taken = image._least_ticks, image._most_ticks, *places, columns.quality.ctypes.data + slot
        if isinstance(found, str):
            return 0, 0, *taken, None, image.transfer.tick, wire.channel
        self._kept.append(found.keep)
        return found.function, found.context, *taken, image.transfer.has_ticked, None, None

    def _is_ticking(self) -> bool:
        """True if nothing else is called at the tick. While a driver is away, more is called."""
        transfer, slot = self._image.transfer, self._image.timer
        is_read = transfer.has_ticked is not None or transfer.tick == self._image.wires[slot].driver.read
        return is_read and self._machine.clock.on_tick == self._period.on_tick

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
        """Return the blocks as C transfers and converts them, or None if Python does."""
        moved = list[Moved]()
        for block in blocks:
            native = getattr(block.give if write else block.convert, "__self__", None)
            if not isinstance(native, extension.Outputs if write else extension.Inputs):
                name = self._image.transfer.words_of(block.driver)
                self.reasons["SEND" if write else "SAMPLE"] = f"{name}: its values are processed by more than a scale"
                return None
            moved.append(self._in_c(native, block, write) or self._by_driver(native, block))
        return moved

    def _in_c(self, native: Any, block: Block, write: bool) -> Moved | None:
        """Return a block that C transfers, or None if its driver must be called."""
        found = transfer_in_c(block.driver, block.channels, write)
        is_there = partial(_is_there, block, write)
        if not isinstance(found, str) and not is_there():
            self._awaited.append(is_there)
            found = AWAY
        if isinstance(found, str):
            self.drivers[self._image.transfer.words_of(block.driver)] = found
            return None
        self._kept.append(found.keep)
        return Moved(native, found.function, found.context, block.was_moved, None, None, None)

    def _by_driver(self, native: Any, block: Block) -> Moved:
        return Moved(native, 0, 0, None, block.transfer, block.channels, block.buffer)

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
        """Return the compiled conditions of the interlocks, or None if Python evaluates them."""
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
        """Return the compiled laws, or None if Python calls them."""
        functions = [law.__func__ for law in self._laws]
        found = [getattr(each, "__self__", None) for each in functions]
        if all(isinstance(each, extension.Law) for each in found):
            return found
        laws = self._machine.find(compiled_laws.CompiledLaws)
        has_deques = laws is not None and laws.state == "compiled" and laws.has_deques
        self.reasons["LAWS"] = "the elements of their deques are also in Python" if has_deques else NOT_COMPILED
        return None
