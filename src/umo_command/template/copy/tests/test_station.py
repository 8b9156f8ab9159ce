"""The station's own tests: `pytest` in its folder. No test sleeps: time is a wired device."""

import pytest

from umo import check, run
from umo.testing import station

STATION = station(__file__)


@pytest.mark.parametrize("name", STATION.wirings)
def test_the_wirings_fit_the_machine(name: str) -> None:
    assert check(STATION.machine(), STATION.wirings[name]) == []


def test_the_application_comes_to_its_end_with_the_simulated_plant() -> None:
    run(STATION.machine(), STATION.wirings["simulated"], STATION.main, until="1 h")
