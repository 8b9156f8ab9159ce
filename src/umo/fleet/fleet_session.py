"""The connection of this process to a fleet: a Zenoh session.

Without anything given it is a peer of this computer only: it listens on 127.0.0.1, and looks for nobody else. With
certificates it speaks TLS, both ends prove who they are, and a list of rules says who may do what.
"""

from __future__ import annotations

import json
import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import zenoh

from umo.errors import OptionError, UmoError, text_of
from umo.fleet import fleet_keys as keys

log = logging.getLogger("umo.fleet")
PORT = 7447
LOCAL = f"tcp/127.0.0.1:{PORT}"
NEARBY = "tcp/127.0.0.1:0"
"""Any free port of this computer: others learn of it."""
LINK_LEASE = 2000
"""Time in ms after which a computer that does not answer is gone."""
KEEP_ALIVES = 4
"""Signs of life in that time."""
CONNECT_TIME = 3000
"""Time in ms in which a router must answer at the start. Later it may be away for any time."""
TOKEN_TIME = 1.0
"""Time in s within which others tell that they are there."""
QUEUE_TIME = 100_000
"""Time in us that a message waits for room at most; then it is dropped."""
CA_FILE, CERTIFICATE_FILE, KEY_FILE = "ca.pem", "certificate.pem", "key.pem"
"""Files of a folder of certificates (`umo fleet certificate`)."""


@dataclass(frozen=True)
class FleetNetwork:
    """How a process reaches the others. `connect`, `listen`: addresses such as `tls/plant.local:7447`; `certificates`:
    folder of its certificate, key and the authority's certificate."""

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
        if self.certificates is not None:
            for name in (CA_FILE, CERTIFICATE_FILE, KEY_FILE):
                if not (self.certificates / name).is_file():
                    raise OptionError(f"{self.certificates} has no {name}; `umo fleet certificate` makes it")

    @property
    def is_local(self) -> bool:
        """Whether nobody on another computer is reached."""
        return all(_is_loopback(address) for address in (*self.connect, *self.listen))

    @property
    def is_proved(self) -> bool:
        """Whether every link proves both ends by certificates."""
        addresses = (*self.connect, *self.listen)
        return bool(addresses) and all(not address.startswith("tcp/") for address in addresses)


def _is_loopback(address: str) -> bool:
    host = address.partition("/")[2].rpartition(":")[0].strip("[]")
    return host in ("localhost", "::1") or host.startswith("127.")


LOCAL_NETWORK = FleetNetwork()


def settings_of(network: FleetNetwork, mode: str, rules: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """The settings of Zenoh for a session. `rules`: its access control."""
    local = not (network.connect or network.listen)
    listen, connect = list(network.listen), list(network.connect)
    if local:
        listen, connect = ([LOCAL] if mode == "router" else [LOCAL, NEARBY]), ([] if mode == "router" else [LOCAL])
    elif mode == "client":
        listen = []
    settings: dict[str, Any] = {
        "mode": mode,
        "listen": {"endpoints": listen, "exit_on_failure": mode == "router" or not local},
        "connect": {"endpoints": connect, "exit_on_failure": mode == "client", "timeout_ms": CONNECT_TIME},
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": True}},
        "transport/link/tx/lease": LINK_LEASE,
        "transport/link/tx/keep_alive": KEEP_ALIVES,
        "transport/link/tx/queue/congestion_control/drop/wait_before_drop": QUEUE_TIME,
    }
    if network.certificates is not None:
        ca, certificate, key = (str(network.certificates / name) for name in (CA_FILE, CERTIFICATE_FILE, KEY_FILE))
        settings["transport/link/tls"] = {
            "root_ca_certificate": ca,
            "listen_certificate": certificate, "listen_private_key": key,
            "connect_certificate": certificate, "connect_private_key": key,
            "enable_mtls": True, "verify_name_on_connect": True, "close_link_on_expiration": True,
        }  # fmt: skip
    if rules is not None:
        settings["access_control"] = dict(rules)
    return settings


def opened(
    network: FleetNetwork = LOCAL_NETWORK, mode: str = "peer", rules: Mapping[str, Any] | None = None
) -> zenoh.Session:
    """A session. UmoError if the address is taken, a certificate is wrong, or the router is not there."""
    config = zenoh.Config()
    try:
        for key, value in settings_of(network, mode, rules).items():
            config.insert_json5(key, json.dumps(value))
        return zenoh.open(config)
    except zenoh.ZError as error:
        where = ", ".join((*network.listen, *network.connect)) or LOCAL
        raise UmoError(f"the fleet cannot be reached by {where}: {_cause(text_of(error))}") from None


def _cause(text: str) -> str:
    """The cause in a message of Zenoh, without the places in its source."""
    return text.split(" at /")[0].split(" - Caused by")[0].strip()


def anybody(session: zenoh.Session, timeout: float = 1.0) -> list[keys.StationKey]:
    """The stations that are present now."""
    found = {keys.station_of(str(each.ok.key_expr))
             for each in session.liveliness().get(keys.EVERY.key(keys.ALIVE), timeout=timeout)
             if each.ok is not None}  # fmt: skip
    return sorted(found)


def is_present(session: zenoh.Session, key: keys.StationKey) -> bool:
    """Whether somebody publishes a station of this name."""
    return any(each.ok is not None for each in session.liveliness().get(key.key(keys.ALIVE), timeout=TOKEN_TIME))
