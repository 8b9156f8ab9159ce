"""Adds the nearest known name to a refusal of the machine. The machine does not search for it, because a search takes
as long as many periods of its loop (docs/decisions/0061)."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain
from typing import Any

from umo.cycle.events import CommandState, Event
from umo.cycle.law_loops import NAMES as EXPERIMENTS
from umo.objects.paths import is_pattern
from umo.objects.presentation.described import Described
from umo.objects.presentation.rows import ANY, generalised
from umo.operation.commands.verb import Names
from umo.operation.commands.verbs import VERBS
from umo.process.frames.layout import Layout
from umo.text import did_you_mean

UNKNOWN = re.compile(r"(?:Path|State|Range|Recipe)Error: |CommandRefused: there is no command ")
"""Beginning of a refusal that may contain an unknown name."""
QUOTED = re.compile(r"'([^']+)'")


def with_nearest(event: Event, layout: Layout) -> Event:
    """Return an answer of the machine. If it is a refusal because of an unknown name, the nearest known name is
    added."""
    if event.state is not CommandState.REFUSED or not UNKNOWN.match(event.text) or "did you mean" in event.text:
        return event
    quoted = QUOTED.search(event.text)
    if quoted is None:
        return event
    known = list(dict.fromkeys(_known(event, layout)))
    if quoted[1] in known:
        return event
    at = quoted.end()
    return event._replace(text=f"{event.text[:at]}{_nearest(quoted[1], known)}{event.text[at:]}")


def _nearest(name: str, known: Sequence[str]) -> str:
    """Return the nearest known name as text to append to a message. For a pattern, return the nearest pattern; those
    with the same last parts come first."""
    if not is_pattern(name):
        return did_you_mean(name, known)
    patterns = list(dict.fromkeys(map(generalised, known)))
    last = name.rpartition(f"{ANY}.")[2]
    ends = [each for each in patterns if each.endswith(f".{last}")]
    return did_you_mean(name, ends, cutoff=0.0) or did_you_mean(name, patterns)


def _known(event: Event, layout: Layout) -> Iterator[str]:
    """Yield the names that the client may have meant."""
    do = next((each for each in sorted(VERBS, key=len, reverse=True) if event.asked.startswith(each)), "")
    if not do:
        yield from VERBS
        return
    verb = VERBS[do]
    objects, _, tunables = layout.described
    if verb.names is Names.ALARM:
        yield from _with_parents(layout.alarms)
    elif verb.names is Names.ACTUATOR:
        yield from _named([each for each in objects if each.is_actuator], event.path)
    elif verb.names is Names.TUNABLE:
        yield from _named(tunables, event.path)
    elif verb.names is Names.ACTION:
        yield from _of_action(event, layout)
    else:
        yield from _with_parents(layout.objects)
    for argument in verb.arguments:
        yield from (argument.name, *argument.choices)


def _named(values: Sequence[Described], path: str) -> Iterator[str]:
    """Yield the names of the states of the object at this path; if there is no such object, yield all paths."""
    found = next((each for each in values if each.path == path), None)
    yield from (each.path for each in values) if found is None else found.states.values()


def _of_action(event: Event, layout: Layout) -> Iterator[str]:
    """Yield the arguments of an action, their choices, and the recipes of its book. If there is no such action, yield
    the paths of all actions."""
    if event.path.rpartition(".")[2] in EXPERIMENTS:  # on a law, which no list shows
        yield from _with_parents((*layout.objects, *layout.signals, *layout.tunables))
        return
    action = next((each for each in layout.actions if each["path"] == event.path), None)
    if action is None:
        yield from (each["path"] for each in layout.actions)
        return
    for argument in action.get("arguments", ()):
        yield from (argument["name"], *argument.get("choices", ()))
    for book in layout.books:
        if event.path.startswith(f"{book['path']}."):
            yield from (each["name"] for each in book["recipes"])


def _with_parents(entries: tuple[Mapping[str, Any], ...]) -> Iterator[str]:
    """Yield the paths of the entries, and the paths of the compounds that contain them."""
    for entry in entries:
        parts = entry["path"].split(".")
        yield from chain((entry["path"],), (".".join(parts[:count]) for count in range(1, len(parts))))
