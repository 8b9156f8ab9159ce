"""A host that sets what its controller has taken as known: it is told, and the controller does not drive on."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from helpers import moded_zone
from helpers.generating import needs_a_compiler
from helpers.moded_zone import Limits, oven
from helpers.split_parts import Recorded, SplitPart, controller_of
from umo.cycle.connect import connect
from umo.errors import DriverError, UmoError
from umo.generate import known_setters
from umo.generate.controller_generator import target_of
from umo.generate.split.part_generator import part_files

pytestmark = needs_a_compiler
PART = SplitPart(oven, "zone", "zone_plant.c", [0, 1])
PERIODS = 5_000
WAYS: dict[str, Callable[[Any], object]] = {
    "mode_name": lambda zone: setattr(zone, "mode_name", "off"),
    "target": lambda zone: setattr(zone, "target", 20.0),
    "SP": lambda zone: setattr(zone, "SP", 20.0),
    "limits": lambda zone: setattr(zone, "limits", Limits(0.0)),
}


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    yield PART.program(tmp_path_factory.mktemp("oven"))


def play(m: Any, until: Callable[[], bool]) -> None:
    for _ in range(PERIODS):
        if until():
            return
        m.timer.read()
        m.sample()
        m.control()
        m.update()
    pytest.fail(f"not within {PERIODS} periods")


def heats(each: Recorded) -> bool:
    return each.outputs[0] > 0


@pytest.mark.parametrize("name", WAYS)
def test_what_the_controller_takes_as_known_ends_the_run_where_it_is_set(program: Path, name: str) -> None:
    with controller_of(program) as controller:
        record = controller.recorded()
        with (
            pytest.raises(DriverError, match=rf"zone\.{name} was set: the controller continues with the value that"),
            connect(oven(), PART.wiring(controller.port), acknowledge=True) as m,
        ):
            play(m, lambda: m.zone.heater.read() == 50.0)
            next(each for each in record if heats(each))
            WAYS[name](m.zone)
            m.timer.read()
            m.sample()
            m.control()
            m.update()
        assert next(each for each in record if not heats(each)).outputs == PART.defaults


def test_a_number_is_with_the_controller_as_before(program: Path) -> None:
    with controller_of(program) as controller, connect(oven(), PART.wiring(controller.port), acknowledge=True) as m:
        play(m, lambda: m.zone.heater.read() == 50.0)
        m.zone.gain = 0.5
        play(m, lambda: m.zone.heater.read() == 25.0)
        m.zone.limits.highest = 0.0
        play(m, lambda: m.zone.heater.read() == 0.0)


def test_a_module_that_sets_it_is_refused_before(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    other = tmp_path / "moded_zone.py"
    text = Path(moded_zone.__file__).read_text()
    other.write_text(f"{text}\n\nasync def heat(m):\n    m.zone.SP = 60.0\n")
    monkeypatch.setattr(known_setters, "_files", lambda *_: [(str(other), "moded_zone")])
    with pytest.raises(UmoError, match=r"zone\.SP is taken as known, and is set in moded_zone\.py:\d+"):
        part_files(oven(), PART.wiring(1), "drive", target_of("host"))
