"""A deque of a part on a controller: the host would not see its elements, so it is refused."""

from __future__ import annotations

from collections import deque
from typing import Any

import pytest

from helpers.machines import timer
from helpers.split_parts import CONTROLLER
from umo import Compound, DigitalSensor
from umo.generate.controller_folder import NotTranslated
from umo.generate.controller_generator import target_of
from umo.generate.split.part_generator import part_files


class Scale(Compound):
    weight: DigitalSensor

    def setup(self) -> None:
        self.window: deque[float] = deque(maxlen=4)
        self.mean = 0.0

    def control(self) -> None:
        self.window.append(self.weight.read())
        self.mean = sum(self.window) / len(self.window)


class Hall(Compound):
    scale: Scale
    timer: DigitalSensor


def test_a_deque_of_a_part_is_refused() -> None:
    wire: dict[str, Any] = {"scale": {"controller": "drive"}, "timer": {"driver": "timerfd", "period": "10 ms"}}
    wiring = {"drivers": {"drive": {"type": CONTROLLER, "port": 1}}, "wire": wire}
    weight = DigitalSensor("kg", minimum=0.0, maximum=100.0, resolution=0.01)
    hall = Hall(scale=Scale(weight=weight), timer=timer())
    with pytest.raises(
        NotTranslated, match=r"scale.window: it is a deque, which is not transferred to the host; a list"
    ):
        part_files(hall, wiring, "drive", target_of("host"))
