"""The programs of a module that are written down (`CASES`), played in Python and in C."""

from __future__ import annotations

from typing import Any

import pytest

from helpers.side_by_side import Played


@pytest.fixture(scope="module")
def results(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> dict[Any, Played]:
    """They are compiled together, when the first is asked for."""
    found: dict[Any, Played] = request.module.CASES.played(tmp_path_factory.mktemp("c"))
    return found
