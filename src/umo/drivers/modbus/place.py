"""Where a unit is: a host, or a serial line with its settings. Needs no library."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from umo.drivers import _hosts
from umo.errors import WiringError

PARITIES = {"even": "E", "odd": "O", "none": "N"}


@dataclass(frozen=True)
class Host:
    """A Modbus TCP device or gateway."""

    host: str = "127.0.0.1"
    port: int = 502

    def devices(self) -> Sequence[str]:
        """Its addresses; without the unit, as units behind a gateway share its one line. A name is looked up, for at
        most 2 s, and one that is not found stands for itself."""
        return [f"modbus tcp {address}:{self.port}" for address in _hosts.addresses(self.host)]

    def __str__(self) -> str:
        return f"{self.host}:{self.port}"


@dataclass(frozen=True)
class Serial:
    """A serial line. Two units on one line must agree in everything."""

    path: str
    baudrate: int = 19200
    parity: str = "even"
    stop_bits: int = 1
    rs485: bool = False

    def devices(self) -> Sequence[str]:
        """The device file, whatever link leads to it."""
        return [f"serial {os.path.realpath(self.path)}"]

    @property
    def character(self) -> float:
        """s that one character takes: start bit, 8 data bits, parity and stop bits."""
        return (9 + (self.parity != "none") + self.stop_bits) / self.baudrate

    @property
    def silence(self) -> float:
        """s between two frames: 3.5 characters, above 19200 baud 1.75 ms (Modbus over Serial Line V1.02, 2.5.1.1)."""
        return 3.5 * self.character if self.baudrate <= 19200 else 1.75e-3

    def __str__(self) -> str:
        return f"{self.baudrate} baud 8{PARITIES[self.parity]}{self.stop_bits}{', RS-485' * self.rs485}"


def place_of(
    host: str | None,
    port: int | None,
    serial: str | None,
    baudrate: int | None,
    parity: str | None,
    stop_bits: int | None,
    rs485: bool,
) -> Host | Serial:
    """From a driver's options. WiringError if they are of both kinds, or beyond their ranges."""
    if serial is None:
        given = {"baudrate": baudrate, "parity": parity, "stop_bits": stop_bits, "rs485": rs485 or None}
        _refuse(given, 'is for a serial line: it needs serial = "/dev/ttyUSB0" or another device file')
        place = Host(Host.host if host is None else host, Host.port if port is None else port)
        within("port", place.port, 1, 65535)
        return place
    _refuse({"host": host, "port": port}, "is for TCP: give host and port, or serial and baudrate, not both")
    if not serial:
        raise WiringError("serial must name a device file, such as /dev/ttyUSB0")
    line = Serial(
        serial,
        Serial.baudrate if baudrate is None else baudrate,
        Serial.parity if parity is None else parity,
        Serial.stop_bits if stop_bits is None else stop_bits,
        rs485,
    )
    within("baudrate", line.baudrate, 50, 4_000_000)
    within("stop_bits", line.stop_bits, 1, 2)
    if line.parity not in PARITIES:
        raise WiringError(f"parity must be 'even', 'odd' or 'none', not {parity!r}")
    return line


def _refuse(given: Mapping[str, object], why: str) -> None:
    for name, value in given.items():
        if value is not None:
            raise WiringError(f"{name} {why}")


def within(name: str, value: int, least: int, most: int, why: str = "") -> None:
    if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
        raise WiringError(f"{name} must be a whole number from {least} to {most}{why}, not {value!r}")


_DURATION = re.compile(r"([0-9]+(?:\.[0-9]+)?) ?(us|ms|s)")
_UNITS = {"us": 1e-6, "ms": 1e-3, "s": 1.0}


def duration(name: str, value: str | float) -> float:
    """s, from a number or a text such as "200 ms"; up to an hour."""
    match = _DURATION.fullmatch(value) if isinstance(value, str) else None
    seconds = float(match[1]) * _UNITS[match[2]] if match else value
    if isinstance(seconds, bool) or not isinstance(seconds, int | float) or not 0.0 < seconds <= 3600.0:
        raise WiringError(f'{name} must be a time such as "200 ms", above 0 and up to an hour, not {value!r}')
    return float(seconds)
