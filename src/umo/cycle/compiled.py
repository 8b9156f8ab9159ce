"""The extension in C (`columns.c`), where it is built."""

from __future__ import annotations

from contextlib import suppress
from importlib import import_module
from typing import Any

extension: Any = None
"""None: it was not built, and numpy does its work."""
with suppress(ImportError):
    extension = import_module("umo.cycle._columns")


def is_built() -> bool:
    return extension is not None
