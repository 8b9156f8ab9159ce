"""A part with a rate of its own on a controller: the rate is the controller's period. Another one within is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from helpers.generating import needs_a_compiler
from helpers.split_parts import THETA, SplitPart, controller_of
from umo import BinaryActuator, Compound, DigitalActuator, DigitalSensor
from umo.control import STEPS_PER_PERIOD
from umo.cycle.connect import connect
from umo.generate.controller_folder import NotTranslated
from umo.generate.controller_generator import target_of
from umo.generate.split.part_generator import part_files
from umo.states import OnOff


class Zone(Compound, every="10 ms"):
    heater: DigitalActuator
    fan: BinaryActuator[OnOff]
    temperature: DigitalSensor

    def setup(self) -> None:
        self.acted, self.step = 0.0, 0.0

    def control(self) -> None:
        self.acted += 1.0
        self.step = self.dt
        self.heater.write(50.0)


class Tunnel(Compound):
    zone: Zone
    door: DigitalSensor


class Oven(Compound):
    timer: DigitalSensor
    tunnel: Tunnel


def machine() -> Oven:
    zone = Zone(
        heater=DigitalActuator("percent", default=0, minimum=0, maximum=100, resolution=0.1),
        fan=BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.ON),
        temperature=DigitalSensor("degC", minimum=0.0, maximum=1300.0, resolution=1 / 20.5),
    )
    door = DigitalSensor("mm", minimum=0.0, maximum=100.0, resolution=1.0)
    timer = DigitalSensor("sampling_period", minimum=0.0, maximum=99_999.9, resolution=1.0, synchronous=False)
    return Oven(timer=timer, tunnel=Tunnel(zone=zone, door=door))


ZONE = SplitPart(machine, "tunnel.zone", "zone_plant.c", [0, 1])
TUNNEL = SplitPart(machine, "tunnel", "zone_plant.c", [0, 1])


def header(part: SplitPart, **options: Any) -> str:
    return part_files(machine(), part.wiring(1, **options), "drive", target_of("host"))["machine.h"]


@needs_a_compiler
@pytest.mark.full
def test_the_rate_of_the_part_is_the_period_of_its_controller(tmp_path: Path) -> None:
    assert "#define MACHINE_PERIOD 0.01 " in header(ZONE)
    with (
        controller_of(ZONE.program(tmp_path)) as controller,
        connect(machine(), ZONE.wiring(controller.port), acknowledge=True) as m,
    ):
        for _ in range(5000):
            m.timer.read()
            m.sample()
            m.control()
            m.update()
            if m.tunnel.zone.acted >= 5.0:
                break
        assert (m.tunnel.zone.heater.read(), m.tunnel.zone.step) == (50.0, 0.01)


def test_another_rate_within_the_part_is_refused() -> None:
    text = (
        "tunnel.zone: its rate is 10 ms, but the period of its controller is 2 ms; leave out `every`, or write cycle = "
    )
    with pytest.raises(NotTranslated, match=text):
        header(TUNNEL)
    assert "#define MACHINE_PERIOD 0.01 " in header(TUNNEL, cycle="10 ms")


@needs_a_compiler
@pytest.mark.full
def test_the_period_of_a_part_is_that_of_its_controller(tmp_path: Path) -> None:
    options = {"cycle": "5 ms"}
    with (
        controller_of(THETA.program(tmp_path, **options)) as controller,
        connect(THETA.machine(), THETA.wiring(controller.port, **options), acknowledge=True) as m,
    ):
        assert (m.cycle.period, m.theta.cycle.period) == (0.002, 0.005)
        assert m.theta._speed(80.0) == STEPS_PER_PERIOD * m.theta.step_size / 0.005
