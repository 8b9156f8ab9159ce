"""The transfers in C (`native.c`) of the drivers in this folder, if the extension could be built."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from ctypes import addressof, c_void_p
from importlib import import_module
from typing import Any

from umo.drivers.optional import TransferInC

NOT_BUILT = "the extension of the drivers in C was not built"
native: Any = None
"""The extension, or None if it was not built."""
with suppress(ImportError):
    native = import_module("umo.drivers._native")


def of_cells(addresses: Sequence[int], write: bool, keep: object) -> TransferInC | str:
    """Return the transfer in C of channels whose levels are integers of 64 bits at these addresses, or the reason as
    text if there is none. `keep` keeps this memory alive."""
    if native is None:
        return NOT_BUILT
    places = (c_void_p * len(addresses))(*addresses)
    return TransferInC(native.SCATTER if write else native.GATHER, addressof(places), (keep, places))
