"""The transfers in C (`native.c`) of the drivers in this folder, if the extension could be built."""

from __future__ import annotations

from contextlib import suppress
from importlib import import_module
from typing import Any

NOT_BUILT = "the extension of the drivers in C was not built"
native: Any = None
"""The extension, or None if it was not built."""
with suppress(ImportError):
    native = import_module("umo.drivers._native")
