"""The rules of a fleet: who may publish, see and command what, enforced by routers and by gateways that listen.

One file, `rules.toml`, has a line for each certificate; `umo connect certificate` adds it. The owner of a certificate
without a line may do nothing:

    router.plant = true                # passes on the messages of others, after a check of their certificates
    site.cell7 = true                  # publishes its own stations, and answers for them
    user.ann = true                    # sees every station, and commands under its own name
    user.bob = ["cell7", "cell8"]      # the same at these sites; of other sites only presence and status
    user.eve = false                   # withdrawn: the name is never used again, because its certificate still exists

The name of a certificate is `KIND:NAME`, as `user:ann`; Zenoh compares it with the key of each message
(its access control). Zenoh reads the rules when it starts.
"""

from __future__ import annotations

import json
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from umo.clients.fleet import fleet_keys as keys
from umo.errors import OptionError
from umo.text import cut_repr, printable
from umo.wiring.settings import TakenBy, read_settings, settings_in

FILE = "rules.toml"
MAX_BYTES = 1 << 22
MAX_NAME = 48
"""Largest number of characters of a name. Together with its kind, a name then has at most 64 characters, which is the
limit of a certificate."""
ROUTER, SITE, USER = "router", "site", "user"
KINDS = (ROUTER, SITE, USER)
READ = ("declare_subscriber", "query", "declare_liveliness_subscriber", "liveliness_query")
COMMAND = ("put", "query")
PUBLISH = (
    "put",
    "delete",
    "reply",
    "declare_queryable",
    "declare_subscriber",
    "declare_liveliness_subscriber",
    "liveliness_token",
)
EVERYTHING = (*PUBLISH, "query", "liveliness_query")
PRESENCE = tuple(f"{keys.ROOT}/{keys.ANY}/{keys.ANY}/{kind}" for kind in (keys.ALIVE, keys.STATUS))
_NAME = re.compile(r"[A-Za-z0-9_][\w.-]*", re.ASCII)


def checked_name(name: str) -> str:
    """Return the name if it is valid for a certificate. Raises OptionError otherwise."""
    if len(name) > MAX_NAME:
        raise OptionError(f"{printable(name[:20])}... has {len(name)} characters; at most {MAX_NAME} are allowed")
    if not _NAME.fullmatch(name):
        raise OptionError(
            f"{printable(name)!r} cannot be a name: a name begins with a letter or digit, and contains only letters, "
            f"digits, _ . -"
        )
    return name


def _is_there(value: Any) -> bool:
    if not isinstance(value, bool):
        raise OptionError(f"the value must be true, or false if the certificate is withdrawn, not {cut_repr(value)}")
    return value


def _open_to(value: Any) -> bool | Sequence[str]:
    """Return the sites that are open to a user; True means all sites. Raises OptionError for an invalid value."""
    if isinstance(value, bool):
        return value
    if not isinstance(value, list) or not value:
        sites = 'true, or false if the certificate is withdrawn, or a list of sites such as ["cell7"]'
        raise OptionError(f"the value must be {sites}, not {cut_repr(value)}")
    return [checked_name(str(site)) for site in value]


RuleName = Annotated[str, TakenBy(checked_name)]


@dataclass(frozen=True)
class RulesFile:
    """The permitted content of the file."""

    router: Mapping[RuleName, Annotated[bool, TakenBy(_is_there)]] = field(default_factory=dict)
    site: Mapping[RuleName, Annotated[bool, TakenBy(_is_there)]] = field(default_factory=dict)
    user: Mapping[RuleName, Annotated[bool | Sequence[str], TakenBy(_open_to)]] = field(default_factory=dict)


@dataclass(frozen=True)
class FleetRules:
    """The accepted certificates. `users`: each user with the sites that they may access."""

    routers: Sequence[str] = ()
    sites: Sequence[str] = ()
    users: Mapping[str, Sequence[str]] = field(default_factory=dict)
    withdrawn: Collection[str] = ()
    """Withdrawn certificates, each as `user:eve`."""

    @classmethod
    def load(cls, file: Path) -> FleetRules:
        """Read the rules from a file. Raises OptionError if the file is missing or wrong."""
        if (found := read_settings(RulesFile, file, MAX_BYTES)) is None:
            raise OptionError(
                f"{file} is missing: without rules no certificate proves a name; copy it from the authority's folder"
            )
        return cls._of(found)

    @classmethod
    def parse(cls, text: str, file: Path) -> FleetRules:
        """Parse the text of a file of rules. Raises OptionError if it has an error."""
        return cls._of(settings_in(RulesFile, text.encode(), file))

    @classmethod
    def _of(cls, found: RulesFile) -> FleetRules:
        there = {ROUTER: found.router, SITE: found.site, USER: found.user}
        users = {name: [keys.ANY] if value is True else list(value) for name, value in found.user.items() if value}
        withdrawn = {f"{kind}:{name}" for kind, names in there.items() for name, value in names.items() if not value}
        routers, sites = ([name for name, value in there[kind].items() if value] for kind in (ROUTER, SITE))
        return cls(routers, sites, users, withdrawn)

    def has(self, kind: str, name: str) -> bool:
        return name in {ROUTER: self.routers, SITE: self.sites, USER: self.users}[kind]

    def settings(self) -> dict[str, Any]:
        """Return the settings of Zenoh's access control. A certificate that the rules do not name has no rights."""
        rules, subjects, policies = [_rule("seen by all", EVERYTHING, ["**"], "egress")], [], []

        def allow(kind: str, name: str, *allowed: tuple[Sequence[str], Sequence[str]]) -> None:
            this = f"{kind}:{name}"
            own = [_rule(f"{this} {number}", *each) for number, each in enumerate(allowed)]
            rules.extend(own)
            subjects.append({"id": this, "cert_common_names": [this]})
            policies.append({"rules": [rules[0]["id"], *(each["id"] for each in own)], "subjects": [this]})

        for name in self.routers:
            allow(ROUTER, name, (EVERYTHING, ["**"]))
        for name in self.sites:
            allow(SITE, name, (PUBLISH, [f"{keys.ROOT}/{name}/**"]))
        for name, sites in self.users.items():
            commands = [f"{keys.ROOT}/{site}/*/{key}" for site in sites
                        for key in (f"{keys.COMMAND}/{name}", f"{keys.SIGN}/{name}/*")]  # fmt: skip
            allow(USER, name, (READ, [*PRESENCE, *seen_at(sites)]), (COMMAND, commands))
        return _access(rules, subjects, policies)


def seen_at(sites: Sequence[str]) -> list[str]:
    """Return the keys that a user may query if only the stations of these sites are open to the user. They are all keys
    with one word after the station, which excludes commands."""
    return [f"{keys.ROOT}/{site}/*/*" for site in sites]


def reading_only() -> dict[str, Any]:
    """Return the access control for a network without proof of identity. Every computer may publish and see, and none
    may command."""
    seen = seen_at([keys.ANY])
    rules = [_rule("in", EVERYTHING, seen), _rule("out", EVERYTHING, seen, "egress")]
    return _access(rules, [{"id": "everybody"}], [{"rules": ["in", "out"], "subjects": ["everybody"]}])


def key_of(kind: str, name: str) -> str:
    """Return the beginning of the line for a certificate."""
    return f"{kind}.{name}" if re.fullmatch(r"[\w-]+", name, re.ASCII) else f'{kind}."{name}"'


def line_of(kind: str, name: str, sites: Sequence[str] = (), *, withdrawn: bool = False) -> str:
    """Return the line for a certificate."""
    value = json.dumps(list(sites)) if sites else json.dumps(not withdrawn)
    return f"{key_of(kind, name)} = {value}\n"


def _rule(name: str, messages: Sequence[str], allowed: Sequence[str], flow: str = "ingress") -> dict[str, Any]:
    return {"id": name, "messages": list(messages), "flows": [flow], "permission": "allow", "key_exprs": list(allowed)}


def _access(rules: list[Any], subjects: list[Any], policies: list[Any]) -> dict[str, Any]:
    return {
        "enabled": True, "default_permission": "deny",
        "rules": rules, "subjects": subjects, "policies": policies,
    }  # fmt: skip
