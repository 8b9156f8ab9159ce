"""The connection of this process to a fleet: a Zenoh session.

Without settings the session is a peer for this computer only: it listens on 127.0.0.1 and connects to no other
computer. With certificates it uses TLS, both ends prove who they are, and the side that listens enforces the rules
(`umo.clients.fleet.fleet_rules`). Without certificates other computers may see the stations, but no computer may
command.
"""

from __future__ import annotations

import json
import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import zenoh

from umo.clients.faces.endpoint import is_local
from umo.clients.fleet import fleet_keys as keys
from umo.clients.fleet import fleet_rules
from umo.clients.fleet.fleet_diagnosis import NOBODY_ANSWERS, SILENT, why_not
from umo.clients.fleet.fleet_identity import CA_FILE, CERTIFICATE_FILE, KEY_FILE, Identity, identity_of
from umo.clients.fleet.fleet_rules import FleetRules
from umo.errors import OptionError, UmoError, text_of

log = logging.getLogger("umo.fleet")
PORT = 7447
LOCAL = f"tcp/127.0.0.1:{PORT}"
NEARBY = "tcp/127.0.0.1:0"
"""The address with any free port of this computer. Other processes discover it."""
LINK_LEASE = 2000
"""Time in ms after which a computer that does not answer counts as disconnected."""
KEEP_ALIVES = 4
"""Number of heartbeats within `LINK_LEASE`."""
CONNECT_TIME = 3000
"""Time in ms within which a router must answer at the start. Later the router may be unreachable for any time."""
RETRY = {"period_init_ms": 250, "period_max_ms": 1000, "period_increase_factor": 2}
"""Pauses in ms between attempts to reach a router that is away."""
TOKEN_TIME = 1.0
"""Time in s within which stations announce that they are present."""
QUEUE_TIME = 100_000
"""Longest time in us that a message waits for room in the queue. After that it is dropped."""


class FleetAway(UmoError):
    """Raised if none of the addresses answers, which may be temporary."""


@dataclass(frozen=True)
class FleetNetwork:
    """The network settings of a process. `connect`, `listen`: addresses such as `tls/plant.local:7447`; `certificates`:
    folder with the certificate and key of the process, and with the authority's certificate."""

    connect: Sequence[str] = ()
    listen: Sequence[str] = ()
    certificates: Path | None = None

    def __post_init__(self) -> None:
        for address in (*self.connect, *self.listen):
            protocol, slash, rest = address.partition("/")
            if not slash or protocol not in ("tcp", "tls", "quic") or ":" not in rest:
                raise OptionError(f"{address!r} is not an address of a fleet; write tls/HOST:PORT, or tcp/HOST:PORT")
            if protocol != "tcp" and self.certificates is None:
                raise OptionError(f"{address}: {protocol} needs the folder of certificates (--certificates)")
        protocols = {address.startswith("tcp/") for address in (*self.connect, *self.listen)}
        if len(protocols) > 1:
            raise OptionError("tcp and tls cannot be combined, because a connection over tcp proves no identity")
        if self.is_proved and self.certificates is not None:
            identity_of(self.certificates)

    @property
    def identity(self) -> Identity | None:
        """The identity that the certificates prove, or None if no certificates are used."""
        return identity_of(self.certificates) if self.certificates is not None and self.is_proved else None

    @property
    def is_local(self) -> bool:
        """True if no other computer is reached."""
        return all(_is_loopback(address) for address in (*self.connect, *self.listen))

    @property
    def is_proved(self) -> bool:
        """True if every link proves both ends by certificates."""
        addresses = (*self.connect, *self.listen)
        return bool(addresses) and all(not address.startswith("tcp/") for address in addresses)


def _is_loopback(address: str) -> bool:
    return is_local(address.partition("/")[2].rpartition(":")[0].strip("[]"))


def rules_of(network: FleetNetwork, mode: str) -> dict[str, Any] | None:
    """Return the access control for a process that listens. Raises OptionError if a network with certificates has no
    rules, because without rules no name is proved. A client that connects relies on the rules of the router. The
    router's certificate proves the router's host."""
    if mode == "client":
        return None
    if network.is_proved and network.certificates is not None:
        return FleetRules.load(network.certificates / fleet_rules.FILE).settings() if network.listen else None
    return None if network.is_local else fleet_rules.reading_only()


LOCAL_NETWORK = FleetNetwork()


def settings_of(network: FleetNetwork, mode: str) -> dict[str, Any]:
    """Return the settings of Zenoh for a session."""
    local = not (network.connect or network.listen)
    listen, connect = list(network.listen), list(network.connect)
    if local:
        listen, connect = ([LOCAL] if mode == "router" else [LOCAL, NEARBY]), ([] if mode == "router" else [LOCAL])
    elif mode == "client":
        listen = []
    settings: dict[str, Any] = {
        "mode": mode,
        "listen": {"endpoints": listen, "exit_on_failure": mode == "router" or not local},
        "connect": {
            "endpoints": connect,
            "exit_on_failure": mode == "client",
            "timeout_ms": CONNECT_TIME,
            "retry": RETRY,
        },
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": True}},
        "transport/link/tx/lease": LINK_LEASE,
        "transport/link/tx/keep_alive": KEEP_ALIVES,
        "transport/link/tx/queue/congestion_control/drop/wait_before_drop": QUEUE_TIME,
    }
    if network.certificates is not None and network.is_proved:
        ca, certificate, key = (str(network.certificates / name) for name in (CA_FILE, CERTIFICATE_FILE, KEY_FILE))
        settings["transport/link/tls"] = {
            "root_ca_certificate": ca,
            "listen_certificate": certificate, "listen_private_key": key,
            "connect_certificate": certificate, "connect_private_key": key,
            "enable_mtls": True, "verify_name_on_connect": True, "close_link_on_expiration": True,
        }  # fmt: skip
    if (rules := rules_of(network, mode)) is not None:
        settings["access_control"] = rules
    return settings


def opened(network: FleetNetwork = LOCAL_NETWORK, mode: str = "peer") -> zenoh.Session:
    """Open a session. Raises FleetAway if the router does not answer, and UmoError if the address is in use or a
    certificate is wrong."""
    settings = settings_of(network, mode)
    config = zenoh.Config()
    try:
        for key, value in settings.items():
            config.insert_json5(key, json.dumps(value))
        return zenoh.open(config)
    except zenoh.ZError as error:
        kind, cause = _cause(network, text_of(error))
        raise kind(f"the fleet cannot be reached by {cause}") from None


def opened_client(network: FleetNetwork) -> zenoh.Session:
    """Open a session for a process that only reads and commands. The process does not accept connections from other
    computers."""
    return opened(replace(network, listen=()), "client" if network.connect else "peer")


def _cause(network: FleetNetwork, text: str) -> tuple[type[UmoError], str]:
    """Return the class of the error, and its text: the failing address and the cause. The cause is found by a second
    attempt to connect, or is a message of Zenoh without the places in Zenoh's source."""
    addresses = (*network.listen, *network.connect)
    if "Unable to connect" in text and network.connect:
        why = {each: why_not(each, network.certificates) for each in network.connect}
        kind = FleetAway if set(why.values()) <= {NOBODY_ANSWERS, SILENT} else UmoError
        return kind, "; ".join(f"{address}: {each}" for address, each in why.items())
    return UmoError, f"{', '.join(addresses) or LOCAL}: {text.split(' at /')[0].split(' - Caused by')[0].strip()}"


def anybody(session: zenoh.Session) -> list[keys.StationKey]:
    """Return the stations that are present now."""
    found = {keys.station_of(str(each.ok.key_expr))
             for each in session.liveliness().get(keys.EVERY.key(keys.ALIVE), timeout=1.0)
             if each.ok is not None}  # fmt: skip
    return sorted(found)


def is_present(session: zenoh.Session, key: keys.StationKey) -> bool:
    """True if a station of this name is published."""
    return any(each.ok is not None for each in session.liveliness().get(key.key(keys.ALIVE), timeout=TOKEN_TIME))
