"""The owner of a certificate in a folder: `ca.pem`, `certificate.pem`, `key.pem` (`umo connect certificate`)."""

from __future__ import annotations

import time
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from umo.clients.fleet.fleet_rules import KINDS
from umo.errors import OptionError
from umo.text import printable

CA_FILE, CERTIFICATE_FILE, KEY_FILE = "ca.pem", "certificate.pem", "key.pem"
MAX_BYTES = 1 << 16
EXPIRY_NOTICE = 30 * 86_400
"""Time in s before the expiry of a certificate at which notices begin."""


@dataclass(frozen=True)
class Identity:
    """The owner of a certificate. `expires`: time at which the certificate expires, UTC in s."""

    kind: str
    name: str
    expires: float
    hosts: tuple[str, ...] = ()

    def __str__(self) -> str:
        return f"{self.kind}:{self.name}"

    @property
    def until(self) -> str:
        """The day on which the certificate expires, as text."""
        return day(self.expires)

    def is_soon_over(self, now: float) -> bool:
        return self.expires - now < EXPIRY_NOTICE


def identity_of(folder: Path, now: float | None = None) -> Identity:
    """Return the owner of a certificate. Raises OptionError if a file is missing, if the certificate does not belong to
    a fleet, or if it is not valid at `now` (UTC in s)."""
    for name in (CA_FILE, CERTIFICATE_FILE, KEY_FILE):
        if not (folder / name).is_file():
            raise OptionError(f"{folder} has no {name}; `umo connect certificate` makes it")
    file = folder / CERTIFICATE_FILE
    certificate = read_certificate(file)
    identity = _identity(certificate)
    now = time.time() if now is None else now
    if identity is None:
        raise OptionError(
            f"{file} is not a certificate of a fleet: its common name is not {' or '.join(f'{k}:NAME' for k in KINDS)}"
        )
    if identity.expires <= now:
        raise OptionError(
            f"{file} of {identity} expired on {identity.until}; issue a new one (umo connect certificate)"
        )
    if (begins := certificate.not_valid_before_utc.timestamp()) > now:
        raise OptionError(f"{file} is valid from {day(begins)} on: set the clock of this computer")
    return identity


def read_certificate(file: Path) -> Any:
    """Read a certificate in PEM. Raises OptionError if the file has none."""
    from cryptography import x509

    try:
        with open(file, "rb") as stream:
            return x509.load_pem_x509_certificate(stream.read(MAX_BYTES))
    except OSError as error:
        raise OptionError(f"{file} cannot be read: {error.strerror}") from None
    except ValueError:
        raise OptionError(f"{file} is not a certificate") from None


def issued(file: Path) -> Identity | None:
    """Return the owner of a certificate, even an expired one. Return None if the certificate does not belong to a
    fleet."""
    return _identity(read_certificate(file))


def _identity(certificate: Any) -> Identity | None:
    from cryptography import x509
    from cryptography.x509.oid import NameOID

    names = certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
    kind, colon, name = str(names[0].value).partition(":") if names else ("", "", "")
    if kind not in KINDS or not colon:
        return None
    try:
        found = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
        hosts = tuple(str(each.value) for each in found)
    except x509.ExtensionNotFound:
        hosts = ()
    return Identity(kind, printable(name), certificate.not_valid_after_utc.timestamp(), hosts)


def day(seconds: float) -> str:
    return datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%d")
