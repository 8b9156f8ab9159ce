"""Floats are printed as people read them, and stand in JSON to the last bit."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import Result

from umo import Compound, DigitalSensor, Number, connect, published
from umo.testing import periods

Umo = Callable[..., Result]
APPLICATION = """
async def main(m):
    return {"mean": 0.1 + 0.2, "lengths": [120.30000000000001, 1.5], "deep": {"x": 1 / 3}, "name": "a", "n": 3}
"""


@pytest.fixture
def result(umo: Umo, tank: Path) -> str:
    """The table of a run whose application returns such floats; the summary is `s.json`."""
    (tank / "application.py").write_text(APPLICATION)
    ran = umo("run", "tank", "--no-record", "--no-plot", "--summary", "s.json")
    assert ran.exit_code == 0, ran.output
    return " ".join(ran.stdout.split())


def test_the_table_of_a_run_shows_no_float_to_its_last_bit(result: str) -> None:
    assert "mean │ 0.3 │" in result
    assert "lengths │ [120.3, 1.5] │" in result
    assert "deep │ {'x': 0.333333} │" in result


def test_the_summary_has_them_to_the_last_bit(result: str) -> None:
    found = json.loads(Path("s.json").read_text())["result"]
    assert found == {"mean": 0.1 + 0.2, "lengths": [120.30000000000001, 1.5], "deep": {"x": 1 / 3}, "name": "a", "n": 3}


class Scale(Compound, numbers={"mass": Number("kg", shown=True)}):
    timer: DigitalSensor
    mass: float = 0.1 + 0.2


def test_umo_get_shows_a_number_of_a_run_as_people_read_it(umo: Umo) -> None:
    timer = DigitalSensor("sampling_period", minimum=0, maximum=99_999, resolution=1, synchronous=False)
    connection = connect(Scale(timer=timer))
    with connection as machine, published(connection, "scale"):
        periods(machine, 3)
        shown = umo("device", "get", "scale", "mass")
        assert shown.stdout.strip() == "mass  0.3 kg", shown.output
