"""Parts of messages: the nearest known name, and the time and place of an exception."""

from __future__ import annotations

import difflib
import errno
import inspect
import os
import re
import time
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from enum import IntEnum
from functools import lru_cache
from itertools import islice
from pathlib import Path
from typing import NamedTuple

COMPARED_NAMES = 2000
"""Largest number of known names that are compared; comparing more would take too long for a message."""
LIBRARY = os.path.dirname(os.__file__) + os.sep
"""The folder of Python's own modules."""
INSTALLED = (f"{os.sep}site-packages{os.sep}", f"{os.sep}dist-packages{os.sep}")
UMO = str(Path(__file__).parent) + os.sep
COMMAND = str(Path(__file__).parents[1] / "umo_command") + os.sep
"""Folder of the command `umo`."""
STATIONS = f"{UMO}stations{os.sep}"
"""Folder of the shipped stations. Their code counts as the user's code."""
MAX_FRAMES = 20
"""Largest number of frames that are kept of an exception in a driver's code."""
MAX_NAMES = 2
"""Number of names that a list shows before the number of the others."""


class NamedNumber(IntEnum):
    """A number that is shown as a name in words."""

    def __str__(self) -> str:
        return self.name.lower().replace("_", " ")


class Moment(str):
    """A note with the time, on the machine's clock, of the exception that ended a run."""

    __slots__ = ()

    @classmethod
    def at(cls, seconds: float) -> Moment:
        return cls(f"at {f'{seconds:.3f}'.rstrip('0').rstrip('.')} s")


def str_of(error: BaseException) -> str:
    """Return `str(error)`, even if its `__str__` fails; if a limit of the operating system is the cause, add the
    command that shows and raises the limit."""
    try:
        text = str(error)
    except BaseException:
        return "its text cannot be shown"
    return f"{text} (`ulimit -n` shows and raises the number)" if _is_out_of_descriptors(error) else text


def _is_out_of_descriptors(error: BaseException) -> bool:
    return isinstance(error, OSError) and error.errno == errno.EMFILE


def add_note(error: BaseException, note: str) -> None:
    """Call `error.add_note(note)`, and ignore its failure."""
    with suppress(BaseException):
        error.add_note(note)


def in_a_line(text: str) -> str:
    """Join the lines of a string with "; "."""
    return "; ".join(line.strip() for line in text.splitlines() if line.strip())


def reason_of(error: Exception) -> str:
    """Return the text of the operating system for an error, as a part of a sentence."""
    text = getattr(error, "strerror", None) or str(error)
    return text[:1].lower() + text[1:]


def in_brackets(*words: str) -> str:
    """Return words in brackets, such as ` (one, other)`, without the empty ones."""
    text = ", ".join(filter(None, words))
    return f" ({text})" if text else ""


class CodePlace(NamedTuple):
    """A line of code."""

    file: str
    line: int
    function: str


def place_of(error: BaseException) -> str:
    """Return the place at which an exception was raised, in the form of `place_among`."""
    return shown_place(raised_at(error))


def raised_at(error: BaseException) -> CodePlace | None:
    """Return the place at which an exception was raised as data, which is formatted when it is shown."""
    found = users = None
    try:
        trace = error.__traceback__
        while trace is not None:
            file = trace.tb_frame.f_code.co_filename
            if not is_own(file):
                found = trace
                users = users if _is_installed(file) else trace
            trace = trace.tb_next
    except BaseException:  # an exception of the user's may refuse anything
        return None
    if found is None:
        return None
    chosen = users or found
    code = chosen.tb_frame.f_code
    return CodePlace(code.co_filename, chosen.tb_lineno, code.co_name)


def frames_of_mistake(error: BaseException) -> tuple[CodePlace, ...]:
    """Return the frames, the outermost first, from the first frame of the user's code to the place at which an
    exception was raised; the innermost `MAX_FRAMES` of them."""
    found: list[CodePlace] = []
    with suppress(BaseException):  # an exception of the user's may refuse anything
        trace = error.__traceback__
        while trace is not None:
            code = trace.tb_frame.f_code
            if found or not is_own(code.co_filename):
                found.append(CodePlace(code.co_filename, trace.tb_lineno, code.co_name))
            trace = trace.tb_next
    return tuple(found[-MAX_FRAMES:])


def place_among(frames: Iterable[tuple[str, int, str]]) -> str:
    """Return the place, such as `control.py:41 in control`, of the innermost of these frames (the outermost is first)
    that belongs neither to umo nor to Python. A frame of an installed package is used only if there is no other frame.
    The result is empty if there is no such frame."""
    found = [frame for frame in frames if not is_own(frame[0])]
    users = [frame for frame in found if not _is_installed(frame[0])]
    return shown_place(CodePlace(*(users or found)[-1]) if found else None)


def shown_place(place: CodePlace | None) -> str:
    """Format a place as `control.py:41 in control`; "" for None."""
    if place is None:
        return ""
    line = f"{shown_path(place.file)}:{place.line}"
    return line if place.function == "<module>" else f"{line} in {place.function}"


def is_users(file: str) -> bool:
    """Return True if a file of code belongs to the user: not to umo, Python or an installed package."""
    return not is_own(file) and not _is_installed(file)


@lru_cache(maxsize=1000)
def is_own(file: str) -> bool:
    """Return True if a file of code belongs to umo or Python."""
    if file.startswith((UMO, COMMAND)):
        return not file.startswith(STATIONS)
    return file.startswith(("<frozen ", "<string>")) or (file.startswith(LIBRARY) and not _is_installed(file))


@lru_cache(maxsize=1000)
def _is_installed(file: str) -> bool:
    return any(part in file for part in INSTALLED) and not file.startswith(STATIONS)


def shown_path(file: str) -> str:
    """Return a path, relative to the current folder if that is shorter."""
    try:
        return _relative(file, os.getcwd())
    except (OSError, ValueError):  # the folder is gone; another drive
        return file


@lru_cache(maxsize=1000)
def _relative(file: str, folder: str) -> str:
    """Return a path relative to `folder`, the current folder."""
    return min(os.path.relpath(file), file, key=len)


def some(names: Sequence[str]) -> str:
    """Return a short list, such as `a, b and 38 others`; up to three names are shown in full."""
    if len(names) <= MAX_NAMES + 1:
        return " and ".join(filter(None, [", ".join(names[:-1]), *names[-1:]]))
    return f"{', '.join(names[:MAX_NAMES])} and {others(len(names) - MAX_NAMES)}"


def count_of(number: int, noun: str) -> str:
    """Return a number with its noun, such as `1 period` or `3,741 periods`."""
    return f"{number:,} {noun}{'' if number == 1 else 's'}"


def others(count: int) -> str:
    """Return the number of others, such as `1 other` or `38 others`."""
    return f"{count} other{'s' * (count != 1)}"


def printable(text: str) -> str:
    """Return a string without control characters, which a terminal would obey. Use it for every one-line string that
    comes from another process, from a file or over a network."""
    return text if text.isprintable() else "".join(c if c.isprintable() else "?" for c in text)


def with_time(seconds: float, text: str) -> str:
    """Return a line that begins with a time in s on the machine's clock."""
    return f"{seconds:8.3f} s  {text}"


def time_of_day(seconds: object, form: str = "%Y-%m-%d %H:%M:%S") -> str:
    """Return the local time for a number of s since 1970 that another process has sent, even if the number is not a
    valid time."""
    try:
        return time.strftime(form, time.localtime(seconds))  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError, OSError):
        return "an unknown time"


def options_in(doc: str) -> dict[str, str]:
    """Return the text for each name in the section "Options:" of a docstring. An entry has the form `host, port: the
    device` and may continue on lines with a deeper indent."""
    found: dict[str, str] = {}
    names: list[str] = []
    for line in inspect.cleandoc(doc).partition("\nOptions:\n")[2].splitlines():
        head = re.match(r"    (\w+(?:, \w+)*): (.*)", line)
        if head:
            names = head[1].split(", ")
            found |= dict.fromkeys(names, head[2])
        elif not line.startswith("     "):
            break
        else:
            found |= {name: f"{found[name]} {line.strip()}" for name in names}
    return found


_SEARCHES = ContextVar("searches", default=True)
"""True if messages suggest similar names. False within a period, because the search takes as long as many periods."""


@contextmanager
def without_search() -> Iterator[None]:
    """Return a context in which messages do not suggest similar names, because the client searches for them."""
    before = _SEARCHES.set(False)
    try:
        yield
    finally:
        _SEARCHES.reset(before)


def did_you_mean(name: str, known: Iterable[str], cutoff: float = 0.5) -> str:
    """Return the nearest of the known names as text to append to a message. The text is empty if no name is similar,
    and within `without_search`. `cutoff`: the least similarity, from 0 to 1."""
    if not _SEARCHES.get():
        return ""
    near = difflib.get_close_matches(name[:200], list(islice(known, COMPARED_NAMES)), n=1, cutoff=cutoff)
    return f" (did you mean {near[0]!r}?)" if near else ""


READ_WORDS = frozenset(("state", "value", "get", "get_value"))
"""Names that programmers may try in order to read the value of an object."""
WRITE_WORDS = frozenset(("write", "set", "set_value", "put", "on", "off", "open", "close"))
"""Names of functions that write a value in other libraries, and words for writing in common speech."""


def near_attribute(name: str, known: Collection[str]) -> str:
    """Return a similar attribute, which is public if the given one is public. If the name is a common word for reading
    or writing the value of an object, return `read()` or `write(...)`."""
    if name in READ_WORDS and "read" in known:
        return " (did you mean 'read()'?)"
    if name in WRITE_WORDS and "read" in known and "direction" in known:
        return " (did you mean 'write(...)'?)" if "write" in known else "; a sensor is only read"
    return did_you_mean(name, [each for each in known if each.startswith("_") == name.startswith("_")])


MAX_WORD = 80
"""Largest number of characters of a word in a message, or of a name in a path."""
_LONG_WORD = re.compile(rf"[^\s/]{{{MAX_WORD + 1},}}")
_TAIL = 20
"""Number of characters at the end of a word that are kept when the word is cut. They may include quotation marks and
brackets."""


def cut_words(text: str) -> str:
    """Return a message with its words cut to `MAX_WORD` characters, because the message may repeat any string of a
    user."""
    if len(text) <= MAX_WORD:
        return text
    return _LONG_WORD.sub(lambda found: f"{found[0][: MAX_WORD - _TAIL - 3]}...{found[0][-_TAIL:]}", text)


MAX_REPR = 60


def cut_repr(given: object) -> str:
    """Return a wrong value for a message: its `repr` in one line, cut; its type if `repr` fails."""
    try:
        text = " ".join(repr(given).split())
    except BaseException:  # it is of the user's, or an int with more digits than Python prints
        text = f"<{type(given).__name__}>"
    return text if len(text) <= MAX_REPR else f"{text[:MAX_REPR]}..."
