"""The settings of a fleet on this computer, for its gateway and for every command that reaches other stations.

# ~/.config/umo/fleet.toml
site = "cell7"                        # default: that of the certificate, or the name of this computer
connect = ["tls/plant.local:7447"]    # routers, or other computers; default: this computer only
listen = []                           # addresses at which others reach this one
certificates = "~/.config/umo/fleet"  # folder of ca.pem, certificate.pem, key.pem (umo fleet certificate)
user = "ann"                          # whose commands these are; default: that of the certificate, or of this computer
[jetstream]                           # see umo.fleet.jetstream_server
"""

from __future__ import annotations

import socket
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from umo.errors import OptionError
from umo.fleet.fleet_keys import segment
from umo.fleet.fleet_rules import SITE, USER
from umo.fleet.fleet_session import FleetNetwork
from umo.system import roles
from umo.system.processes import user_name
from umo.text import did_you_mean

KEYS = ("site", "connect", "listen", "certificates", "user", "jetstream")
MAX_BYTES = 1 << 16


@dataclass(frozen=True)
class FleetSettings:
    site: str
    network: FleetNetwork
    user: str
    jetstream: Mapping[str, Any] = field(default_factory=dict)
    """The table [jetstream] (`umo.fleet.jetstream_server`)."""

    @property
    def why_none(self) -> str:
        """What to do where no station is seen: what rules forbid, Zenoh tells nobody."""
        publish, identity = "`umo fleet serve` publishes those of a computer", self.network.identity
        if identity is None:
            return publish
        return f"{publish}; the router must have started with rules for {identity}"

    def require(self, kind: str) -> None:
        """OptionError if the certificate is of another kind."""
        identity = self.network.identity
        if identity is not None and identity.kind != kind:
            raise OptionError(
                f"the certificate in {self.network.certificates} is of {identity}; this needs that of a {kind} "
                f"(umo fleet certificate {kind})"
            )


def place() -> Path:
    """The file of this user: `umo/fleet.toml` beside the file of roles."""
    return roles.place().with_name("fleet.toml")


def load(file: Path | None = None, changes: Mapping[str, Any] | None = None) -> FleetSettings:
    """The settings of the file (default: that of this user; a missing one is empty), with what a command line changes.
    OptionError for a mistake in either."""
    file = place() if file is None else file
    changes = {key: value for key, value in (changes or {}).items() if value}
    given = _read(file)
    if "connect" in changes or "listen" in changes:  # all of its addresses, not some of another
        given = {key: value for key, value in given.items() if key not in ("connect", "listen")}
    given |= changes
    for key in given:
        if key not in KEYS:
            raise OptionError(f"{file}: there is no {key!r}{did_you_mean(key, KEYS)}; there are {', '.join(KEYS)}")
    folder = given.get("certificates")
    network = FleetNetwork(
        _addresses(given, "connect"),
        _addresses(given, "listen"),
        None if folder is None else Path(_text(given, "certificates")).expanduser(),
    )
    names = {key: segment(_text(given, key)) for key in (SITE, USER) if key in given}
    if (identity := network.identity) is not None and names.setdefault(identity.kind, identity.name) != identity.name:
        raise OptionError(
            f"{identity.kind} = {names[identity.kind]!r}, and the certificate in {folder} is of {identity}"
        )
    site, user = names.get(SITE) or segment(socket.gethostname()), names.get(USER) or segment(user_name())
    jetstream = given.get("jetstream", {})
    if not isinstance(jetstream, dict):
        raise OptionError(f"jetstream = {jetstream!r} is not a table, [jetstream]")
    return FleetSettings(site, network, user, jetstream)


def _read(file: Path) -> dict[str, Any]:
    try:
        with open(file, "rb") as stream:
            data = stream.read(MAX_BYTES + 1)
    except FileNotFoundError:
        return {}
    except OSError as error:
        raise OptionError(f"{file} cannot be read: {error.strerror}") from None
    try:
        if len(data) > MAX_BYTES:
            raise ValueError(f"it is longer than {MAX_BYTES} bytes")
        return tomllib.loads(data.decode())
    except ValueError as error:
        raise OptionError(f"{file}: {error}") from None


def _text(given: Mapping[str, Any], key: str) -> str:
    value = given[key]
    if not isinstance(value, str | Path) or not str(value).strip():
        raise OptionError(f"{key} = {value!r} is not a text")
    return str(value)


def _addresses(given: Mapping[str, Any], key: str) -> Sequence[str]:
    value = given.get(key, ())
    if isinstance(value, str) or not all(isinstance(each, str) for each in value):
        raise OptionError(f'{key} = {value!r} is not a list of addresses, as ["tls/plant.local:7447"]')
    return tuple(value)
