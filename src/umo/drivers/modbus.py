"""Modbus TCP devices: fieldbus couplers, PLCs, drives, and the plants that `umo plant` serves."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Literal

import numpy as np

from umo.drivers import _hosts
from umo.drivers._modbus_answer import Refused
from umo.drivers._modbus_plan import (
    HIGHEST_ADDRESS,
    ModbusChannel,
    Request,
    Requests,
    parse,
    plan_reads,
    plan_writes,
)
from umo.drivers.contract import Driver, IntArray
from umo.errors import ChannelsFailed, DriverError, WiringError

if TYPE_CHECKING:
    from umo.drivers._modbus_link import Link

_MOST_PLANS = 256
_LONGEST_WATCHDOG = 65.535


def _find_link() -> type[Link] | None:
    """The protocol's side, None without pymodbus: a wiring can be checked all the same."""
    try:
        from umo.drivers._modbus_link import Link
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != "pymodbus":
            raise
        return None
    return Link


class _NoWatchdog(DriverError, NotImplementedError):
    """This device has no watchdog, as any driver without one says it, and a DriverError besides."""


class Modbus(Driver[ModbusChannel]):
    """One unit of a Modbus TCP device.

    Channels: `coil:N` and `holding:N[:TYPE]` (both directions), `discrete:N` and `input:N[:TYPE]` (inputs);
    TYPE is uint16 (default), int16, uint32 or int32, the last two in registers N and N + 1. N is the
    protocol's address, 0 to 65535, counted from 0; many manuals count from 1 and put the table before it.

    Options:
        host, port, unit: the device; a host name is resolved once, by `open`.
        word_order: which word of a 32-bit value has the lower address, the "big" (high) or the "little".
        watchdog_register: the holding register that takes the watchdog's time in ms, if there is one.
        bridge_gaps: read over up to 16 unused registers or 64 unused bits where that saves a request. Default:
            off, since a device may answer exception 2 to an address that it does not have.

    All channels of a period move in as few requests as their addresses allow: the cells of one table that
    follow each other in one request, up to the protocol's maxima. Only addressed cells are written.
    A single coil or register is written with function 5 or 6, several with 15 or 16: the functions that most
    devices support.

    Each call returns within `timeout`, including all of its requests and a reconnection if needed. There is no
    retry: after a write timed out, it is not known whether the device carried it out. After any failure except
    an exception answer the connection is closed, and the next call opens it again.

    Where a block takes several requests, one that is answered by an exception fails for its own channels and
    the others go on; one that loses the connection fails for its own and those of all later requests, as
    ChannelsFailed says. A timeout is a DeviceTimeout of the whole block, whatever was read or written
    before it: the time of the call is used up, and the device may be disconnected.
    """

    def __init__(
        self,
        *,
        host: str = "127.0.0.1",
        port: int = 502,
        unit: int = 1,
        word_order: Literal["big", "little"] = "big",
        watchdog_register: int | None = None,
        bridge_gaps: bool = False,
    ) -> None:
        _within("port", port, 1, 65535)
        _within("unit", unit, 0, 255)
        if word_order not in ("big", "little"):
            raise WiringError(f"word_order must be 'big' or 'little', not {word_order!r}")
        if watchdog_register is not None:
            _within("watchdog_register", watchdog_register, 0, HIGHEST_ADDRESS)
        self.host, self.port, self._unit = host, port, unit
        self._little = word_order == "little"
        self.watchdog_register = watchdog_register
        self._bridge_gaps = bridge_gaps
        self._link_type = _find_link()  # here and not in `open`: a guardian has no time for imports
        self._link: Link | None = None
        self._reads: dict[tuple[ModbusChannel, ...], Requests] = {}
        self._writes: dict[tuple[ModbusChannel, ...], Requests] = {}

    def channel(self, text: str) -> ModbusChannel:
        return parse(text, little=self._little, unit=self._unit)

    def devices(self) -> Sequence[str]:
        """Its addresses; without the unit, as units behind a gateway share its one line. A name is looked up, for at
        most 2 s, and one that is not found stands for itself."""
        return [f"modbus tcp {address}:{self.port}" for address in _hosts.addresses(self.host)]

    def open(self) -> None:
        """Connect, within `timeout`."""
        if self._link_type is None:
            raise DriverError('the modbus driver needs pymodbus: pip install "umo[modbus]"')
        self._link = self._link_type(self.host, self.port, self._unit)
        self._link.begin(self.timeout)

    def close(self) -> None:
        if self._link is not None:
            self._link.close()
            self._link = None

    def read(self, channel: ModbusChannel) -> int:
        out = np.empty(1, np.int64)
        self.read_many((channel,), out)
        return int(out[0])

    def write(self, channel: ModbusChannel, raw: int) -> None:
        self._write((channel,), [raw])

    def read_many(self, channels: Sequence[ModbusChannel], out: IntArray) -> None:
        plan = _planned(self._reads, channels, self._plan_reads)
        link = self._begin()
        _each(plan, channels, lambda _, request: request.decode(link.read(request), out))

    def write_many(self, channels: Sequence[ModbusChannel], raws: IntArray) -> None:
        self._write(channels, raws.tolist())

    def watchdog(self, seconds: float) -> None:
        """Write the time, in ms, into the watchdog's register; 0 turns most watchdogs off."""
        if self.watchdog_register is None:
            raise _NoWatchdog("a watchdog needs the option watchdog_register")
        if not 0 <= seconds <= _LONGEST_WATCHDOG:
            raise DriverError(f"a watchdog of {seconds:g} s does not fit its register (0 to 65.535 s)")
        milliseconds = max(round(seconds * 1000), 1 if seconds else 0)
        self.write(self.channel(f"holding:{self.watchdog_register}"), milliseconds)

    def _write(self, channels: Sequence[ModbusChannel], raws: list[int]) -> None:
        plan = _planned(self._writes, channels, plan_writes)
        # All values are encoded before the first is sent: one that does not fit leaves the device alone.
        cells = [request.encode(raws) for request in plan]
        link = self._begin()
        _each(plan, channels, lambda i, request: link.write(request, cells[i]))

    def _begin(self) -> Link:
        if self._link is None:
            raise DriverError("it is not open")
        self._link.begin(self.timeout)
        return self._link

    def _plan_reads(self, channels: Sequence[ModbusChannel]) -> Requests:
        return plan_reads(channels, bridge_gaps=self._bridge_gaps)


def _planned(
    plans: dict[tuple[ModbusChannel, ...], Requests],
    channels: Sequence[ModbusChannel],
    make: Callable[[Sequence[ModbusChannel]], Requests],
) -> Requests:
    """The plan for these channels, made once; a machine has few groups of them, the bound is for others."""
    key = tuple(channels)
    plan = plans.get(key)
    if plan is None:
        if len(plans) >= _MOST_PLANS:
            plans.clear()
        plan = plans[key] = make(key)
    return plan


def _each(plan: Requests, channels: Sequence[ModbusChannel], carry_out: Callable[[int, Request], None]) -> None:
    """Carry out request after request, as far as the device is there; what failed is told at the end."""
    if len(plan) == 1:
        carry_out(0, plan[0])
        return
    failed: dict[str, Exception] = {}
    for i, request in enumerate(plan):
        try:
            carry_out(i, request)
        except Refused as refused:
            failed.update(_blamed([request], channels, refused))
        except DriverError as error:
            if i == 0 or isinstance(error, TimeoutError):
                raise
            failed.update(_blamed(plan[i:], channels, error))
            break
    if failed:
        raise ChannelsFailed(failed)


def _blamed(requests: Sequence[Request], channels: Sequence[ModbusChannel], error: Exception) -> dict[str, Exception]:
    return {channels[item.place].text: error for request in requests for item in request.items}


def _within(name: str, value: int, least: int, most: int) -> None:
    if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
        raise WiringError(f"{name} must be a whole number from {least} to {most}, not {value!r}")
