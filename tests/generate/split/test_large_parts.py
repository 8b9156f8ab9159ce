"""A part of so many objects that the line of its controller cannot carry them."""

from __future__ import annotations

from typing import Any

import pytest

from helpers.machines import timer
from helpers.split_parts import CONTROLLER
from umo import Compound, DigitalSensor
from umo.generate.controller_folder import NotTranslated
from umo.generate.controller_generator import target_of
from umo.generate.split import part_plan
from umo.generate.split.part_generator import part_files


class Rack(Compound):
    sensors: list[DigitalSensor]

    def setup(self) -> None:
        self.first = 0.0

    def control(self) -> None:
        self.first = self.sensors[0].read()


class Hall(Compound):
    rack: Rack
    timer: DigitalSensor


def files(sensors: int) -> dict[str, str]:
    def sensor() -> DigitalSensor:
        return DigitalSensor("mm", minimum=0.0, maximum=100.0, resolution=0.01)

    wire: dict[str, Any] = {
        "rack": {"controller": "drive"},
        "timer": {"driver": "timerfd", "period": "10 ms"},
    }
    drive = {"type": CONTROLLER, "port": 1}
    hall = Hall(rack=Rack(sensors=[sensor() for _ in range(sensors)]), timer=timer())
    return part_files(hall, {"drivers": {"drive": drive}, "wire": wire}, "drive", target_of("host"))


def test_a_part_whose_frames_are_longer_than_a_controller_counts_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    assert part_plan.MOST_BYTES == 65_531
    assert "LINK_LONGEST = " in files(3)["machine_link.h"]
    monkeypatch.setattr(part_plan, "MOST_BYTES", 200)
    text = "rack: a frame would have [0-9]+ bytes, but a controller accepts at most 200"
    with pytest.raises(NotTranslated, match=text):
        files(20)
