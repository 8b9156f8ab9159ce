"""Normalised addresses of a host, so that two names of one device compare equal."""

from __future__ import annotations

import socket
from contextlib import suppress
from ipaddress import IPv4Address, IPv6Address, ip_address
from threading import Thread

LONGEST_LOOKUP = 2.0
"""Seconds. The resolver itself knows no limit; a device has long timed out by then."""


def addresses(host: str) -> tuple[str, ...]:
    """Every numeric address of the host, IPv6 in brackets; what cannot be looked up stands for itself.

    "Any address" (0.0.0.0, ::) is reached on this computer's own, IPv4 within IPv6 is IPv4. Raises nothing and
    ends within `LONGEST_LOOKUP`.
    """
    return _numeric(host, socket.AI_NUMERICHOST) or _looked_up(host) or (host.lower().rstrip("."),)


def _looked_up(host: str) -> tuple[str, ...]:
    """In a thread, as nothing else can leave a resolver that waits for its server."""
    found: list[str] = []
    thread = Thread(target=lambda: found.extend(_numeric(host)), name="umo look-up", daemon=True)
    thread.start()
    thread.join(LONGEST_LOOKUP)
    return tuple(found)


def _numeric(host: str, flags: int = 0) -> tuple[str, ...]:
    with suppress(OSError, ValueError):  # not found, or not the name of a host at all
        found = socket.getaddrinfo(host, None, type=socket.SOCK_STREAM, flags=flags)
        return tuple(sorted({_plain(str(address[0]), address[3:]) for *_, address in found}))
    return ()


def _plain(text: str, scope: tuple[object, ...]) -> str:
    address: IPv4Address | IPv6Address = ip_address(text.partition("%")[0])
    if isinstance(address, IPv6Address) and address.ipv4_mapped is not None:
        address = address.ipv4_mapped
    if address.is_unspecified:
        address = ip_address("127.0.0.1" if address.version == 4 else "::1")
    if address.version == 4:
        return str(address)
    return f"[{address}%{scope[0]}]" if any(scope) else f"[{address}]"
