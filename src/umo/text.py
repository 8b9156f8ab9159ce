"""Words for messages: the nearest known name, the cause of an exception in one line."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from itertools import islice

MOST = 2000
"""Known names that are compared: more take too long for a message."""


def cause_of(error: BaseException) -> str:
    """What an exception says, in one line; its type first, unless it comes from the operating system or a device."""
    text = text_of(error).partition("\n")[0]
    if not text:
        return type(error).__name__
    return text if isinstance(error, OSError) else f"{type(error).__name__}: {text}"


def text_of(error: BaseException) -> str:
    """`str(error)`, whatever its `__str__` does."""
    try:
        return str(error)
    except Exception:
        return f"{type(error).__name__} (its text cannot be shown)"


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """The nearest of the known names as a phrase to append to a message; empty if none is near."""
    near = difflib.get_close_matches(name[:200], list(islice(known, MOST)), n=1, cutoff=0.5)
    return f" (did you mean {near[0]!r}?)" if near else ""
