"""The messages of a service to the service manager that started it (sd_notify(3)), without its library.

A message is a datagram of lines `NAME=value` to the socket that the environment names. If the environment names no
socket, nothing is sent. Nothing here waits or raises an error: if the service manager does not read, messages are lost,
but the machine is not delayed. If the service manager has no room for a message, the message is sent again at the next
look.
"""

from __future__ import annotations

import os
import socket
from collections.abc import Mapping, MutableMapping
from typing import Self
from weakref import finalize

SOCKET, WATCHDOG, WATCHDOG_PID = "NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID"
VARIABLES = (SOCKET, WATCHDOG, WATCHDOG_PID)
MAX_STATUS_LENGTH = 200
"""Largest number of characters of the line for `systemctl status`."""
READY, STOPPING, ALIVE = "READY=1", "STOPPING=1", "WATCHDOG=1"


class ServiceManager:
    """The service manager to which messages are sent. `address`: the path of the socket, "@name" for an abstract
    socket, or "" for no manager. `watchdog`: the time in s after which the manager ends a service that has given no
    heartbeat; 0 means never."""

    def __init__(self, address: str = "", watchdog: float = 0.0) -> None:
        self._address = b"\0" + os.fsencode(address[1:]) if address[:1] == "@" else address
        self._socket = _datagram_socket() if address[:1] in ("/", "@") and len(address) > 1 else None
        if self._socket is not None:
            finalize(self, self._socket.close)
        self.watchdog = watchdog if self.listens else 0.0

    @classmethod
    def of_environment(cls, environ: Mapping[str, str], pids: tuple[int, ...]) -> Self:
        """Return the service manager that the environment variables name. The manager's watchdog is used if it is meant
        for one of these processes."""
        for_whom, limit = environ.get(WATCHDOG_PID, ""), environ.get(WATCHDOG, "")
        ours = not for_whom or for_whom in map(str, pids)
        watchdog = int(limit) * 1e-6 if ours and limit.isascii() and limit.isdigit() else 0.0
        return cls(environ.get(SOCKET, ""), watchdog)

    @property
    def listens(self) -> bool:
        """True if there is a service manager."""
        return self._socket is not None

    def tell(self, *lines: str) -> bool:
        """Send one message. Return False if the manager has no room for it now, such as at a boot, when many services
        send simultaneously. Do nothing if the message cannot be sent."""
        try:
            if self._socket is not None:
                self._socket.sendto("\n".join(lines).encode(), self._address)
        except BlockingIOError:
            return False
        except (OSError, ValueError):  # it is gone, or a text with surrogates
            pass
        return True


def status(text: str) -> str:
    """Return the line of a message that `systemctl status` shows."""
    return f"STATUS={' '.join(text.split())[:MAX_STATUS_LENGTH]}"


def without(environ: MutableMapping[str, str]) -> None:
    """Remove the environment variables, because other programs that this process starts must not send messages for the
    service."""
    for name in VARIABLES:
        environ.pop(name, None)


def _datagram_socket() -> socket.socket | None:
    try:
        made = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    except (OSError, AttributeError):  # no descriptor is left, or no such sockets on this platform
        return None
    made.setblocking(False)
    return made
