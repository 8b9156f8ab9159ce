"""The settings of a fleet on this computer, for its gateway and for every command that reaches other stations.

# ~/.config/umo/fleet.toml
site = "cell7"                        # default: that of the certificate, or the name of this computer
connect = ["tls/plant.local:7447"]    # routers, or other computers; default: this computer only
listen = []                           # addresses at which others reach this one
certificates = "~/.config/umo/fleet"  # folder of ca.pem, certificate.pem, key.pem (umo connect certificate)
user = "ann"                          # whose commands these are; default: that of the certificate, or of this computer
[jetstream]                           # see umo.clients.fleet.jetstream_server
"""

from __future__ import annotations

import socket
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

from umo.clients.fleet.fleet_keys import segment
from umo.clients.fleet.fleet_rules import SITE, USER
from umo.clients.fleet.fleet_session import FleetNetwork
from umo.errors import OptionError
from umo.operation.commands import roles
from umo.system.processes import user_name
from umo.text import cut_repr
from umo.wiring.settings import TakenBy, a_text, a_time, a_whole, changed, read_settings

MAX_BYTES = 1 << 16


def _addresses(value: Any) -> Sequence[str]:
    if not isinstance(value, list | tuple) or not all(isinstance(each, str) for each in value):
        raise OptionError(f'must be a list of addresses, such as ["tls/plant.local:7447"], not {cut_repr(value)}')
    return tuple(value)


Addresses = Annotated[Sequence[str], TakenBy(_addresses)]


KEEP, BYTES = 7 * 86400.0, 10_000_000_000
"""Default limits of the stream of a JetStream: age in s, and size in bytes."""


@dataclass(frozen=True)
class JetStreamTable:
    """The table [jetstream] (`umo.clients.fleet.jetstream_server`)."""

    user: str | None = None
    password_file: Annotated[str | None, a_text("a file")] = None
    credentials: Annotated[str | None, a_text("a file")] = None
    keep: Annotated[float, a_time()] = KEEP
    bytes: Annotated[int, a_whole(1)] = BYTES


@dataclass(frozen=True)
class FleetFile:
    """The permitted content of the file."""

    site: Annotated[str | None, a_text("a name")] = None
    connect: Addresses = ()
    listen: Addresses = ()
    certificates: Annotated[str | None, a_text("a folder")] = None
    user: Annotated[str | None, a_text("a name")] = None
    jetstream: JetStreamTable = JetStreamTable()


@dataclass(frozen=True)
class FleetSettings:
    site: str
    network: FleetNetwork
    user: str
    jetstream: JetStreamTable = JetStreamTable()

    @property
    def why_none(self) -> str:
        """Advice for a user who sees no station. Zenoh itself does not report that its rules forbid access."""
        publish, identity = "`umo connect fleet` publishes the stations of a computer", self.network.identity
        if identity is None:
            return publish
        return f"{publish}; the router must have started with rules for {identity}"

    def require(self, kind: str) -> None:
        """Check the kind of the certificate. Raises OptionError if the certificate has another kind."""
        identity = self.network.identity
        if identity is not None and identity.kind != kind:
            raise OptionError(
                f"the certificate in {self.network.certificates} belongs to {identity}; this command needs the "
                f"certificate of a {kind} (umo connect certificate {kind})"
            )


def place() -> Path:
    """Return the path of this user's file: `umo/fleet.toml` in the folder of the file of roles."""
    return roles.place().with_name("fleet.toml")


def load(file: Path | None = None, changes: Mapping[str, Any] | None = None) -> FleetSettings:
    """Return the settings of the file, overridden by those of a command line. The default is this user's file; a
    missing file is taken as empty. Raises OptionError for an error in the file or the command line."""
    given = read_settings(FleetFile, place() if file is None else file, MAX_BYTES) or FleetFile()
    wanted: dict[str, Any] = {
        key: str(value) if isinstance(value, Path) else value for key, value in (changes or {}).items() if value
    }
    if "connect" in wanted or "listen" in wanted:  # all of its addresses, not some of another
        given = replace(given, connect=(), listen=())
    given = changed(given, wanted)
    folder = None if given.certificates is None else Path(given.certificates).expanduser()
    network = FleetNetwork(tuple(given.connect), tuple(given.listen), folder)
    names = {key: segment(name) for key, name in ((SITE, given.site), (USER, given.user)) if name}
    if (identity := network.identity) is not None and names.setdefault(identity.kind, identity.name) != identity.name:
        raise OptionError(
            f"{identity.kind} = {names[identity.kind]!r}, but the certificate in {folder} belongs to {identity}"
        )
    site, user = names.get(SITE) or segment(socket.gethostname()), names.get(USER) or segment(user_name())
    return FleetSettings(site, network, user, given.jetstream)
