"""The name of the user who gives a command, as events and leases show it."""

from __future__ import annotations

from umo.process.frames.layout import NAME
from umo.text import printable

UNVERIFIED = ", unverified"
"""The suffix of a name that is not proved. It stands before the brackets that name the way by which the command
came."""


def is_unverified(who: str) -> bool:
    """True if a text of `who_text` marks the name as not proved."""
    return f"{UNVERIFIED} (" in who


def who_text(name: str, ending: str) -> str:
    """Return a user as shown in events and leases, in at most `NAME` bytes. A long name is cut, but never its ending,
    which shows by which way the command came and whether the name is proved."""
    given = printable(" ".join(name.split())) or "nobody"
    return given.encode()[: max(0, NAME - len(ending.encode()))].decode(errors="ignore") + ending
