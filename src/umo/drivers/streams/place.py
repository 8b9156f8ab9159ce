"""Where a device is: a host, or a serial line with its settings. Needs no library."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from importlib import import_module
from typing import Any, Literal, get_args

from umo.drivers.options import one_of, within
from umo.drivers.streams import hosts, line
from umo.drivers.streams.stream import Stream
from umo.errors import WiringError

Parity = Literal["none", "even", "odd", "mark", "space"]
Flow = Literal["none", "rtscts", "xonxoff"]
Dial = Callable[[float], Stream]
"""Opens a stream by a deadline, in s of `monotonic`. Raises Lost or DriverError."""


@dataclass(frozen=True)
class Host:
    """A TCP device or gateway."""

    host: str
    port: int
    protocol: str = "tcp"
    """What `devices` puts before the address."""

    def __post_init__(self) -> None:
        within("port", self.port, 1, 65535)

    def devices(self) -> Sequence[str]:
        """Its addresses. A name is looked up, for at most 2 s; one that is not found stands for itself."""
        return [f"{self.protocol} {address}:{self.port}" for address in hosts.addresses(self.host)]

    def prepared(self) -> bool:
        """Whether the library that it needs is there."""
        return True

    def dial(self) -> Dial:
        return hosts.TcpDial(self.host, self.port)


@dataclass(frozen=True)
class Serial:
    """A serial line."""

    path: str
    baudrate: int
    parity: Parity
    data_bits: int = 8
    stop_bits: int = 1
    flow: Flow = "none"
    dtr: bool = True
    rs485: bool = False

    def __post_init__(self) -> None:
        within("baudrate", self.baudrate, 50, 4_000_000)
        one_of("data_bits", self.data_bits, (5, 6, 7, 8))
        one_of("parity", self.parity, get_args(Parity))
        one_of("stop_bits", self.stop_bits, (1, 2))
        one_of("flow", self.flow, get_args(Flow))

    def devices(self) -> Sequence[str]:
        """The device file, whatever link leads to it."""
        return [f"serial {os.path.realpath(self.path)}"]

    def prepared(self) -> bool:
        """Import pyserial; False if it is missing. For constructors: a guardian has no time for imports in `open`."""
        try:
            import_module("serial.rs485")
        except ModuleNotFoundError:
            return False
        return True

    def dial(self) -> Dial:
        return partial(line.opened, self)

    @property
    def character(self) -> float:
        """s that one character takes: start bit, data bits, parity and stop bits."""
        return (1 + self.data_bits + (self.parity != "none") + self.stop_bits) / self.baudrate

    def __str__(self) -> str:
        shape = f"{self.data_bits}{self.parity[0].upper()}{self.stop_bits}"
        return f"{self.baudrate} baud {shape}{', RS-485' * self.rs485}"


Place = Host | Serial


def place_of(
    default: tuple[Host, Serial], host: str | None, port: int | None, serial: str | None, **settings: Any
) -> Place:
    """From the options of a driver, None for those that are not given. WiringError if they are of both kinds."""
    given = {name: value for name, value in settings.items() if value is not None}
    tcp: dict[str, Any] = {name: value for name, value in (("host", host), ("port", port)) if value is not None}
    if serial is None:
        for name in given:
            raise WiringError(f'{name} is for a serial line: it needs serial = "/dev/ttyUSB0" or another device file')
        return replace(default[0], **tcp)
    for name in tcp:
        raise WiringError(f"{name} is for TCP: give host and port, or serial and baudrate, not both")
    if not serial:
        raise WiringError("serial must name a device file, such as /dev/ttyUSB0")
    return replace(default[1], path=serial, **given)
