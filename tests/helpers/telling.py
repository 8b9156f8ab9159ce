"""Which objects an event concerns: one at its path, or several of which its text tells the number and the first."""

from __future__ import annotations

import re
from collections.abc import Iterable

from umo.cycle.events import Event


def concerned(events: Iterable[Event]) -> list[str]:
    """The paths, in order; of more than three in one event those that it names."""
    found: list[str] = []
    for event in events:
        several = re.search(r"\d (?:actuators |commands |released).*: ([^:]*)$", event.text)
        found += [event.path] if several is None else re.split(r", | and ", several[1])
    return found
