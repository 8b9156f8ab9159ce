"""`umo connect certificate`: what its commands do and print."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path

from umo.clients.fleet.fleet_certificates import AUTHORITY, Authority
from umo.clients.fleet.fleet_identity import Identity
from umo.clients.fleet.fleet_rules import FILE, ROUTER, SITE, USER, FleetRules
from umo.errors import OptionError
from umo_command.console import out, plain_table

USES = {
    ROUTER: "umo connect router --listen tls/0.0.0.0:7447 --certificates {0}",
    SITE: "umo connect fleet --commands --connect tls/ROUTER:7447 --certificates {0}",
    USER: 'certificates = "{0}" in ~/.config/umo/fleet.toml, with connect = ["tls/ROUTER:7447"]',
}


def make_authority(folder: Path) -> int:
    folder = folder.expanduser()
    Authority.create(folder)
    _print(f"the authority of a fleet is in {folder / AUTHORITY}; its key.pem stays on this computer")
    _print("next: umo connect certificate router, site, user")
    return 0


def make(folder: Path, kind: str, name: str, hosts: Sequence[str] = (), sites: Sequence[str] = ()) -> int:
    """Issue a certificate and print what to do with it."""
    if kind == ROUTER and not hosts:
        raise OptionError("a router needs the name or address at which other computers reach it: --host plant.local")
    authority = Authority(folder.expanduser())
    target = authority.issue(kind, name, hosts, sites)
    _print(
        f"the certificate of {kind}:{name} is in {target}: copy this folder to the computer that uses the "
        f"certificate, and use it there:"
    )
    _print(f"  {USES[kind].format(target)}")
    _tell_servers(authority)
    return 0


def withdraw_rule(folder: Path, name: str) -> int:
    authority = Authority(folder.expanduser())
    _print(f"the certificate of {authority.withdraw(name)} is withdrawn")
    _tell_servers(authority)
    return 0


def list_issued(folder: Path) -> int:
    authority = Authority(folder.expanduser())
    rules, table, now = authority.rules, plain_table(), time.time()
    for heading in ("whose", "until", "hosts", ""):
        table.add_column(heading)
    for identity, _ in authority.issued():
        table.add_row(str(identity), identity.until, ", ".join(identity.hosts), _remark(identity, rules, now))
    out.print(table) if table.row_count else _print("no certificate was issued")
    return 0


def _remark(identity: Identity, rules: FleetRules, now: float) -> str:
    if not rules.has(identity.kind, identity.name):
        return "withdrawn"
    if identity.expires <= now:
        return "expired"
    return "expires soon" if identity.is_soon_over(now) else ""


def _tell_servers(authority: Authority) -> None:
    """Print that the servers need the new rules."""
    servers = [str(identity) for identity, _ in authority.issued() if identity.hosts]
    if servers:
        _print(
            f"the rules have changed: the folders of {', '.join(servers)} on this computer have the new rules. Copy "
            f"{authority.folder / FILE} to the folders of routers and sites on other computers, and restart these"
        )


def _print(text: str) -> None:
    out.print(text, soft_wrap=True, highlight=False, markup=False)
