"""Who may give which command: the one policy of pages, faces, fleets and whatever else takes commands of others.

The user who runs a machine may give every command. That a caller is this user is proved: by files and sockets that only
this user may open, or by the account of the process at the other end of a connection (`umo.system.peer_account`); never
by an address. Everybody else may see, and beyond that what one file of this user gives them:

    # ~/.config/umo/roles.toml
    [users]             # whose names are proved: by a password, a certificate, their account of this computer
    ann = "maintain"
    bob = "operate"
    "*" = "see"         # everybody else

    [unverified]        # ways that prove no name: what everybody may who gets in there
    page = "operate"    # whoever has the token that was given
    homeassistant = "tune"

A role includes those before it: see, tune, operate, maintain. A file that cannot be read, or is wrong, allows nobody
else anything but to see.
"""

from __future__ import annotations

import os
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from typing import Any

from umo.errors import OptionError
from umo.text import did_you_mean, printable

MAX_BYTES = 1 << 20
"""Bytes of the file at most."""
ANYBODY = "*"
"""The user, or the way, that stands for all that are not named."""
TABLES = ("users", "unverified")
ABOUT = "(docs/security.md)"
PAGE = "page"
"""The way of commands that come by a page."""


class Role(IntEnum):
    """What a user may do; each includes those before it."""

    SEE = 0
    TUNE = 1
    OPERATE = 2
    MAINTAIN = 3

    def __str__(self) -> str:
        return self.name.lower()


NEEDED: Mapping[str, Role] = {
    "lease": Role.TUNE,
    "give back": Role.TUNE,
    "tune": Role.TUNE,
    "stop": Role.OPERATE,
    "mode": Role.OPERATE,
    "write": Role.OPERATE,
    "let go": Role.OPERATE,
    "call": Role.OPERATE,
    "cancel": Role.OPERATE,
    "acknowledge": Role.OPERATE,
    "clear": Role.OPERATE,
    "acknowledge alarm": Role.OPERATE,
    "reset alarm": Role.OPERATE,
    "shelve": Role.MAINTAIN,
    "unshelve": Role.MAINTAIN,
    "remove from service": Role.MAINTAIN,
    "return to service": Role.MAINTAIN,
}
"""The role that each command of clients needs; one that is not listed needs the last."""


@dataclass(frozen=True)
class Caller:
    """Who gives a command. `way`: how it comes, as events tell it: page, fleet, the name of a face."""

    way: str
    name: str
    is_proved: bool = False
    """Whether the name is proved."""
    is_owner: bool = False
    """Whether it is proved that this is the user who runs the machine."""


class Roles:
    """The tables of one file. `mistake`: why it cannot be used."""

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
        """Read the file; default: that of this user. It raises nothing."""
        file = place() if file is None else file
        try:
            with open(file, "rb", opener=_without_waiting) as stream:
                data = stream.read(MAX_BYTES + 1)
            if len(data) > MAX_BYTES:
                raise OptionError(f"it has more than {MAX_BYTES} bytes")
            users, unverified = _tables(tomllib.loads(data.decode()))
            return cls(users, unverified)
        except (OSError, ValueError, RecursionError, OptionError) as error:
            if isinstance(error, FileNotFoundError) and not file.is_symlink():  # nor a link that leads nowhere
                return cls()
            return cls(mistake=printable(f"{file}: {error}"))

    def refusal(self, caller: Caller, command: str) -> str | None:
        """Why a caller may not give a command; None: they may."""
        needed = NEEDED.get(command, Role.MAINTAIN)
        role = self.of(caller)
        if role >= needed:
            return None
        if self.mistake:
            return f"{command} is not allowed while the roles cannot be read: {self.mistake}"
        who = printable(caller.name) or "a user without a name"
        if caller.is_proved:
            return f"{who} may {role}; {command} needs the role {needed} in [users] of roles.toml {ABOUT}"
        return (
            f"{who}, unverified, may {role}; {command} needs the role {needed}: "
            f"{printable(caller.way)} in [unverified] of roles.toml {ABOUT}"
        )

    def of(self, caller: Caller) -> Role:
        """The role of a caller. A name that is not proved may take from the role of its way, and adds nothing."""
        if caller.is_owner:
            return Role.MAINTAIN
        if caller.is_proved:
            return self._users.get(caller.name, self._users.get(ANYBODY, Role.SEE))
        most = self._unverified.get(caller.way, self._unverified.get(ANYBODY, Role.SEE))
        return min(most, self._users.get(caller.name, most))


EVERYBODY = Roles({ANYBODY: Role.MAINTAIN}, {ANYBODY: Role.MAINTAIN})
"""Roles with which everybody may give every command: for tests and kits."""


def place() -> Path:
    """The file of this user: `umo/roles.toml` in the folder of settings (XDG_CONFIG_HOME, default ~/.config)."""
    given = os.environ.get("XDG_CONFIG_HOME", "")
    folder = Path(given) if given.startswith("/") else Path(os.path.expanduser("~")) / ".config"
    return folder / "umo" / "roles.toml"


def _without_waiting(path: str, flags: int) -> int:
    """A pipe in the file's place does not block."""
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


def _tables(given: Mapping[str, Any]) -> list[dict[str, Role]]:
    """OptionError for another form."""
    for key in given:
        if key not in TABLES:
            raise OptionError(f"there is no {key!r}{did_you_mean(key, TABLES)}; there are [users] and [unverified]")
    return [_roles(name, given.get(name, {})) for name in TABLES]


def _roles(table: str, given: Any) -> dict[str, Role]:
    if not isinstance(given, Mapping):
        raise OptionError(f"[{table}] gives names their roles")
    names = {str(role): role for role in Role}
    for user, role in given.items():
        if role not in list(names):
            raise OptionError(
                f"{user}: no role {role!r}{did_you_mean(str(role), names)}; there are: {', '.join(names)}"
            )
    return {user: names[role] for user, role in given.items()}
