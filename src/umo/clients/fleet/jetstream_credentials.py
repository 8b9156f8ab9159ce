"""The credentials for a nats-server: a user with a password, or a file of credentials (`.creds`)."""

from __future__ import annotations

import base64
import binascii
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from umo.clients.fleet.fleet_settings import JetStreamTable
from umo.errors import OptionError

MAX_BYTES = 1 << 16
_JWT = re.compile(r"-+BEGIN NATS USER JWT-+\s+([\w.-]+)\s")
_SEED = re.compile(r"-+BEGIN USER NKEY SEED-+\s+(SU[A-Z2-7]{56})\s")
_ENVIRONMENT = "UMO_JETSTREAM_"


@dataclass(frozen=True, repr=False)
class Credentials:
    """The credentials. `token`: the user, signed by the authority; `seed`: the 32 bytes of the key that proves the
    user."""

    user: str | None = None
    password: str | None = None
    token: str | None = None
    seed: bytes = b""

    @classmethod
    def load(cls, given: JetStreamTable, environ: Mapping[str, str]) -> Credentials:
        """Return the credentials in the environment, or else those in the table [jetstream] of fleet.toml. Raises
        OptionError for a file that does not exist, or that other users may read."""
        file = environ.get(f"{_ENVIRONMENT}CREDENTIALS") or given.credentials
        user = environ.get(f"{_ENVIRONMENT}USER") or given.user
        password = environ.get(f"{_ENVIRONMENT}PASSWORD")
        if password is None and given.password_file is not None:
            password = (_secret(given.password_file).splitlines() or [""])[0]
        if file and (user or password):
            raise OptionError("[jetstream]: give credentials, or a user with a password, not both")
        if bool(user) != bool(password):
            raise OptionError("[jetstream]: give both a user and a password (password_file), or neither")
        if not file:
            return cls(user, password or None)
        text = _secret(file) + "\n"
        token, seed = _JWT.search(text), _SEED.search(text)
        if token is None or seed is None:
            raise OptionError(f"{file} is not a file of credentials: it has no NATS USER JWT with a USER NKEY SEED")
        return cls(token=token[1], seed=_seed(seed[1], file))

    def options(self) -> dict[str, Any]:
        """Return the options for nats-py."""
        if self.token is not None:
            token = self.token.encode()
            return {"user_jwt_cb": lambda: bytearray(token), "signature_cb": self._sign}
        return {} if self.user is None else {"user": self.user, "password": self.password}

    def _sign(self, nonce: str) -> bytes:
        return base64.b64encode(Ed25519PrivateKey.from_private_bytes(self.seed).sign(nonce.encode()))


NOBODY = Credentials()


def _seed(text: str, file: object) -> bytes:
    """Return the 32 bytes of the key in a seed `SU...`. In the seed, two bytes of its kind stand before the key, and
    two bytes of a checksum stand behind it."""
    data = base64.b32decode(text + "=" * (-len(text) % 8))
    if binascii.crc_hqx(data[:-2], 0) != int.from_bytes(data[-2:], "little"):
        raise OptionError(f"{file}: the seed is damaged")
    return data[2:-2]


def _secret(file: str) -> str:
    """Return the text of a file. Raises OptionError if other users may read the file."""
    path = Path(file).expanduser()
    try:
        if path.stat().st_mode & 0o077:
            raise OptionError(f"{path}: other users can read the file; chmod 600 {path}")
        with path.open(encoding="utf-8") as stream:
            return stream.read(MAX_BYTES)
    except (OSError, ValueError) as error:
        raise OptionError(f"{path} cannot be read: {getattr(error, 'strerror', None) or 'it is not text'}") from None
