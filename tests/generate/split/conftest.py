"""The controller program of the furnace's zone, for the modules that have no part of their own, and one that runs."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from helpers.split_parts import ZONE, RunningController, controller_of


@pytest.fixture(scope="session")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return ZONE.program(tmp_path_factory.mktemp("zone"))


@pytest.fixture
def controller(program: Path) -> Iterator[RunningController]:
    with controller_of(program) as found:
        yield found
