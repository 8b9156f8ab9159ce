"""The users of faces whose protocol proves who they are. One file of the user who runs the faces contains their
passwords and certificates.

    # ~/.config/umo/face_users.toml
    [passwords]
    ann = "scrypt:16384:8:1:3q2+7w==:..."     # python -m umo.clients.faces.face_users ann

    [certificates]
    bob = "5f3a...c1"                          # SHA-256 of the certificate, as openssl x509 -fingerprint prints it

The file of roles says what they may do (`umo.operation.commands.roles`). If the file cannot be read, nobody can log in.
"""

from __future__ import annotations

import base64
import binascii
import getpass
import hashlib
import hmac
import logging
import os
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from umo.errors import OptionError
from umo.operation.commands import roles
from umo.wiring.settings import read_settings

log = logging.getLogger("umo.faces")
COST, BLOCK, PARALLEL = 1 << 14, 8, 1
"""Parameters of scrypt (RFC 7914) for new passwords: 16 MB, about 50 ms."""
MAX_COST = 1 << 20
"""Largest product of cost and block size of a stored password: 128 MB."""
MAX_BYTES = 1 << 20
"""Largest number of bytes of the file."""
USAGE = "python -m umo.clients.faces.face_users NAME"
MAX_PASSWORD = 1024
"""Largest number of characters of a password."""


def place() -> Path:
    """Return the path of this user's file: `umo/face_users.toml` in the folder of the file of roles."""
    return roles.place().with_name("face_users.toml")


@dataclass(frozen=True)
class FaceUsers:
    """The tables of the file. A malformed line is ignored and does not affect other users."""

    passwords: Mapping[str, Any] = field(default_factory=dict)
    certificates: Mapping[str, Any] = field(default_factory=dict)


class KeptPassword(NamedTuple):
    """A password as stored in the file. `cost`, `block`, `parallel`: n, r and p of scrypt."""

    cost: int
    block: int
    parallel: int
    salt: bytes
    key: bytes

    @classmethod
    def parse(cls, text: Any) -> KeptPassword | None:
        """Return the password in a line, or None if the line has another form or the parameters cost too much."""
        try:
            name, cost, block, parallel, salt, key = str(text).split(":")
            found = cls(
                int(cost), int(block), int(parallel), *(base64.b64decode(each, validate=True) for each in (salt, key))
            )
        except (ValueError, binascii.Error):
            return None
        is_power = found.cost > 1 and found.cost & (found.cost - 1) == 0
        fits = is_power and found.cost * found.block <= MAX_COST and 1 <= found.block <= 16 and 1 <= found.parallel <= 4
        return found if name == "scrypt" and fits else None

    def fits(self, password: str) -> bool:
        given = hashlib.scrypt(
            password.encode(errors="surrogatepass"),
            salt=self.salt,
            n=self.cost,
            r=self.block,
            p=self.parallel,
            maxmem=1 << 28,
            dklen=32,
        )
        return hmac.compare_digest(given, self.key)


UNKNOWN_USER = KeptPassword(COST, BLOCK, PARALLEL, b"0" * 16, b"")
"""The stored password against which an unknown name is checked if the file has no password."""


def by_password(name: str, password: str, file: Path | None = None) -> bool:
    """True if this is the password of a user. The check of an unknown name, or of a name whose line is malformed, takes
    as long as that of a wrong password: scrypt runs once with the parameters of some user, and for one name that is
    always the same user."""
    read = {user: KeptPassword.parse(text) for user, text in _table("passwords", file).items()}
    known = {user: kept for user, kept in read.items() if kept is not None}
    others = list(known.values()) or [UNKNOWN_USER]
    kept = (
        known.get(name) or others[int.from_bytes(hashlib.sha256(name.encode(errors="replace")).digest()) % len(others)]
    )
    right = kept.fits(password[:MAX_PASSWORD])
    return right and name in known and len(password) <= MAX_PASSWORD


def by_certificate(der: bytes, file: Path | None = None) -> str | None:
    """Return the user to whom the file assigns a certificate (DER), or None if there is no such user. The caller must
    have verified, as TLS does, that the peer has the private key of the certificate."""
    fingerprint = hashlib.sha256(der).hexdigest()
    known = _table("certificates", file)
    return next((name for name, each in known.items() if _plain(each) == fingerprint), None)


def hashed(password: str, salt: bytes | None = None) -> str:
    """Return a password in the form in which the file stores it."""
    salt = os.urandom(16) if salt is None else salt
    key = hashlib.scrypt(password.encode(), salt=salt, n=COST, r=BLOCK, p=PARALLEL, dklen=32)
    texts = (base64.b64encode(each).decode() for each in (salt, key))
    return f"scrypt:{COST}:{BLOCK}:{PARALLEL}:{':'.join(texts)}"


def _plain(fingerprint: Any) -> str:
    """Return a fingerprint in lower case, without the colons of openssl."""
    return str(fingerprint).rpartition("=")[2].replace(":", "").lower()


def _table(name: str, file: Path | None) -> Mapping[str, Any]:
    """Return one table of the file; empty if it cannot be read, which is logged."""
    file = place() if file is None else file
    try:
        found = read_settings(FaceUsers, file, MAX_BYTES, secret=True)
    except OptionError as error:
        log.warning("%s", error)
        return {}
    return {} if found is None else {"passwords": found.passwords, "certificates": found.certificates}[name]


def main() -> int:
    """Ask for a password, and print the line for the file."""
    if sys.argv[1:] in (["--help"], ["-h"]):
        print(f"{USAGE}\nThis command asks for a password twice, and prints the line for {place()}.")
        return 0
    if len(sys.argv) != 2 or sys.argv[1].startswith("-"):
        print(f"give the name of the user: {USAGE}", file=sys.stderr)
        return 2
    password = getpass.getpass()
    if not password or getpass.getpass("Again: ") != password:
        print("no password was entered, or the two entries differ", file=sys.stderr)
        return 2
    print(f"{_quoted(sys.argv[1])} = {_quoted(hashed(password))}")
    return 0


def _quoted(text: str) -> str:
    """Return a text as a basic string of TOML."""
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


if __name__ == "__main__":
    sys.exit(main())
