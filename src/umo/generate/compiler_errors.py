"""What a C compiler says of generated C, as a fault of umo: with the line of Python that the C was made from."""

from __future__ import annotations

import re
from collections.abc import Callable

PLACE = re.compile(r"^(?:.*/)?(?P<file>[\w.]+):(?P<line>\d+):(?:\d+:)? (?:fatal )?error: (?P<text>.*)$", re.MULTILINE)
"""The first line of an error of gcc and clang."""
MADE_FROM = re.compile(r"^/\* (?P<name>.*): (?P<file>\S+):(?P<line>\d+) \*/$")
"""What stands above each translated function."""
OF_LINE = re.compile(r"/\* [^\s:]+:(?P<line>\d+) \*/$")
"""What stands behind the first statement of each line of Python."""
MOST_TEXT = 300
"""Letters of a message that is no error of a line, such as one of the linker."""


def told(said: str, source: Callable[[str], str]) -> str:
    """One or two lines: the function of Python whose C the compiler refuses, and why. `source` gives the text of a file
    of C by its name; FileNotFoundError where there is none."""
    found = PLACE.search(said)
    if found is None:
        return f"the C that umo generated is not accepted, a fault of umo: {' '.join(said.split())[:MOST_TEXT]}"
    place = f"{found['file']}:{found['line']}: {found['text']}"
    return f"{_origin(found['file'], int(found['line']), source)}, a fault of umo; write it in another way\n{place}"


def _origin(file: str, place: int, source: Callable[[str], str]) -> str:
    """What the C at this line was made from."""
    try:
        lines = source(file).splitlines()[:place]
    except OSError:
        lines = []
    nearest = ""
    for text in reversed(lines):
        if made := MADE_FROM.match(text):
            line = nearest or made["line"]
            return f"{made['file']}:{line}: the C that umo generated of {made['name']} is not accepted"
        if told := OF_LINE.search(text):
            nearest = nearest or told["line"]
        if text == "}":  # the end of the function before
            break
    return f"the C that umo generated in {file} is not accepted"
