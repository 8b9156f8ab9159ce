"""The line numbers of the keys in a TOML file, which Python's parser does not report. They are used only to report
errors."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Mapping
from typing import Any

LONGEST = 200
"""Largest number of lines of one value; no line is known for the keys after a longer value."""
_QUOTES = re.compile("[\"']")


def lines_of(text: str) -> dict[str, int]:
    """Return the line of each key and table (the first if there are several) by its path without quotation marks, such
    as `wire.z.motor.channel`. `text` must be valid TOML."""
    found: dict[str, int] = {}
    table, statement, first = "", "", 1
    for number, line in enumerate(text.split("\n"), 1):
        statement += line + "\n"
        if number - first >= LONGEST:
            break
        try:
            data = tomllib.loads(statement)
        except ValueError:  # it goes on in the next line
            continue
        paths = [*_paths(data, "")]
        if statement.lstrip().startswith("[") and paths:
            table = f"{paths[-1]}."
            found.setdefault(paths[-1], first)
        else:
            for path in paths:
                found.setdefault(table + path, first)
        statement, first = "", number + 1
    return found


def line_of(key: str, lines: Mapping[str, int]) -> int | None:
    """Return the line of a key, given in the form that messages have, such as `wire."z.motor".channel`. For a missing
    key, return the line of the nearest table around it. None if there is no such table."""
    path = _QUOTES.sub("", key)
    while path and path not in lines:
        path = path.rpartition(".")[0]
    return lines.get(path)


def _paths(data: Any, prefix: str) -> Iterator[str]:
    """Return the paths of all keys in a statement, the outer keys first."""
    if isinstance(data, list):
        for each in data:
            yield from _paths(each, prefix)
    elif isinstance(data, dict):
        for key, value in data.items():
            yield f"{prefix}{key}"
            yield from _paths(value, f"{prefix}{key}.")
