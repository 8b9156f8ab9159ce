"""The address of a face's server, and who may reach it."""

from __future__ import annotations

import errno
import ipaddress
import os
import socket
import ssl
from dataclasses import dataclass
from pathlib import Path

from umo.errors import OptionError, UmoError


def is_local(host: str) -> bool:
    """True if an address can be reached from this computer only."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host.lower() == "localhost"


@dataclass(frozen=True)
class Endpoint:
    """The address of a server. `port` 0 means a free port. `certificate` is the file of the server's certificate and
    key (PEM), `clients` the file of the certificates by which clients are known. Raises OptionError if other computers
    can reach the address and one of the two files is missing."""

    host: str
    port: int
    certificate: Path | None = None
    clients: Path | None = None

    def __post_init__(self) -> None:
        if not 0 <= self.port <= 65535:
            raise OptionError(f"port {self.port} is not from 0 to 65535")
        if not is_local(self.host) and (self.certificate is None or self.clients is None):
            raise OptionError(
                f"{self.host} can be reached from other computers: give `certificate` (the certificate of this "
                f"server) and `clients` (the certificates of the clients that may connect), or leave out `host` "
                f"(default: 127.0.0.1)"
            )

    def listening(self) -> socket.socket:
        """Return a socket that listens. Raises UmoError if the address cannot be used."""
        family = socket.AF_INET6 if ":" in self.host else socket.AF_INET
        try:
            return socket.create_server((self.host, self.port), family=family, backlog=64)
        except OSError as error:
            words = os.strerror(error.errno) if error.errno and error.errno > 0 else str(error)
            taken = ": another process uses it; give another `port`" if error.errno == errno.EADDRINUSE else ""
            raise UmoError(f"{self.host} port {self.port}: {words}{taken}") from None

    def context(self) -> ssl.SSLContext | None:
        """Return the context for TLS, or None without a certificate. Raises UmoError if the files are not valid."""
        if self.certificate is None:
            return None
        context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
        try:
            context.load_cert_chain(self.certificate)
            if self.clients is not None:
                context.load_verify_locations(self.clients)
                context.verify_mode = ssl.CERT_REQUIRED
        except (OSError, ssl.SSLError) as error:
            raise UmoError(f"{self.certificate}, {self.clients}: these are not certificates ({error})") from None
        return context
