"""The table of verbs for people, in a terminal, in a notebook and on the page docs/verbs.md."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from html import escape

from umo.operation.commands.verb import Names, Verb, VerbArgument

HEADS = ("verb", "path", "arguments", "role", "when", "what it changes")


class VerbTable(Mapping[str, Verb]):
    """A mapping of the verbs by name. Its text, and its HTML in a notebook, is a table."""

    def __init__(self, verbs: Mapping[str, Verb]) -> None:
        self._verbs = verbs

    def __getitem__(self, name: str) -> Verb:
        return self._verbs[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._verbs)

    def __len__(self) -> int:
        return len(self._verbs)

    @property
    def rows(self) -> list[tuple[str, ...]]:
        """A row for each verb, with the cells of `HEADS`."""
        return [row_of(each) for each in self._verbs.values()]

    def __repr__(self) -> str:
        return "\n".join("  ".join(filter(None, row)) for row in self.rows)

    def _repr_html_(self) -> str:
        head = "".join(f"<th>{each}</th>" for each in HEADS)
        body = "".join(f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in self.rows)
        return f"<table><tr>{head}</tr>{body}</table>"


def row_of(verb: Verb) -> tuple[str, ...]:
    """Return the cells of a verb: name, path, arguments, role, mode in which it is accepted, help."""
    path = "" if verb.names is Names.NOTHING else verb.names.value
    return verb.name, path, "; ".join(map(argument_text, verb.arguments)), str(verb.role), when_of(verb), verb.help


def argument_text(argument: VerbArgument) -> str:
    """Return an argument with its range, such as "time: a time from 0.001 to 604800 s"."""
    return f"{argument.name}: {argument.range}{'' if argument.required else ' (optional)'}"


def when_of(verb: Verb) -> str:
    """Return as text when a verb is accepted."""
    needs = "with the lease" if verb.needs_lease else "without the lease"
    return f"{needs}, in manual mode" if verb.only_manual else needs
