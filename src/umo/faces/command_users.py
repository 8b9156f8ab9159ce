"""Who gives a command: the name in events, how often a refusal is told."""

from __future__ import annotations

from umo.faces.face import User
from umo.remote.who import UNVERIFIED, who_text
from umo.text import printable

MAX_FACE = 20
"""Characters of a face's name that are told at most: that leaves room for the name of the user."""
REFUSAL_PAUSE = 10.0
"""Time in s from one event of a refusal of a user to the next: a flood leaves the other events alone."""
MAX_REFUSED = 16
"""Users whose refusals are told in that time at most."""


def named(user: User, face: str) -> str:
    """A user of a face as events tell them."""
    return who_text(user.name, f"{'' if user.proved else UNVERIFIED} ({printable(face)[:MAX_FACE]})")


def lives(user: User) -> bool:
    """Whether the session of a user's client lives, as far as the protocol tells."""
    return user.is_alive is None or user.is_alive()


class RefusalLimit:
    """Which refusals are told as events: the first of a user, and another one after `pause` in s."""

    def __init__(self, pause: float = REFUSAL_PAUSE) -> None:
        self._pause = pause
        self._told: dict[str, float] = {}

    def is_told(self, who: str, now: float) -> bool:
        self._told = {each: then for each, then in self._told.items() if now - then < self._pause}
        if who in self._told or len(self._told) >= MAX_REFUSED:
            return False
        self._told[who] = now
        return True
