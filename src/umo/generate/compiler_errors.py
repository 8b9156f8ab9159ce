"""Reports errors of the C compiler in generated C as a fault of umo, with the line of Python from which the C was
made."""

from __future__ import annotations

import re
from collections.abc import Callable

PLACE = re.compile(r"^(?:.*/)?(?P<file>[\w.]+):(?P<line>\d+):(?:\d+:)? (?:fatal )?error: (?P<text>.*)$", re.MULTILINE)
"""Pattern of the first line of an error of gcc and clang."""
MADE_FROM = re.compile(r"^/\* (?P<name>.*): (?P<file>\S+):(?P<line>\d+) \*/$")
"""Pattern of the comment above each translated function."""
OF_LINE = re.compile(r"/\* [^\s:]+:(?P<line>\d+) \*/$")
"""Pattern of the comment after the first statement of each line of Python."""
MOST_TEXT = 300
"""Maximum number of characters of a message without a line, such as a message of the linker."""


def compiler_message(said: str, source: Callable[[str], str]) -> str:
    """Return one or two lines: the Python function whose C the compiler refuses, and the reason. `source` is a function
    that returns the text of a C file by name, or raises FileNotFoundError."""
    found = PLACE.search(said)
    if found is None:
        text = " ".join(said.split())[:MOST_TEXT]
        return f"the compiler rejected the C that umo generated, which is a fault of umo: {text}"
    place = f"{found['file']}:{found['line']}: {found['text']}"
    return (
        f"{_origin(found['file'], int(found['line']), source)}, which is a fault of umo; write this code "
        f"differently\n{place}"
    )


def _origin(file: str, place: int, source: Callable[[str], str]) -> str:
    """Return the line of Python that the C at this line was made from."""
    try:
        lines = source(file).splitlines()[:place]
    except OSError:
        lines = []
    nearest = ""
    for text in reversed(lines):
        if made := MADE_FROM.match(text):
            line = nearest or made["line"]
            return f"{made['file']}:{line}: the compiler rejected the C that umo generated from {made['name']}"
        if compiler_message := OF_LINE.search(text):
            nearest = nearest or compiler_message["line"]
        if text == "}":  # the end of the function before
            break
    return f"the compiler rejected the C that umo generated in {file}"
