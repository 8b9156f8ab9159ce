"""Words for messages: the nearest known name, the cause of an exception in one line and its place."""

from __future__ import annotations

import difflib
import os
from collections.abc import Iterable
from itertools import islice
from pathlib import Path
from traceback import walk_tb

MOST = 2000
"""Known names that are compared: more take too long for a message."""
LIBRARY = os.path.dirname(os.__file__) + os.sep
"""Where Python's own modules are."""
OWN = tuple(str(Path(__file__).parent / name) for name in ("cli", "control", "cycle", "objects", "process", "wiring"))
"""Where umo's own code calls that of others: a driver's, a station's."""


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
    except BaseException:
        return f"{type(error).__name__} (its text cannot be shown)"


def reason_of(error: BaseException) -> str:
    """What a driver's code says in an exception; its type and place where that is nothing (`sys.exit(0)`)."""
    text = text_of(error)
    return text if text and isinstance(error, Exception) else f"{cause_of(error)}{place_of(error)}"


def place_of(error: BaseException) -> str:
    """` at file:line` of what raised an exception, as `place_among` gives it."""
    return place_among((frame.f_code.co_filename, line) for frame, line in walk_tb(error.__traceback__))


def place_among(lines: Iterable[tuple[str, int]]) -> str:
    """` at file:line` of the last of some lines that is not umo's own, nor of Python's library if there is another;
    empty if there is none."""
    others = [(file, line) for file, line in lines if not file.startswith((*OWN, "<frozen "))]
    users = [(file, line) for file, line in others if not file.startswith(LIBRARY) or "site-packages" in file]
    return " at {}:{}".format(*(users or others)[-1]) if others else ""


def printable(text: str) -> str:
    """Without control characters: a terminal obeys them."""
    return "".join(c if c.isprintable() else "?" for c in text)


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """The nearest of the known names, as text to append to a message; empty if none is similar."""
    near = difflib.get_close_matches(name[:200], list(islice(known, MOST)), n=1, cutoff=0.5)
    return f" (did you mean {near[0]!r}?)" if near else ""
