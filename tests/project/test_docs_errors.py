"""docs/errors-by-text.md quotes messages that umo has."""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path

import pytest

import umo
from helpers.own_modules import own_modules
from umo.errors import BadInput

PAGE = Path(__file__).parents[2] / "docs" / "errors-by-text.md"
VARIES = "..."


@cache
def texts() -> list[str]:
    """Every text in the code of umo but docstrings, without the values of f-strings; and one made of values alone."""
    found = [str(BadInput("z.encoder", umo.Quality.UNREFERENCED))]
    for file in own_modules().values():
        nodes = list(ast.walk(ast.parse(file.read_text("utf-8"))))
        docstrings = {id(node.value) for node in nodes if isinstance(node, ast.Expr)}
        for node in nodes:
            if isinstance(node, ast.JoinedStr):
                found.append("".join(str(each.value) for each in node.values if isinstance(each, ast.Constant)))
            elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in docstrings:
                found.append(node.value)
    return found


def is_said(quote: str) -> bool:
    """Whether one text has all parts of the quote, in this order."""
    parts = [part for part in quote.split(VARIES) if part]
    for text in texts():
        rest = text
        for part in parts:
            _, there, rest = rest.partition(part)
            if not there:
                break
        else:
            return True
    return False


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
