"""docs/errors-by-text.md quotes messages that umo has."""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path

import pytest

import umo
from helpers.own_modules import on_one_line, texts
from umo.errors import BadInput

PAGE = Path(__file__).parents[2] / "docs" / "errors-by-text.md"
VARIES = "..."


OF_VALUES = str(BadInput("z.encoder", umo.Quality.UNREFERENCED))
"""A message that is made of values alone."""


@cache
def said_in(place: str) -> list[str]:
    """Every text in a module but docstrings, without the values of f-strings."""
    found = []
    nodes = list(ast.walk(ast.parse(texts()[place])))
    docstrings = {id(node.value) for node in nodes if isinstance(node, ast.Expr)}
    for node in nodes:
        if isinstance(node, ast.JoinedStr):
            found.append("".join(str(each.value) for each in node.values if isinstance(each, ast.Constant)))
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in docstrings:
            found.append(node.value)
    return found


@cache
def lines_and_words() -> dict[str, tuple[str, set[str]]]:
    """The code of each module with its texts on one line each, and all words in it."""
    return {place: (on_one_line(code), set(re.findall(r"\w+", code))) for place, code in texts().items()}


def is_said(quote: str) -> bool:
    """Whether one text has all parts of the quote, in this order. The modules that have the longest of them as it
    stands come first, those that have not all words not at all."""
    parts = [part for part in quote.split(VARIES) if part]
    words, longest = set(re.findall(r"\w+", quote)), max(parts, key=len)
    able = {place: longest not in code for place, (code, there) in lines_and_words().items() if words <= there}
    modules = (said_in(place) for place in sorted(able, key=able.__getitem__))
    return has(OF_VALUES, parts) or any(has(text, parts) for said in modules for text in said)


def has(text: str, parts: list[str]) -> bool:
    """Whether a text has all parts, in this order."""
    for part in parts:
        _, there, text = text.partition(part)
        if not there:
            return False
    return True


def quotes() -> list[str]:
    """The code in the first column of the tables, but for names of errors and of extras."""
    rows = [line.split(" | ")[0] for line in PAGE.read_text("utf-8").splitlines() if line.startswith("| `")]
    return [quote for row in rows for quote in re.findall(r"`([^`]+)`", re.sub(r"\(`\w+`\)|, and the same.*", "", row))]


@pytest.mark.parametrize("quote", quotes())
def test_a_message_on_the_page_is_one_of_umo(quote: str) -> None:
    assert is_said(quote), "umo has no such message any longer: see docs/errors-by-text.md"


def test_what_umo_does_not_say_is_told() -> None:
    assert len(quotes()) > 100
    assert not is_said("... is not wired at all")
    assert not is_said("no device ... is held by"), "two messages"
