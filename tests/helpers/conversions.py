"""The ways of converting a block, for tests that run with each of them."""

from __future__ import annotations

from typing import Any

import pytest

from umo.cycle import conversion

BUILT = pytest.mark.skipif(not conversion.is_built(), reason="the extension in C is not built")
WAYS: list[Any] = [pytest.param("numpy"), pytest.param("compiled", marks=BUILT)]
CHOSEN_FIRST = WAYS[::-1] if conversion.is_built() else WAYS
"""The way that a machine has here comes first. The other one is the subject of test_conversion.py."""
_EXTENSION = conversion.extension


def choose(patch: pytest.MonkeyPatch, way: str) -> None:
    """Machines that are connected from now on convert in this way."""
    patch.setattr(conversion, "extension", _EXTENSION if way == "compiled" else None)
