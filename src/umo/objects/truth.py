"""Settings of declarations that are True or False."""

from __future__ import annotations

from collections.abc import Collection

from umo.errors import DeclarationError
from umo.text import cut_repr


def checked_truth(name: str, value: object) -> bool:
    """Return the value of a setting. Raises DeclarationError if it is neither True nor False."""
    if not isinstance(value, bool):
        raise DeclarationError(f"{name}={cut_repr(value)} is neither True nor False")
    return value


def is_one_of(given: object, texts: Collection[str]) -> bool:
    """Return True if a setting is one of these strings. A state is not a string, and raises an error when compared with
    one (`umo.states`)."""
    return isinstance(given, str) and given in texts
