"""The tables of docs/machines.md are those that docs/count.py makes."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path
from typing import Any

import pytest

DOCS = Path(__file__).parents[1] / "docs"

pytest.importorskip("mujoco")


@pytest.fixture(scope="module")
def count() -> Any:
    spec = importlib.util.spec_from_file_location("umo_docs_count", DOCS / "count.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.slow
def test_the_page_of_the_machines_has_the_counted_tables(count: Any) -> None:
    """All but the library's lines exactly; these, which every change of umo moves, to a tenth."""
    page = set((DOCS / "machines.md").read_text("utf-8").splitlines())
    made = count.tables().splitlines()
    carried = next(line for line in made if line.startswith(f"| {count.CARRIED}"))
    assert [line for line in made if line not in page and line != carried] == []
    (written,) = (line for line in page if line.startswith(f"| {count.CARRIED}"))
    for counted, shown in zip(_numbers(carried), _numbers(written), strict=True):
        assert shown == pytest.approx(counted, rel=0.1)


def _numbers(row: str) -> list[int]:
    return [int(number) for number in re.findall(r"\d+", row)]


@pytest.mark.parametrize("name", ["conveyor", "furnace"])
def test_a_small_station_stays_small(count: Any, name: str) -> None:
    lines = count.own(name)
    assert lines["objects"] < 60
    assert lines["objects"] + lines["control and application"] + lines["plant"] < 400
