"""The place of a device: a host or a serial line. This module needs no library."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from umo.drivers.option_checks import within
from umo.drivers.streams import hosts
from umo.drivers.streams.line import Serial
from umo.drivers.streams.stream import Dial
from umo.errors import WiringError


@dataclass(frozen=True)
class Host:
    """A TCP device or gateway."""

    host: str
    port: int
    protocol: str = "tcp"
    """Text that `devices` puts before the address."""

    def __post_init__(self) -> None:
        within("port", self.port, 1, 65535)

    def devices(self) -> Sequence[str]:
        """Return the addresses of the host. A name is looked up for at most 2 s. If it is not found, return the name
        itself."""
        return [f"{self.protocol} {address}:{self.port}" for address in hosts.addresses(self.host)]

    def prepared(self) -> bool:
        """Return True if the library that the place needs is installed."""
        return True

    def dial(self) -> Dial:
        return hosts.TcpDial(self.host, self.port)


Place = Host | Serial


def place_of(
    default: tuple[Host, Serial], host: str | None, port: int | None, serial: str | None, **settings: Any
) -> Place:
    """Return the place that the options of a driver name, or None if none is given. Raises WiringError if the options
    name both a host and a serial line."""
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
