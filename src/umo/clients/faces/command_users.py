"""The user of a command: the name in events, and how often a refusal is reported."""

from __future__ import annotations

import json
from typing import Any

from umo.clients.faces.face import User
from umo.clients.remote.who import UNVERIFIED, who_text
from umo.errors import OptionError
from umo.operation.commands.verb import Verb
from umo.text import printable

MAX_FACE = 20
"""Largest number of characters of a face's name that are reported. The limit leaves room for the name of the user."""
PATH = "path"
"""Name of the field that contains the path, in the JSON arguments of a verb."""
REFUSAL_PAUSE = 10.0
"""Shortest time in s between two events that report refusals of the same user. The pause prevents a flood of refusals
from displacing other events."""
MAX_REFUSED = 16
"""Largest number of users whose refusals are reported within `REFUSAL_PAUSE`."""


def named(user: User, face: str) -> str:
    """Return the name of a face's user as shown in events."""
    return who_text(user.name, f"{'' if user.proved else UNVERIFIED} ({printable(face)[:MAX_FACE]})")


def lives(user: User) -> bool:
    """True if the session of a user's client is alive, or if the protocol does not report that."""
    return user.is_alive is None or user.is_alive()


class RefusalLimit:
    """Selects the refusals that are reported as events: the first refusal of a user, and further ones at intervals of
    at least `pause` s."""

    def __init__(self, pause: float = REFUSAL_PAUSE) -> None:
        self._pause = pause
        self._told: dict[str, float] = {}

    def is_told(self, who: str, now: float) -> bool:
        self._told = {each: then for each, then in self._told.items() if now - then < self._pause}
        if who in self._told or len(self._told) >= MAX_REFUSED:
            return False
        self._told[who] = now
        return True


def arguments_of(text: Any) -> dict[str, Any]:
    """Return the arguments of a command, parsed from a string: a JSON object, or empty for none. Raises OptionError for
    any other string."""
    try:
        found = json.loads(text) if text else {}
    except (ValueError, TypeError, RecursionError):
        found = None
    if not isinstance(found, dict):
        raise OptionError('the arguments must be a JSON object, such as {"weight": 1.5}')
    return found


def asked_of(verb: Verb, text: Any) -> tuple[str, dict[str, Any]]:
    """Return the path and the fields of a command whose path and arguments are one JSON object. Raises OptionError for
    any other string."""
    given = arguments_of(text)
    path = given.pop(PATH, "")
    if not isinstance(path, str):
        raise OptionError(f'{verb.name}: the path must be a string, such as {{"{PATH}": "tank.full"}}')
    return path, verb.fields(given)
