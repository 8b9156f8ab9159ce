"""Puts the table of verbs (`umo.operation.commands.verbs`) into docs/verbs.md: `make docs`."""

from __future__ import annotations

import argparse
from pathlib import Path

from umo.operation.commands.verb_table import HEADS, VerbTable
from umo.operation.commands.verbs import VERBS

PAGE = Path(__file__).parents[1] / "docs" / "verbs.md"


def with_table(page: str) -> str:
    """The page with the table as it is now in the place of the one with the same heads."""
    lines, heads = page.splitlines(), _row(HEADS)
    rows = [heads, "| --- " * len(HEADS) + "|", *map(_row, VerbTable(VERBS).rows)]
    begin = lines.index(heads)
    lines[begin : lines.index("", begin)] = rows
    return "\n".join(lines) + "\n"


def _row(cells: tuple[str, ...]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__).parse_args()
    PAGE.write_text(with_table(PAGE.read_text("utf-8")), encoding="utf-8")
