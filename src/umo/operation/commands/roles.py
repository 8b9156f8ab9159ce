"""The policy that says which user may give which command, for pages, faces, fleets and all other ways of commands.

The user who runs a machine may give every command. A caller proves to be this user through files and sockets that only
this user may open, or through the account of the process at the other end of a connection (`umo.system.peer_account`),
never through an address. All other users may see the machine, and have the role that a file of this user gives them:

    # ~/.config/umo/roles.toml
    [users]             # whose names are proved: by a password, a certificate, their account of this computer
    ann = "maintain"
    bob = "operate"
    "*" = "see"         # everybody else

    [unverified]        # the roles of users in ways that prove no name
    page = "operate"    # everybody who has the token of the page
    homeassistant = "tune"

Each role includes the roles before it: see, tune, operate, maintain. If the file cannot be read or has an error, all
other users have the role "see" only.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from umo.errors import OptionError
from umo.operation.commands.verb import Role
from umo.operation.commands.verbs import VERBS
from umo.text import did_you_mean, printable
from umo.wiring.settings import TakenBy, read_settings

MAX_BYTES = 1 << 20
"""Largest number of bytes of the file."""
ANYBODY = "*"
"""The entry for all users, or ways, that are not named."""
ABOUT = "(docs/security.md)"
PAGE = "page"
"""The way of commands that arrive through a page."""


def _role(name: Any) -> Role:
    names = {str(role): role for role in Role}
    if name not in list(names):
        raise OptionError(f"there is no role {name!r}{did_you_mean(str(name), names)}; there are: {', '.join(names)}")
    return names[name]


RoleByName = Mapping[str, Annotated[Role, TakenBy(_role)]]


@dataclass(frozen=True)
class RolesFile:
    """The tables of the file."""

    users: RoleByName = field(default_factory=dict)
    unverified: RoleByName = field(default_factory=dict)


@dataclass(frozen=True)
class Caller:
    """The caller of a command. `way`: how the command arrives, as in events: page, fleet, the name of a face."""

    way: str
    name: str
    is_proved: bool = False
    """True if the name is proved."""
    is_owner: bool = False
    """True if the caller is proved to be the user who runs the machine."""


class Roles:
    """The tables of one file. `mistake`: the reason why the file cannot be used."""

    def __init__(
        self,
        users: Mapping[str, Role] | None = None,
        unverified: Mapping[str, Role] | None = None,
        mistake: str = "",
    ) -> None:
        self._users, self._unverified = users or {}, unverified or {}
        self.mistake = mistake

    @classmethod
    def load(cls, file: Path | None = None) -> Roles:
        """Read the file (default: the file of this user). This function raises no error."""
        try:
            found = read_settings(RolesFile, place() if file is None else file, MAX_BYTES)
        except OptionError as error:
            return cls(mistake=printable(str(error)))
        return cls() if found is None else cls(found.users, found.unverified)

    def refusal(self, caller: Caller, command: str) -> str | None:
        """Return why a caller may not give a command; None if they may. An unknown verb needs the last role."""
        needed = VERBS[command].role if command in VERBS else Role.MAINTAIN
        role = self.of(caller)
        if role >= needed:
            return None
        if self.mistake:
            return f"{command} is not allowed while the roles cannot be read: {self.mistake}"
        who = printable(caller.name) or "a user without a name"
        if caller.is_proved:
            return f"{who} has the role {role}; {command} needs the role {needed} in [users] of roles.toml {ABOUT}"
        return (
            f"{who}, unverified, has the role {role}; {command} needs the role {needed}: {printable(caller.way)} in "
            f"[unverified] of roles.toml {ABOUT}"
        )

    def of(self, caller: Caller) -> Role:
        """Return the role of a caller. A name that is not proved may reduce the role of its way, but never extends
        it."""
        if caller.is_owner:
            return Role.MAINTAIN
        if caller.is_proved:
            return self._users.get(caller.name, self._users.get(ANYBODY, Role.SEE))
        most = self._unverified.get(caller.way, self._unverified.get(ANYBODY, Role.SEE))
        return min(most, self._users.get(caller.name, most))


EVERYBODY = Roles({ANYBODY: Role.MAINTAIN}, {ANYBODY: Role.MAINTAIN})
"""The roles with which everybody may give every command, for tests and kits."""


def place() -> Path:
    """Return the file of this user: `umo/roles.toml` in the folder of settings (XDG_CONFIG_HOME, default ~/.config)."""
    given = os.environ.get("XDG_CONFIG_HOME", "")
    folder = Path(given) if given.startswith("/") else Path(os.path.expanduser("~")) / ".config"
    return folder / "umo" / "roles.toml"
