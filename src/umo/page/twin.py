"""The twin of a station: bodies, joints, and the objects that drive them."""

from __future__ import annotations

from pathlib import Path
from typing import Any


def describe(station: str, wiring: str, paths: list[str]) -> dict[str, Any] | None:
    """The twin as JSON; None: the station has none."""
    return None


def file(station: str, name: str) -> Path | None:
    """A file of the twin, such as a mesh; None: there is none."""
    return None
