"""Keys of the terminal, on Linux; elsewhere, and without a terminal, there are none."""

from __future__ import annotations

import os
import re
import select
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

SEQUENCES = {
    b"\x1b[A": "up",
    b"\x1b[B": "down",
    b"\x1b[5~": "page up",
    b"\x1b[6~": "page down",
    b"\x1b[H": "home",
    b"\x1b[F": "end",
    b"\x1b[1~": "home",
    b"\x1b[4~": "end",
    b"\x1bOA": "up",
    b"\x1bOB": "down",
    b"\x1bOH": "home",
    b"\x1bOF": "end",
    b"\r": "enter",
    b"\n": "enter",
    b" ": "enter",
    b"a": "all",
    b"q": "quit",
}
"""Characters that a terminal sends (ECMA-48, xterm), and the name of the key."""
SENT = re.compile(rb"\x1b[\[O][\x00-\x3f\x7f-\xff]*[\x40-\x7e]?|.", re.S)
"""A control sequence up to its last character, or a character."""

Wait = Callable[[float], list[str]]


@contextmanager
def pressed() -> Iterator[Wait | None]:
    """A function that waits for keys, at most so many s, and gives their names; None where there are no keys."""
    try:
        import termios
        import tty

        before = termios.tcgetattr(file := sys.stdin.fileno())
    except (ImportError, AttributeError, OSError, ValueError):  # no such module, no stdin, one that is not a file
        yield None
        return
    except termios.error:
        yield None
        return
    try:
        tty.setcbreak(file)
        yield lambda seconds: _read(file, seconds)
    finally:
        termios.tcsetattr(file, termios.TCSADRAIN, before)


def _read(file: int, seconds: float) -> list[str]:
    if not select.select([file], [], [], max(seconds, 0.0))[0]:
        return []
    data = os.read(file, 1024)
    if not data:  # the terminal is gone
        time.sleep(max(seconds, 0.0))
    return parse(data)


def parse(data: bytes) -> list[str]:
    """The keys in what a terminal has sent; what is not known is passed over."""
    return [SEQUENCES[sent] for sent in SENT.findall(data) if sent in SEQUENCES]
