"""The address of an MQTT broker, with the credentials of both sides: certificates, a user and a password."""

from __future__ import annotations

import os
import ssl
from dataclasses import dataclass
from pathlib import Path

from umo.clients.faces.endpoint import is_local
from umo.errors import OptionError

MAX_PASSWORD = 1024
"""Largest number of characters of a password."""


@dataclass(frozen=True)
class BrokerAddress:
    """The address of a broker. `ca`: file of the certificates (PEM) against which the broker's certificate is checked;
    with it the connection uses TLS. `certificate`: file of the face's certificate and key (PEM). `password_file`: file
    whose first line is the password of `user`; only the user who runs the face may read it. Raises OptionError for a
    broker on another computer without `ca`."""

    host: str
    port: int
    ca: Path | None = None
    certificate: Path | None = None
    user: str = ""
    password_file: Path | None = None

    def __post_init__(self) -> None:
        if not 1 <= self.port <= 65535:
            raise OptionError(f"port {self.port} is not from 1 to 65535")
        try:
            self.host.encode("idna")
        except UnicodeError:
            raise OptionError(f"host {self.host!r} is not the name of a computer") from None
        if not is_local(self.host) and self.ca is None:
            raise OptionError(
                f"{self.host} is another computer: give `ca` (the certificates with which the certificate of the "
                f"broker is checked), or leave out `host` (default: 127.0.0.1)"
            )
        if self.certificate is not None and self.ca is None:
            raise OptionError("`certificate` needs `ca` (the certificates that verify the broker)")
        if bool(self.user) != (self.password_file is not None):
            raise OptionError("give both `user` and `password_file`, or neither")

    def context(self) -> ssl.SSLContext | None:
        """Return the context for TLS, or None without `ca`. Raises OptionError if the files are not valid."""
        if self.ca is None:
            return None
        file = self.ca
        try:
            context = ssl.create_default_context(cafile=file)
            if self.certificate is not None:
                file = self.certificate
                context.load_cert_chain(file)
        except OSError as error:
            raise OptionError(f"{file}: these are not certificates ({reason_of(error)})") from None
        return context

    def password(self) -> str | None:
        """Return the first line of the password file. Raises OptionError if the file cannot be read."""
        if self.password_file is None:
            return None
        try:
            with self.password_file.open(encoding="utf-8") as stream:
                if os.fstat(stream.fileno()).st_mode & 0o077:
                    raise PermissionError("other users can read the file: chmod 600")
                line = stream.readline(MAX_PASSWORD).rstrip("\r\n")
        except (OSError, ValueError) as error:
            raise OptionError(f"{self.password_file}: the password cannot be read ({reason_of(error)})") from None
        if not line:
            raise OptionError(f"{self.password_file}: the first line is not a password")
        return line

    def __str__(self) -> str:
        return f"mqtt{'s' if self.ca else ''}://{self.host}:{self.port}"


def reason_of(error: BaseException | None) -> str:
    """Return the cause of a failure in a few words; for a certificate, its defect."""
    told = getattr(error, "verify_message", "") or getattr(error, "reason", "") or getattr(error, "strerror", "")
    return str(told or error)
