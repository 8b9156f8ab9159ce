"""The theta axis runs on a controller, a program of this computer, and the application on the host, unchanged."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import pytest

from helpers.generating import needs_a_compiler
from helpers.peers.text_devices import CannotRun
from helpers.split_parts import (
    ARM,
    AVR,
    BRAKING,
    BRAKING_PERIODS,
    COUNTS_PER_STEP,
    THETA,
    TIMEOUT_PERIODS,
    BadLine,
    EmulatedBoard,
    Recorded,
    RunningController,
    emulated_controller,
    kill_hosts,
)
from umo.cycle.connect import connect
from umo.errors import DriverError

pytestmark = [needs_a_compiler, pytest.mark.full]


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return THETA.program(tmp_path_factory.mktemp("theta"))


def move(
    port: int | None, *positions: float, raws: set[int] | None = None, after: Any = None, **options: Any
) -> list[float]:
    """Move the axis from one position to the next; what the encoder reads at the end of each motion."""
    reached: list[float] = []
    with connect(THETA.machine(), THETA.wiring(port, **options), acknowledge=True) as m:

        async def application() -> None:
            m.theta.encoder.referenced(True)
            for position in positions:
                await m.theta.move_to(position)
                reached.append(m.theta.encoder.read())
                if after is not None:
                    after(m)

        task = m.cycle.start(application())
        while not task.done:
            m.timer.read()
            m.sample()
            if raws is not None:
                raws.add(m.theta.encoder.raw)
            m.control()
            m.update()
    return reached


def steps(each: Recorded) -> bool:
    """Whether the motor is made to step."""
    return each.outputs[0] == 1


def test_the_application_moves_an_axis_whose_law_runs_elsewhere(controller: RunningController) -> None:
    states = []
    assert move(controller.port, 235.0, 225.0, after=lambda m: states.append(m.theta.state.name)) == pytest.approx(
        [235.0, 225.0], abs=0.2
    )
    assert next(controller.recorded()).outputs == THETA.defaults
    assert states == ["STANDSTILL", "STANDSTILL"]


def test_at_the_end_of_a_run_the_outputs_are_at_their_defaults(controller: RunningController) -> None:
    move(controller.port, 229.0)
    rested = next(each for each in controller.recorded() if each.mode == 0 and each.period > 20)
    assert rested.outputs == THETA.defaults


def test_a_tunable_reaches_the_law_and_a_fault_of_the_law_the_host(controller: RunningController) -> None:
    def tune(m: Any) -> None:
        m.theta.following_error = 0.05  # less than a step

    with pytest.raises(DriverError, match=r"AxisError: .* lost steps.*stepper_axis\.py"):
        move(controller.port, 229.0, 235.0, after=tune)


def test_another_version_of_the_part_is_refused(controller: RunningController) -> None:
    with pytest.raises(DriverError, match="another part than theta, or another version of this part: generate the"):
        move(controller.port, 229.0, host_timeout="50 ms")
    with pytest.raises(DriverError, match='write real = "double"'):
        move(controller.port, 229.0, real="float")


@pytest.mark.parametrize("times", [3, 100])
def test_when_the_host_is_killed_the_axis_brakes_and_every_output_goes_to_its_default_in_time(
    program: Path, controller: RunningController, times: int
) -> None:
    found = kill_hosts(times, lambda number: move(controller.port, far(number)), steps, controller)
    assert sum(map(brakes, found)) > times / 2


def far(number: int) -> float:
    """So far away that the axis still moves when its host is killed."""
    return 250.0 if number % 2 else -250.0


def brakes(killed: list[Recorded], longest: int = TIMEOUT_PERIODS + BRAKING_PERIODS) -> bool:
    """The host was killed during a motion: outputs are at their defaults within the longest time, in periods. Whether
    the steps became slower before; not so where the controller has missed periods, in which a stepper stops."""
    *before, gone = killed
    assert gone.outputs == THETA.defaults
    assert gone.silent <= longest
    stepped = [each.period for each in before if each.mode == BRAKING and each.outputs[0]]
    pauses = [after - before for before, after in itertools.pairwise(stepped)]
    return len(pauses) > 5 and sum(pauses[-3:]) > 2 * sum(pauses[:3])


@pytest.mark.parametrize("seed", range(3))
def test_on_a_bad_line_no_value_is_wrong_and_the_axis_arrives(controller: RunningController, seed: int) -> None:
    line, raws = BadLine(controller.port, seed, share=0.05), set[int]()
    line.start()
    try:
        assert move(line.port, 240.0, 225.0, 230.0, raws=raws) == pytest.approx([240.0, 225.0, 230.0], abs=0.2)
    finally:
        line.close()
    assert min(line.treated.values()) > 0
    assert {raw % COUNTS_PER_STEP for raw in raws} == {0}


@pytest.mark.parametrize("times", [3, 100])
@pytest.mark.parametrize("board", [ARM, AVR], ids=lambda board: board.target)
def test_the_same_on_an_emulated_board_over_a_serial_line(tmp_path: Path, board: EmulatedBoard, times: int) -> None:
    try:
        elf = THETA.firmware(tmp_path, board)
    except CannotRun as error:
        pytest.skip(str(error))
    with emulated_controller(board, elf) as controller:
        line = {"serial": controller.serial, "timeout": "3 s", **board.options}
        assert move(None, 229.0, 226.0, **line) == pytest.approx([229.0, 226.0], abs=0.2)
        record = controller.recorded()
        rested = next(each for each in record if each.mode == 0 and each.period > 20)
        assert rested.outputs == THETA.defaults
        found = kill_hosts(times, lambda number: move(None, far(number), **line), steps, controller)
        longest = board.timeout_periods + board.braking_periods
        assert sum(brakes(each, longest) for each in found) > times / 2
