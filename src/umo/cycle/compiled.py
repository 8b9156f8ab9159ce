"""The extension in C (`columns.c`), where it is built."""

from __future__ import annotations

try:
    from umo.cycle import _columns
except ImportError:
    _columns = None  # type: ignore[assignment]
extension = _columns
"""None: it was not built, and numpy does its work."""


def is_built() -> bool:
    return extension is not None
