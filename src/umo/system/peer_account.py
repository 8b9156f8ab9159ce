"""The account at the other end of a TCP connection on this computer, as the kernel knows it.

An address proves nothing: a reverse proxy, a gateway or a broker on this computer also has a local address, and
forwards requests of other users. The kernel knows the user to whom the process belongs (Linux, /proc/net/tcp).
"""

from __future__ import annotations

import ipaddress
import os
import pwd
import socket
import sys
from asyncio.trsock import TransportSocket
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

TABLES = Path("/proc/net")
"""Tables of the kernel: `tcp`, `tcp6`."""
ESTABLISHED = "01"
WORD = 4
"""The size in bytes of the words in which the tables write an address."""
MAPPED = bytes(10) + b"\xff\xff"
"""Prefix of an IPv4 address of an IPv6 socket."""


def peer_uid(peer: tuple[str, int], port: int) -> int | None:
    """Return the user (uid) whose process has a connection from `peer` (address, port) to `port` of this computer.
    Return None if the process is on another computer, the connection has ended, the kernel does not know the user, or
    several users have such a connection (to other addresses of this computer).
    """
    try:
        address = ipaddress.ip_address(peer[0].partition("%")[0])
    except ValueError:
        return None
    packed = (getattr(address, "ipv4_mapped", None) or address).packed
    tables = {"tcp": packed, "tcp6": MAPPED + packed} if len(packed) == WORD else {"tcp6": packed}
    for table, own in tables.items():
        found = {uid for each, uid in _connections(table, peer[1], port) if each == own}
        if found:
            return found.pop() if len(found) == 1 else None
    return None


def account_of(uid: int) -> str:
    """Return the name of a user, or the number of a user without a name."""
    with suppress(KeyError):
        return pwd.getpwuid(uid).pw_name
    return str(uid)


def is_own(connection: socket.socket | TransportSocket | None) -> bool:
    """Return True if the process at the other end of a connection (TCP) belongs to this user."""
    if connection is None:
        return False
    try:
        peer, own = connection.getpeername(), connection.getsockname()
    except OSError:
        return False
    return peer_uid(peer[:2], own[1]) == os.getuid()


def _connections(table: str, port: int, other: int) -> Iterator[tuple[bytes, int]]:
    """Yield the own address and the uid of each connection from one port to another. Yield nothing if the kernel has no
    such table."""
    ports = f":{port:04X} ", f":{other:04X} "
    with suppress(OSError):
        for line in (TABLES / table).read_text().splitlines()[1:]:
            if ports[0] not in line or ports[1] not in line:  # nearly all: to take them apart would take longer
                continue
            fields = line.split()
            (address, _, own), (_, _, its) = (each.partition(":") for each in fields[1:3])
            if (int(own, 16), int(its, 16), fields[3]) == (port, other, ESTABLISHED):
                yield _packed(address), int(fields[7])


def _packed(text: str) -> bytes:
    """Return the bytes of an address in the tables, which contain words of 32 bits in the byte order of this
    processor."""
    words = (text[place : place + 2 * WORD] for place in range(0, len(text), 2 * WORD))
    return b"".join(int(word, 16).to_bytes(WORD, sys.byteorder) for word in words)
