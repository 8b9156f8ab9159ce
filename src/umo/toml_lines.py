"""The line numbers of the keys in a TOML file, which Python's parser does not report, and hints for what it refuses.
They are used only to report errors."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

LONGEST = 200
"""Largest number of lines of one value; no line is known for the keys after a longer value."""
_QUOTES = re.compile("[\"']")


class _Statement(NamedTuple):
    """A key with its value, or the heading of a table."""

    line: int
    key: str
    """The key as written."""
    paths: list[str]
    """The paths of all keys in the statement, the outer keys first."""


def lines_of(text: str) -> dict[str, int]:
    """Return the line of each key and table (the first if there are several) by its path without quotation marks, such
    as `wire.z.motor.channel`. Each statement of `text` must be valid TOML."""
    found: dict[str, int] = {}
    for statement in _statements(text):
        for path in statement.paths:
            found.setdefault(path, statement.line)
    return found


def toml_hint(error: str, text: str) -> str:
    """Return what was probably meant by a text that cannot be read as TOML with this error, to append to the error; ""
    if that is not known."""
    if error.startswith("Invalid value"):
        return '; write a string in quotation marks: "tank"'
    if error.startswith("Cannot declare"):
        return "; write all keys of a table below one heading [table]"
    if error.startswith("Cannot overwrite"):
        place = re.search(r"at line (\d+)", error)
        found = _line_before(text, int(place[1]) if place else text.count("\n") + 1)
        return f"; give each key only once{f': {found[0]} is also in line {found[1]}' if found else ''}"
    if "codec can't decode" in error:
        return "; save the file as UTF-8"
    return ""


def _line_before(text: str, line: int) -> tuple[str, int] | None:
    """Return the key of the last statement up to a line, as written, and the first line of an earlier statement that
    has the same key or, without one, the key of a table around it. None if there is no such statement."""
    *before, last = [each for each in _statements(text) if each.paths and each.line <= line] or [_Statement(0, "", [])]
    lines = {path: each.line for each in reversed(before) for path in each.paths}
    return next(((last.key, lines[path]) for path in reversed(last.paths) if path in lines), None)


def _statements(text: str) -> Iterator[_Statement]:
    table, statement, first = "", "", 1
    for number, line in enumerate(text.split("\n"), 1):
        statement += line + "\n"
        if number - first >= LONGEST:
            return
        try:
            data = tomllib.loads(statement)
        except ValueError:  # it goes on in the next line
            continue
        paths = [*_paths(data, "")]
        if statement.lstrip().startswith("[") and paths:
            table, paths = f"{paths[-1]}.", paths[-1:]
            yield _Statement(first, statement.strip(), paths)
        else:
            yield _Statement(first, statement.partition("=")[0].strip(), [table + path for path in paths])
        statement, first = "", number + 1


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
