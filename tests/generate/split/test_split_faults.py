"""A part that fails alone on its controller, and a line that is away: what the host sees, and how it goes on."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest

from helpers.generating import needs_a_compiler
from helpers.split_parts import HOST_GONE, BadLine, Recorded, SplitPart, controller_of
from helpers.tiers import first, named
from umo import BinaryActuator, Compound, DigitalActuator, DigitalSensor, Quality, TaskFailed
from umo.cycle.connect import connect
from umo.states import OnOff

pytestmark = needs_a_compiler
ABSENCE, PERIODS = "60 s", 5000
RUNNING, FAULTED = 1, 2


class Zone(Compound, equipment=True):
    heater: DigitalActuator
    fan: BinaryActuator[OnOff]
    temperature: DigitalSensor

    def setup(self) -> None:
        self.duty, self.highest = 50.0, 1000.0

    def control(self) -> None:
        if self.temperature.read() > self.highest:
            raise TaskFailed("too hot")
        self.heater.write(self.duty)


class Tunnel(Compound):
    zone: Zone


class Oven(Compound):
    timer: DigitalSensor
    tunnel: Tunnel


def machine() -> Oven:
    zone = Zone(
        heater=DigitalActuator(
            "percent", default=0, minimum=0, maximum=100, resolution=0.1, on_error="retry", max_age=ABSENCE
        ),
        fan=BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.ON, on_error="retry", max_age=ABSENCE),
        temperature=DigitalSensor(
            "degC", minimum=0.0, maximum=1300.0, resolution=1 / 20.5, on_error="hold", max_age=ABSENCE
        ),
    )
    timer = DigitalSensor("sampling_period", minimum=0.0, maximum=99_999.9, resolution=1.0, synchronous=False)
    return Oven(timer=timer, tunnel=Tunnel(zone=zone))


WHOLE = SplitPart(machine, "tunnel.zone", "zone_plant.c", [0, 1])
INNER = SplitPart(machine, "tunnel", "zone_plant.c", [0, 1])


def play(m: Oven, until: Callable[[], bool]) -> None:
    """Periods until something is so."""
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


@pytest.mark.parametrize(("oven", "mode"), first(1, named(["part", "within"], [(WHOLE, FAULTED), (INNER, RUNNING)])))
def test_what_fails_alone_does_so_on_the_controller_until_it_is_cleared(
    oven: SplitPart, mode: int, tmp_path: Path
) -> None:
    running_oven = controller_of(oven.program(tmp_path))
    with (
        running_oven as controller,
        (running := connect(machine(), oven.wiring(controller.port), acknowledge=True)) as m,
    ):
        record = controller.recorded()
        zone, connected = m.tunnel.zone, running.machine
        play(m, lambda: zone.heater.read() == 50.0)
        assert next(each for each in record if heats(each)).mode == RUNNING
        zone.highest = 20.0
        play(m, lambda: connected.equipment.is_in_fault(zone))
        failed = next(each for each in record if not heats(each))
        assert (failed.mode, failed.outputs) == (mode, oven.defaults)
        assert "too hot" in str(connected.equipment.fault_of(zone))
        zone.highest = 1000.0
        connected.equipment.clear(zone)
        play(m, lambda: zone.heater.read() == 50.0)
        assert next(each for each in record if heats(each)).mode == RUNNING


@pytest.mark.full
def test_after_the_line_was_away_the_part_is_started_again(tmp_path: Path) -> None:
    with controller_of(WHOLE.program(tmp_path)) as controller:
        line, record = BadLine(controller.port, 1, share=0.0), controller.recorded()
        line.start()
        with closing(line), connect(machine(), WHOLE.wiring(line.port), acknowledge=True) as m:
            zone = m.tunnel.zone
            play(m, lambda: zone.heater.read() == 50.0)
            line.away = True
            play(m, lambda: zone.temperature.quality is Quality.STALE)
            gone = next(each for each in record if each.mode == HOST_GONE)
            assert gone.outputs == WHOLE.defaults
            line.away = False
            play(m, lambda: zone.temperature.quality is Quality.GOOD)
            play(m, lambda: zone.heater.read() == 50.0)
            assert next(each for each in record if heats(each)).mode == RUNNING
