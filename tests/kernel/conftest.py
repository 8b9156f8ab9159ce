"""The tests of drivers for interfaces of the kernel run in the test kernel (make test-kernel), and nowhere else."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from .gpio_sim import Chip

HERE = f"{Path(__file__).parent}{os.sep}"
collect_ignore_glob = [] if sys.platform == "linux" else ["test_*.py"]  # elsewhere their libraries cannot be installed


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    if os.environ.get("UMO_KERNEL") == "1":
        return
    for item in items:
        if str(item.path).startswith(HERE):
            item.add_marker(pytest.mark.skip(reason="runs in the test kernel: make test-kernel"))


@pytest.fixture
def gpio_chip(request: pytest.FixtureRequest) -> Iterator[Callable[..., Chip]]:
    """Makes simulated chips: `gpio_chip(lines=8, names={3: "PUMP"})`."""
    made: list[Chip] = []

    def make(lines: int = 8, **options: object) -> Chip:
        made.append(Chip(f"sim{len(made)}", lines, **options))  # type: ignore[arg-type]
        return made[-1]

    yield make
    for chip in made:
        chip.remove()
