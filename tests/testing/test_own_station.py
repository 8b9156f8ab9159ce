"""What a station's tests get of their station."""

from __future__ import annotations

from pathlib import Path

import pytest

from umo.process.station import StationError, find
from umo.testing import station


def test_a_test_finds_its_station_and_the_stations_own_classes(tank: Path) -> None:
    found = station(str(tank / "tests" / "test_tank.py"))
    assert found.path == tank == station(tank / "plant.py").path
    machine = found.machine()
    assert type(machine) is found.load("control").Tank
    assert found.load("plant").Plant(level=7.0).level == 7.0


def test_a_module_that_is_not_there_is_named_with_the_nearest(tank: Path) -> None:
    with pytest.raises(StationError, match=r"tank has no contrl\.py \(did you mean 'control'\?\)"):
        station(tank).load("contrl")


def test_a_file_of_no_station_is_none(tmp_path: Path) -> None:
    (tmp_path / "test_it.py").write_text("")
    with pytest.raises(StationError, match="no station"):
        station(tmp_path / "test_it.py")


def test_of_a_file_in_a_station_its_folder_is_named(tank: Path) -> None:
    with pytest.raises(StationError, match=r"objects\.py is a file of a station: give its folder, .*tank$"):
        find(tank / "objects.py")
