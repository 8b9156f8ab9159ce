"""Roles: which commands a user may give to machines, from one file of this user who runs them.

    # ~/.config/umo/roles.toml
    [users]
    ann = "maintain"
    bob = "operate"
    "*" = "see"         # everybody else

A role includes those before it: see, tune, operate, maintain. Without a file everybody may give every command. The
user who runs a machine may always: their own programs on this computer are not asked. What cannot be read, or is
wrong, allows nobody else anything but to see.
"""

from __future__ import annotations

import os
import tomllib
from collections.abc import Mapping
from enum import IntEnum
from pathlib import Path
from typing import Any

from umo.errors import OptionError
from umo.text import did_you_mean, printable

MAX_BYTES = 1 << 20
"""Bytes of the file at most."""
ANYBODY = "*"
"""The user who stands for all that are not named."""


class Role(IntEnum):
    """What a user may do; each includes those before it."""

    SEE = 0
    TUNE = 1
    OPERATE = 2
    MAINTAIN = 3

    def __str__(self) -> str:
        return self.name.lower()


NEEDED: Mapping[str, Role] = {
    "stop": Role.SEE,
    "lease": Role.TUNE,
    "give back": Role.TUNE,
    "tune": Role.TUNE,
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
"""The role that each command of clients needs; one that is not listed needs the last. Anybody may stop a machine."""


class Roles:
    """The table of one file. `mistake`: why it cannot be used."""

    def __init__(self, users: Mapping[str, Role] | None, mistake: str = "") -> None:
        self._users = users
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
            return cls(_users(tomllib.loads(data.decode())))
        except (OSError, ValueError, RecursionError, OptionError) as error:
            if isinstance(error, FileNotFoundError) and not file.is_symlink():  # nor a link that leads nowhere
                return cls(None)
            return cls({}, printable(f"{file}: {error}"))

    @property
    def is_absent(self) -> bool:
        """Whether there is no file: then everybody may give every command."""
        return self._users is None

    def allowed(self, user: str, command: str) -> str | None:
        """Why a user may not give a command; None: they may."""
        if self._users is None:
            return None
        needed = NEEDED.get(command, Role.MAINTAIN)
        role = self._users.get(user, self._users.get(ANYBODY, Role.SEE))
        if role >= needed:
            return None
        if self.mistake:
            return f"{command} is not allowed while the roles cannot be read: {self.mistake}"
        return f"{printable(user) or 'a user without a name'} may {role}; {command} needs the role {needed}"


def place() -> Path:
    """The file of this user: `umo/roles.toml` in the folder of settings (XDG_CONFIG_HOME, default ~/.config)."""
    given = os.environ.get("XDG_CONFIG_HOME", "")
    folder = Path(given) if given.startswith("/") else Path(os.path.expanduser("~")) / ".config"
    return folder / "umo" / "roles.toml"


def _without_waiting(path: str, flags: int) -> int:
    """A pipe in the file's place does not block."""
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


def _users(given: Mapping[str, Any]) -> dict[str, Role]:
    """OptionError for another form."""
    for key in given:
        if key != "users":
            raise OptionError(f"there is no {key!r}{did_you_mean(key, ['users'])}; there is [users]")
    users = given.get("users", {})
    if not isinstance(users, Mapping):
        raise OptionError("[users] gives names their roles")
    names = {str(role): role for role in Role}
    for user, role in users.items():
        if role not in list(names):
            raise OptionError(
                f"{user}: no role {role!r}{did_you_mean(str(role), names)}; there are: {', '.join(names)}"
            )
    return {user: names[role] for user, role in users.items()}
