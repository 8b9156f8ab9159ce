"""The ways of converting a block, for tests that run with each of them."""

from __future__ import annotations

from typing import Any

import pytest

from umo.cycle import compiled

BUILT = pytest.mark.skipif(not compiled.is_built(), reason="the extension in C is not built")
WAYS: list[Any] = [pytest.param("numpy"), pytest.param("compiled", marks=BUILT)]
CHOSEN_FIRST = WAYS[::-1] if compiled.is_built() else WAYS
"""The way that a machine has here comes first. The other one is the subject of test_conversion.py."""
_EXTENSION = compiled.extension


def choose(patch: pytest.MonkeyPatch, way: str) -> None:
    """Machines that are connected from now on convert in this way."""
    patch.setattr(compiled, "extension", _EXTENSION if way == "compiled" else None)
