"""A zone of the furnace runs on a controller, with its law and its interlock; the furnace on the host is unchanged."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from helpers.generating import needs_a_compiler
from helpers.peers.text_devices import CannotRun
from helpers.split_parts import (
    ARM,
    TIMEOUT_PERIODS,
    ZONE,
    BadLine,
    Recorded,
    RunningController,
    controller_of,
    emulated_controller,
    host_beside,
    kill_hosts,
)
from umo.cycle.connect import connect

pytestmark = needs_a_compiler
PEAK, RAMP = 110.0, 4.0
EVERY_KILL = pytest.param(100, marks=pytest.mark.full)


def heat(
    port: int | None, *, until: Callable[[Any], bool] | None = None, raws: set[int] | None = None, **options: Any
) -> float:
    """Heat the zone up to PEAK, or until something is so. The last temperature."""
    with connect(ZONE.machine(), ZONE.wiring(port, **options), acknowledge=True) as m:
        m.frozen_after = 10_000  # readings of 2 ms, and not of 100 ms
        task = m.cycle.start(m.heat_up(PEAK, RAMP))
        while not task.done and not (until and until(m)):
            m.timer.read()
            m.sample()
            if raws is not None:
                raws.add(m.zones[0].temperature.raw)
            m.control()
            m.update()
        return float(m.zones[0].temperature.read())


def heats(each: Recorded) -> bool:
    return each.outputs[0] > 0


@pytest.mark.full
def test_the_law_of_the_zone_heats_on_the_controller(controller: RunningController) -> None:
    seen = []

    def until(m: Any) -> bool:
        zone = m.zones[0]
        seen.append((zone.setpoint, zone.heating.integral, zone.heater.read()))
        return bool(zone.heater.read() > 1.0 and zone.heating.integral > 0.0)

    heat(controller.port, until=until)
    assert seen[-1][0] > seen[0][0]
    record = controller.recorded()
    assert next(record).outputs == ZONE.defaults
    assert next(each for each in record if heats(each)).mode == 1
    assert next(each for each in record if each.mode == 0).outputs == ZONE.defaults


@pytest.mark.full
def test_the_furnace_heats_up_with_its_zone_elsewhere(controller: RunningController) -> None:
    assert heat(controller.port) == pytest.approx(PEAK, abs=5.0)


@pytest.mark.parametrize("times", [2, EVERY_KILL])
def test_when_the_host_is_killed_the_heater_is_off_and_the_fan_on_in_time(
    controller: RunningController, times: int
) -> None:
    for *_, gone in kill_hosts(times, lambda _: heat(controller.port), heats, controller):
        assert (gone.outputs, gone.silent <= TIMEOUT_PERIODS) == (ZONE.defaults, True)


@pytest.mark.full
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_program_that_is_ended_leaves_its_outputs_at_their_defaults(program: Path, number: int) -> None:
    with controller_of(program) as controller, host_beside(lambda: heat(controller.port), controller):
        record = controller.recorded()
        assert heats(next(each for each in record if heats(each)))
        os.kill(controller.pid, number)
        *_, last = record
        assert last.outputs == ZONE.defaults


@pytest.mark.full
@pytest.mark.parametrize("seed", range(3))
def test_on_a_bad_line_no_temperature_is_wrong_and_the_zone_gets_hot(controller: RunningController, seed: int) -> None:
    line, raws = BadLine(controller.port, seed, share=0.05), set[int]()
    line.start()
    try:
        assert heat(line.port, raws=raws) == pytest.approx(PEAK, abs=5.0)
    finally:
        line.close()
    assert min(line.treated.values()) > 0
    assert {raw % 4 for raw in raws} == {1}


@pytest.mark.full
@pytest.mark.parametrize("times", [3, 100])
def test_the_same_on_an_emulated_board_over_a_serial_line(tmp_path: Path, times: int) -> None:
    try:
        elf = ZONE.firmware(tmp_path, ARM)
    except CannotRun as error:
        pytest.skip(str(error))
    with emulated_controller(ARM, elf) as board:
        line = {"serial": board.serial, "timeout": "3 s"}
        assert heat(None, **line) == pytest.approx(PEAK, abs=5.0)
        record = board.recorded()
        assert next(each for each in record if each.mode == 0 and each.period > 20).outputs == ZONE.defaults
        for *_, gone in kill_hosts(times, lambda _: heat(None, **line), heats, board):
            assert (gone.outputs, gone.silent <= TIMEOUT_PERIODS) == (ZONE.defaults, True)
