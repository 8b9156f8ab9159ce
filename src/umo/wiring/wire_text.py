"""How an object is wired, in words."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING

from umo.errors import DeclarationError
from umo.objects.linearization import from_table

if TYPE_CHECKING:
    from umo.wiring.entry import Entry


def wire_of(path: str, entry: Entry) -> str:
    """Driver and channel, and what the circuit changes of the declaration: `box:coil:3 inverted`."""
    return f"{entry.driver}:{entry.channel or path}{_overrides(entry)}"


def _overrides(entry: Entry) -> str:
    """What the circuit changes of the declaration, where it is not a number; a fault is for `check` to say."""
    text = " inverted" if entry.inverted else ""
    if entry.linearization is not None:
        with suppress(DeclarationError):
            text += f" through a {from_table(entry.linearization)}" if entry.linearization else " linear"
    if entry.invalid_raws:
        text += f" invalid {', '.join(map(str, entry.invalid_raws))}"
    return text
