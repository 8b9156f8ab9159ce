"""Libraries that a driver needs, but umo itself does not: optional extras."""

from __future__ import annotations

from importlib import import_module
from typing import Any


def library(module: str, name: str) -> Any:
    """Return the module, or None if the library `name`, which the module needs, is not installed. So a wiring can be
    checked without the library. Use this function in constructors, because a guardian has no time for imports in
    `open`."""
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != name:
            raise
        return None
