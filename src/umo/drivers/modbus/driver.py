"""Modbus devices: fieldbus couplers, PLCs, drives, meters, and the plants that `umo device plant` serves."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from time import monotonic
from typing import TYPE_CHECKING, Any, Literal

from umo.drivers._block_driver import BlockDriver, Plans, in_turn
from umo.drivers._library import library
from umo.drivers.contract import Direction, IntArray
from umo.drivers.modbus.answer import Refused
from umo.drivers.modbus.channel import HIGHEST_ADDRESS, HOLDING, ModbusChannel, parse
from umo.drivers.modbus.plan import RegisterContents, Request, Requests, WriteCache, plan_reads, plan_writes
from umo.drivers.option_checks import duration, one_of, within
from umo.drivers.optional import HasWatchdog, Inspects, Looks, NoWatchdog
from umo.drivers.streams import Host, Place, Serial, place_of
from umo.drivers.streams.line import Parity
from umo.duration import duration as duration_text
from umo.errors import ChannelsFailed, DriverError, WiringError
from umo.system.packages import how_to_install

if TYPE_CHECKING:
    from umo.drivers.modbus.unit import Unit

_MAX_WATCHDOG = 65.535
"""Longest time in s that the watchdog's register can hold."""
_MAX_REGISTERS, _MAX_READ_BACK = 123, 121
"""Largest numbers of registers in one write, by function 16 and by function 23."""
_DEFAULT = Host("127.0.0.1", 502, "modbus tcp"), Serial("", 19200, "even")


class Modbus(BlockDriver[ModbusChannel], Looks, HasWatchdog, Inspects):
    """One unit of a Modbus device, on TCP or on a serial line (RTU). A device with several units needs a driver for
    each.

    Channels: `coil:N` and `holding:N[:TYPE]` (both directions), `discrete:N` and `input:N[:TYPE]` (inputs). TYPE is
    uint16 (default), int16, uint32, int32, uint64, int64, or float32:SCALE and float64:SCALE, whose raw integer is the
    value divided by the scale, rounded. 32 bits take the registers N and N + 1, 64 bits N to N + 3. N is the protocol's
    address, 0 to 65535, counted from 0; many manuals count from 1 and put the number of the table in front. An order of
    bytes (ABCD, CDAB, BADC, DCBA, of one register AB, BA) may follow, and then the bits of an integer: `holding:10.9`,
    `holding:10.11:8`, `input:4:uint32:CDAB.17`.

    Options:
        host: a TCP device or gateway; a host name is looked up once, by `open`. Default: 127.0.0.1.
        port: the TCP port. Default: 502.
        serial: the device file of a serial line, in place of host and port.
        baudrate: the speed of the serial line in bit/s. Default: 19200.
        parity: the parity of the serial line: "even", "odd", "none", "mark" or "space". Default: "even".
        stop_bits: the stop bits of a character on the serial line, 1 or 2. Default: 1.
        echo: the adapter of the serial line repeats what is sent. Without this option, writes (functions 5, 6, 22) of a
            driver that reads nothing are confirmed by their own echo.
        rs485: the kernel switches the direction of the line, for a UART whose circuit does not.
        unit: 1 to 247. TCP takes 0 to 255: a device that is not a gateway often has 0 or 255.
        answers_as: the unit in the answers of a gateway on TCP that does not repeat the unit of the request: 0 or 255.
        word_order: which word of a wider value has the lowest address, the "big" (high) or the "little".
        byte_order: which byte of each register comes first, the "big" (high), as the protocol has it, or the "little".
        mask_write: bits of registers are written by function 22, which does not change the other bits. Default: off,
            because many devices do not have this function. Then the whole register is written. Its other bits are those
            that this driver wrote last or, before the first write and after the connection was lost, those that the
            unit has.
        watchdog_register: the holding register that takes the watchdog's time in ms, if there is one.
        bridge_gaps: read across up to 16 unused registers or 64 unused bits if this saves a request. Default: off,
            because a device may answer exception 2 to an address that it does not have.
        read_write: write registers by function 23, which reads them back: a value that the unit did not take is an
            error. Default: off, because many devices do not have this function.
        skip_unchanged: a request of a period is not sent if the unit confirmed the same values less than this time ago,
            such as "200 ms". Default: every period sends everything.
        recovery: on serial lines, the time after a failed request in which the unit is not asked for the same function
            again. It should be longer than the unit's longest time to answer. Default: "250 ms".
        pause: time between an answer and the next request that the unit needs. Default: none.
        boot_time: on TCP, the time that the device needs from the connection to the first request. Default: none.
        max_registers: the largest number of registers in one request, for a device that takes fewer than the protocol
            permits: 1 to 125.
        write_multiple: write also a single coil or register by function 15 or 16, for a device without functions 5
            and 6.

    All channels of a period are transferred in as few requests as their addresses allow: consecutive cells of one table
    share a request, up to the protocol's maxima. Only addressed cells are written. A single coil or register is written
    with function 5 or 6, several with 15 or 16: the functions that most devices support. The fields of one register are
    one transfer.

    Each call returns within `timeout`, including all of its requests and a reconnection if needed. There is no
    retry: after a write timed out, it is not known whether the device carried it out. On TCP, after any failure except
    an exception answer the connection is closed, and the next call opens it again; on a serial line the unit recovers.

    If a block takes several requests, a request that is answered by an exception fails for its own channels, and the
    others continue. A request that loses the connection fails for its own channels and those of all later requests
    (ChannelsFailed). A timeout is a DeviceTimeout of the whole block, whatever was read or written before it: the time
    of the call is used up, and the device may be disconnected.
    """

    def __init__(
        self,
        *,
        host: str | None = None,
        port: int | None = None,
        serial: str | None = None,
        baudrate: int | None = None,
        parity: Parity | None = None,
        stop_bits: Literal[1, 2] | None = None,
        rs485: bool = False,
        echo: bool = False,
        unit: int = 1,
        answers_as: int | None = None,
        word_order: Literal["big", "little"] = "big",
        byte_order: Literal["big", "little"] = "big",
        mask_write: bool = False,
        watchdog_register: int | None = None,
        bridge_gaps: bool = False,
        read_write: bool = False,
        skip_unchanged: str | float | None = None,
        recovery: str | float = 0.25,
        pause: str | float | None = None,
        boot_time: str | float | None = None,
        max_registers: int = 125,
        write_multiple: bool = False,
    ) -> None:
        line = {"baudrate": baudrate, "parity": parity, "stop_bits": stop_bits, "rs485": rs485 or None}
        line["echo"] = echo or None
        self.place = place_of(_DEFAULT, host, port, serial, **line)
        _check_unit(self.place, unit, answers_as, boot_time)
        one_of("word_order", word_order, ("big", "little"))
        one_of("byte_order", byte_order, ("big", "little"))
        if watchdog_register is not None:
            within("watchdog_register", watchdog_register, 0, HIGHEST_ADDRESS)
        self._unit = unit
        self._rules: dict[str, Any] = {
            "recovery": duration("recovery", recovery),
            "answers_as": answers_as,
            "pause": 0.0 if pause is None else duration("pause", pause),
            "boot_time": 0.0 if boot_time is None else duration("boot_time", boot_time),
            "write_multiple": write_multiple,
        }
        self._little, self._swapped = word_order == "little", byte_order == "little"
        self.watchdog_register = watchdog_register
        self._read_write, self._mask_write = read_write, mask_write
        self._skip = 0.0 if skip_unchanged is None else duration("skip_unchanged", skip_unchanged)
        self._unchanged = WriteCache(self._skip)
        self._contents = RegisterContents()
        self._protocol = library("umo.drivers.modbus.unit", "pymodbus") if self.place.prepared() else None
        self._connection: Unit | None = None
        self._max_registers = within("max_registers", max_registers, 1, 125)
        most = min(_MAX_READ_BACK if read_write else _MAX_REGISTERS, max_registers)
        self._reads = Plans[ModbusChannel, Requests](
            partial(plan_reads, bridge_gaps=bridge_gaps, most_registers=max_registers)
        )
        self._writes = Plans[ModbusChannel, Requests](partial(plan_writes, most_registers=most, masking=mask_write))

    def channel(self, text: str) -> ModbusChannel:
        channel = parse(text, little=self._little, swapped=self._swapped, unit=self._unit)
        if channel.table.full != 1 and channel.cells > self._max_registers:
            raise WiringError(f"{text} takes {channel.cells} registers; max_registers is {self._max_registers}")
        if self._mask_write and channel.low is not None and channel.cells > 1:
            return replace(channel, direction=Direction.INPUT)  # function 22 writes one register
        return replace(channel, masked=True) if self._mask_write and channel.low is not None else channel

    def devices(self) -> Sequence[str]:
        """Return the host's addresses and port, or the device file; without the unit, because units share the
        device."""
        return self.place.devices()

    def open(self) -> None:
        """Connect, within `timeout`."""
        if self._protocol is None:
            needs = "pymodbus" if isinstance(self.place, Host) else "pymodbus and pyserial"
            raise DriverError(f"the modbus driver needs {needs}: {how_to_install('modbus')}")
        self._connection = self._protocol.Unit(self.place, self._unit, self._protocol.UnitRules(**self._rules))
        self._begin()

    def close(self) -> None:
        self._forget()
        if self._connection is not None:
            self._connection.close()
            self._connection = None

    def initialize(self, channel: ModbusChannel, default: int | None) -> None:
        """Initialise the channel. On a serial line, for a sensor, wait for the end of the recovery that follows opening
        the line, so that the first reading of a machine is not refused."""
        if default is None:
            self._begin().recover(self.timeout)
        else:
            self.write(channel, default)

    def read_many(self, channels: Sequence[ModbusChannel], out: IntArray) -> None:
        plan = self._reads.of(channels)
        unit = self._begin()
        self._in_turn(plan, lambda i: plan[i].decode(unit.read(plan[i]), out))

    def write_many(self, channels: Sequence[ModbusChannel], raws: IntArray) -> None:
        self._write(channels, raws.tolist(), skip=self._skip > 0)

    def inspect(self, channel: ModbusChannel) -> str:
        """Return the registers of the channel (for a field, the registers of the whole value), and the number in each
        order of bytes; empty for a coil or a discrete input."""
        if channel.table.full == 1:
            return ""
        whole = channel.uncut or channel
        request = Request(whole.table, whole.address, whole.cells, ())
        words = self._begin().read(request)
        digits = " ".join(f"{word:04X}" for word in words)
        return f"{request.what}: {digits}; by the order of bytes: {whole.in_each_order(words)}"

    def watchdog(self, seconds: float) -> None:
        """Write the time, in ms, into the watchdog's register; 0 turns most watchdogs off."""
        self.check_watchdog(seconds)
        milliseconds = max(round(seconds * 1000), 1 if seconds else 0)
        self._write((self.channel(f"holding:{self.watchdog_register}"),), [milliseconds], read_back=False)

    def check_watchdog(self, seconds: float) -> None:
        if self.watchdog_register is None:
            raise NoWatchdog("a watchdog needs the option watchdog_register")
        if not 0 <= seconds <= _MAX_WATCHDOG:
            raise DriverError(f"a watchdog of {duration_text(seconds)} does not fit its register (0 to 65.535 s)")
        if seconds and self._skip and self._skip + self.period >= seconds:
            together = f"skip_unchanged and a period, {duration_text(self._skip + self.period)}"
            raise DriverError(f"{together}, are not shorter than the watchdog, {duration_text(seconds)}")

    def look(self) -> bool | None:
        """Look for the unit: read cells that are read anyway or, if nothing is read, cells that are written. On a
        serial line that several units share, this is not possible without waiting."""
        if self._connection is None:
            return False
        self._forget()
        plan = self._reads.last or self._writes.last
        table, address, count = (plan[0].table, plan[0].address, plan[0].count) if plan else (HOLDING, 0, 1)
        return self._connection.look(table, address, count, self.timeout)

    def _write(
        self, channels: Sequence[ModbusChannel], raws: list[int], *, read_back: bool = True, skip: bool = False
    ) -> None:
        plan = self._writes.of(channels)
        # All values are encoded before the first is sent: one that does not fit leaves the device alone.
        cells = [request.encode(raws) for request in plan]
        unit, now = self._begin(), monotonic()
        if skip:
            sent = [i for i, request in enumerate(plan) if not self._unchanged.covers(request, cells[i], now)]
            plan, cells = tuple(plan[i] for i in sent), [cells[i] for i in sent]

        def carry_out(i: int) -> None:
            request = plan[i]
            if self._skip:
                self._unchanged.begins(request)
            self._send(unit, request, cells[i], read_back)
            if self._skip:
                self._unchanged.confirmed(request, cells[i], now)

        self._in_turn(plan, carry_out)

    def _send(self, unit: Unit, request: Request, cells: list[int], read_back: bool) -> None:
        """Write those bits of the cells that belong to the channels. The other bits do not change."""
        if request.partial and self._mask_write:
            unit.mask_write(request, cells)
            return
        if request.partial:
            cells = request.completed(cells, self._before(unit, request))
        if request.table is HOLDING:
            self._contents.begins(request)
        if self._read_write and read_back and request.table is HOLDING:
            request.check_taken(cells, unit.write_and_read(request, cells))
        else:
            unit.write(request, cells)
        self._contents.confirmed(request, cells)

    def _before(self, unit: Unit, request: Request) -> Mapping[int, int]:
        """Return the contents of the registers that the request writes in part: as written last, or else as read from
        the unit."""
        missing = self._contents.missing(request)
        if not missing:
            return self._contents.words
        span = request.span(missing)
        return dict(enumerate(unit.read(span), span.address)) | self._contents.words

    def _forget(self) -> None:
        """Forget the contents of the unit."""
        self._unchanged.forget()
        self._contents.forget()

    def _begin(self) -> Unit:
        if self._connection is None:
            raise DriverError("it is not open")
        try:
            if self._connection.begin(self.timeout):
                self._forget()
        except BaseException:
            self._forget()
            raise
        return self._connection

    def _in_turn(self, plan: Requests, carry_out: Callable[[int], None]) -> None:
        """Carry out the requests, given by their numbers. After a lost connection the later requests fail, too."""

        def texts_of(i: int) -> Iterable[str]:
            return [item.channel.text for item in plan[i].items]

        def carried_out(i: int) -> None:
            try:
                carry_out(i)
            except (Refused, ChannelsFailed):
                raise
            except BaseException:
                self._contents.forget()  # the unit may have been off since
                raise

        try:
            in_turn(range(len(plan)), carried_out, texts_of, lambda error: not isinstance(error, Refused))
        except BaseException:
            self._unchanged.forget()
            raise


def _check_unit(place: Place, unit: int, answers_as: int | None, boot_time: str | float | None) -> None:
    """Raise WiringError for an option that is beyond its range, or that cannot be used at this place."""
    if isinstance(place, Host):
        within("unit", unit, 0, 255)
    else:
        within("unit", unit, 1, 247, " on a serial line (0 is a broadcast, which no unit confirms)")
        if answers_as is not None:
            raise WiringError(
                "answers_as can only be used with a gateway on TCP: on a serial line the unit distinguishes the answers"
            )
        if boot_time is not None:
            raise WiringError("boot_time can only be used with TCP: a serial line has no connection")
    if answers_as is not None:
        within("answers_as", answers_as, 0, 255)
