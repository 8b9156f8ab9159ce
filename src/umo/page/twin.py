"""The twin of a station that runs, for the page."""

from __future__ import annotations

from typing import Any

from umo.errors import UmoError
from umo.frames import Layout
from umo.presentation.in_words import as_shown
from umo.twin import twin_of


def describe(layout: Layout) -> dict[str, Any] | None:
    """The twin as JSON, or what is wrong with its declaration as `error`; None: the station declares none."""
    try:
        found = twin_of(layout)
    except UmoError as error:
        return {"error": str(error)}
    return found and found | {"paths": list(map(as_shown, found["paths"]))}
