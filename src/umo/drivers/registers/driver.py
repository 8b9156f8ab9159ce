"""The common part of the drivers of I2C and SPI: a chip with registers, one transfer for each block of them."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Hashable, Mapping, Sequence
from functools import partial
from operator import le
from time import monotonic
from typing import Any, TypeVar

from umo.drivers._block_driver import BlockDriver, Plans, in_turn
from umo.drivers.contract import Direction, IntArray
from umo.drivers.option_checks import within
from umo.drivers.registers.blocks import BlockPart, RegisterBlock, places_of, plan
from umo.drivers.registers.map import FORMS, ChipRegisters, Register, RegisterChannel, RegisterOptions
from umo.duration import duration
from umo.errors import DeviceTimeout, DriverError, WiringError

D = TypeVar("D")
T = TypeVar("T")


class RegisterDriver(BlockDriver[RegisterChannel]):
    """A chip with a register map. The driver of a bus derives from this class and transfers the bytes.

    A bit field is written by writing its whole register. The other bits are those that this driver wrote last. Before
    the first write, they come from the register's `initial` value, or else from the present content of the register.
    """

    forms = ("REGISTER", "REGISTER.FIELD (names of the option registers)", *FORMS)
    max_block_size = 32
    """Largest number of bytes of a block."""

    def __init__(
        self,
        registers: Mapping[str, RegisterOptions],
        page_register: int | None,
        auto_increment: bool,
        identity: Mapping[str, int],
        setup: Mapping[str, int],
        address_bits: int,
    ) -> None:
        if page_register is not None:
            within("page_register", page_register, 0, (1 << address_bits) - 1)
        self._map = ChipRegisters(
            registers, address_bits=address_bits, paged=page_register is not None, bytewise=auto_increment
        )
        self._page_register = page_register
        self._auto_increment = auto_increment
        self._identity = self._values("identity", identity, Direction.INPUT)
        self._setup = self._values("setup", setup, Direction.OUTPUT)
        self._plan = partial(plan, joined=auto_increment, max_size=self.max_block_size)
        self._reads, self._writes = Plans(self._plan), Plans(self._plan_write)
        self._opened = self._broken = False
        self._bus: Any = None
        """The bus that `_connect` has made, while it is open."""
        self._deadline: float | None = None
        """Deadline of the call, set by its first transfer."""
        self._page: int | None = None
        self._shadow: dict[Hashable, int] = {}
        """The bytes that were written last, by their places, because two registers of the wiring may be one register of
        the chip."""

    def channel(self, text: str) -> RegisterChannel:
        return self._map.channel(text)

    def open(self) -> None:
        """Open the bus, compare the registers of the option `identity`, and write those of `setup`."""
        self._opened = True
        self._begin()

    def close(self) -> None:
        self._opened = False
        self._shadow.clear()
        self._shut()

    def read_many(self, channels: Sequence[RegisterChannel], out: IntArray) -> None:
        self._begin()

        def read(block: RegisterBlock) -> None:
            data = self._read_block(block.page, block.address, block.size)
            if block.like is not None:
                block.like.decode(data, out)
                return
            for register, start, placed, _ in block.parts:
                contents = register.unpack(data[start : start + register.size])
                for i, channel in placed:
                    out[i] = channel.decode(contents)

        in_turn(self._reads.of(channels), read, _texts_of)

    def _write(self, channels: Sequence[RegisterChannel], raws: list[int]) -> None:
        lowest, highest, blocks = self._writes.of(channels)
        if not (all(map(le, lowest, raws)) and all(map(le, raws, highest))):  # before the first is sent
            for channel, raw in zip(channels, raws, strict=True):
                channel.check(raw)
        self._begin()
        in_turn(blocks, lambda block: self._put_block(block, raws), _texts_of)

    def _plan_write(
        self, channels: tuple[RegisterChannel, ...]
    ) -> tuple[list[int], list[int], tuple[RegisterBlock, ...]]:
        """Return the lower limits and the upper limits of the channels, and the blocks. No value is within the limits
        of an input."""
        limits = [(1, 0) if each.direction is Direction.INPUT else (each.lowest, each.highest) for each in channels]
        return [low for low, _ in limits], [high for _, high in limits], self._plan(channels)

    def _put_block(self, block: RegisterBlock, raws: Sequence[int]) -> None:
        like = block.like
        data = b"".join([self._packed(part, raws) for part in block.parts]) if like is None else like.encode(raws)
        self._turn_to(block.page)
        self._transfer("writing", self._put, block.address, data)
        self._shadow.update(zip(block.places, data, strict=True))

    def _packed(self, part: BlockPart, raws: Sequence[int]) -> bytes:
        contents = 0 if part.whole else self._before(part.register)
        for i, channel in part.channels:
            contents = channel.encode(raws[i], contents)
        return part.register.pack(contents)

    def _before(self, register: Register) -> int:
        """Return the contents of the register, from which the bits are taken that are not written now."""
        places = places_of(register.page, register.address, register.size, joined=self._auto_increment)
        if self._shadow.keys() >= set(places):
            return register.unpack(bytes(self._shadow[place] for place in places))
        if register.initial is not None:
            return register.initial
        return register.unpack(self._read_block(register.page, register.address, register.size))

    # The bus -------------------------------------------------------------------------------------------

    @abstractmethod
    def _connect(self) -> None:
        """Set `_bus` to an object with `close`, and open it. Raises DriverError if that fails."""

    @abstractmethod
    def _get(self, address: int, size: int) -> bytes:
        """Read this number of bytes in one transfer, beginning at a register. Raises OSError if this fails."""

    @abstractmethod
    def _put(self, address: int, data: bytes) -> None:
        """Write these bytes in one transfer, beginning at a register. Raises OSError if this fails."""

    def _explained(self, error: OSError) -> str:
        """Return the cause of a failed transfer as text."""
        return error.strerror or str(error)

    # How -----------------------------------------------------------------------------------------------

    def _begin(self) -> None:
        """Begin one call. After a failure the bus is opened again."""
        if not self._opened:
            raise DriverError("it is not open")
        self._deadline = self._page = None
        if self._broken:
            self._shut()
        if self._bus is None:
            self._start()

    def _start(self) -> None:
        try:
            self._connect()
            for channel, value in self._identity:
                self._compare(channel, value)
            for channel, value in self._setup:
                for block in self._plan((channel,)):
                    self._put_block(block, [value])
        except BaseException:
            self._shut()
            raise

    def _compare(self, channel: RegisterChannel, value: int) -> None:
        register = channel.register
        found = channel.decode(register.unpack(self._read_block(register.page, register.address, register.size)))
        if found != value:
            raise DriverError(f"{channel.text} is {found:#x} in place of {value:#x}: no device, or another device")

    def _shut(self) -> None:
        bus, self._bus, self._broken = self._bus, None, False
        if bus is not None:
            bus.close()

    def _read_block(self, page: int | None, address: int, size: int) -> bytes:
        self._turn_to(page)
        data = self._transfer("reading", self._get, address, size)
        if len(data) != size:
            self._broken = True
            raise DriverError(f"reading {address:#04x}: {len(data)} bytes in place of {size}")
        return data

    def _turn_to(self, page: int | None) -> None:
        """Select a page, once in each call, because the chip may have been reset since the previous call."""
        if page is None or page == self._page:
            return
        assert self._page_register is not None
        select, self._page = self._page_register, None
        self._transfer(f"selecting page {page} by", self._put, select, bytes([page]))
        self._page = page

    def _transfer(self, what: str, call: Callable[[int, D], T], address: int, data: D) -> T:
        if self._deadline is None:
            self._deadline = monotonic() + self.timeout
        elif monotonic() > self._deadline:
            raise DeviceTimeout(f"{what} {address:#04x}: timed out ({duration(self.timeout)})")
        try:
            return call(address, data)
        except TimeoutError as error:
            self._broken = True
            raise DeviceTimeout(
                f"{what} {address:#04x}: the bus is held, or the device does not answer in time"
            ) from error
        except OSError as error:
            self._broken = True
            raise DriverError(f"{what} {address:#04x}: {self._explained(error)}") from error

    def _values(self, option: str, values: Mapping[str, int], needed: Direction) -> list[tuple[RegisterChannel, int]]:
        """Return the channels and values of an option that gives values by the names of channels."""
        found = []
        for name, value in values.items():
            channel = self.channel(name)
            if needed not in channel.direction:
                raise WiringError(f"{option}: {name} cannot be {'read' if needed is Direction.INPUT else 'written'}")
            highest = channel.highest if channel.signed else (1 << channel.bits) - 1  # also beyond an int64
            found.append((channel, within(f"{option}.{name}", value, channel.lowest, highest)))
        return found


def _texts_of(block: RegisterBlock) -> list[str]:
    return [channel.text for part in block.parts for _, channel in part.channels]
