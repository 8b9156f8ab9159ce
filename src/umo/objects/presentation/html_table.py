"""Tables in HTML, for notebooks. They use the colours (light or dark) and the font of the notebook."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import wraps
from html import escape
from typing import TypeVar

from umo.objects.presentation.rows import DECLARED, VALUES, TableRow, folded, lines
from umo.objects.presentation.value_text import SIGNS
from umo.user_code import attempt

T = TypeVar("T")
MAX_LINES = 200
STYLE = (
    "<style>.umo{line-height:1.5;font-variant-numeric:tabular-nums}.umo table{border-collapse:collapse;margin:0}"
    ".umo :is(td,th){text-align:left;padding:1px 1em 1px 0;font-weight:normal;vertical-align:top}"
    ".umo thead th{opacity:.65}.umo td.number{text-align:right}"
    ".umo svg{display:block;width:100%;max-width:900px}</style>"
)


def heading(title: str, facts: Mapping[str, str]) -> str:
    """Return a line with the facts that are not empty."""
    said = (f"{escape(name)}: {escape(text)}" for name, text in facts.items() if text)
    return f"<div><b>{escape(title)}</b> &ensp;{' · '.join(said)}</div>"


def html_table(title: str, facts: Mapping[str, str], rows: Sequence[TableRow], *, values: bool = True) -> str:
    """Return a table with a line for each row, and one line for similar rows of lists. The table shows values or, if
    `values` is False, declarations. Empty columns are left out."""
    whole = [[rows[place] for place in places] for places in lines([row.about.path for row in rows])]
    shown = whole[:MAX_LINES]
    cells = {name: [text(line) for line in shown] for name, text in (VALUES if values else DECLARED).items()}
    cells = {name: texts for name, texts in cells.items() if any(texts)}
    head = "".join(f"<th>{name}</th>" for name in ("object", *cells))
    paths = [escape(folded([row.about.path for row in line])) for line in shown]
    body = [
        f"<tr><th>{path}</th>{''.join(map(_cell, cells, texts))}</tr>"
        for path, *texts in zip(paths, *cells.values(), strict=True)
    ]
    more = f"<div>and {len(whole) - MAX_LINES:,} more; show a part of it</div>" if len(whole) > MAX_LINES else ""
    table = f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(body)}</tbody></table>" if rows else ""
    return f'{STYLE}<div class="umo">{heading(title, facts)}{table}{more}</div>'


def _cell(column: str, text: str) -> str:
    """A quality that is not good is in bold."""
    text = escape(text)
    if column == "quality" and text and not text.startswith(SIGNS[0]):
        text = f"<b>{text}</b>"
    return f'<td class="number">{text}</td>' if column in ("value", "raw") else f"<td>{text}</td>"


def never_raises(make: Callable[[T], str]) -> Callable[[T], str]:
    """Decorate `_repr_html_`, so that a notebook shows the reason if an object cannot be shown."""

    @wraps(make)
    def shown(thing: T) -> str:
        text, error = attempt(make, thing)
        if error is not None:
            text = f"<div><b>{escape(type(thing).__name__)}</b> cannot be shown: {escape(error.text)}</div>"
        return str(text)

    return shown
