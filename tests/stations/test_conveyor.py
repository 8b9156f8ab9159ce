"""The conveyor in virtual time: parts sorted by length, and every way in which a run can end."""

from __future__ import annotations

import json
import math
import re
import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.resources import files
from pathlib import Path
from typing import Any, get_args

import pytest
from typer.testing import Result

from helpers.operator import Operator
from helpers.tiers import first
from umo import connect, drive
from umo.control import until, wait
from umo.cycle.stopping import StopFlag
from umo.errors import ChannelError
from umo.operation import PackMLState
from umo.states import OnOff
from umo.stations.conveyor.application import main
from umo.stations.conveyor.control import Conveyor, covered
from umo.stations.conveyor.errors import PartsLost
from umo.stations.conveyor.objects import machine
from umo.stations.conveyor.plant import LAG, OUTPUTS, Defect, Plant
from umo.testing import periods

Application = Callable[[Conveyor], Any]


def wiring(name: str = "simulated", **parameters: float) -> dict[str, Any]:
    """A wiring of the station, with parameters of the sorter."""
    text = files("umo.stations.conveyor").joinpath(f"wiring/{name}.toml").read_text("utf-8")
    wired = tomllib.loads(text)
    if parameters:
        wired["parameters"] = {f"sorter.{each}": value for each, value in parameters.items()}
    if "plant" in wired["drivers"]:
        wired["drivers"]["plant"]["type"] = "umo.stations.conveyor.plant:Plant"
    return wired


def at(speed: float = 0.3, **options: Any) -> Application:
    """The application with these options; nobody goes on after a fault."""
    return lambda m: main(m, **{"speed": speed, "patience": 0.1} | options)


class Run:
    """One run: its plant afterwards, and its result or its error."""

    def __init__(
        self,
        application: Application | None = None,
        wired: dict[str, Any] | None = None,
        parts: int = 10,
        **options: Any,
    ) -> None:
        self.error: PartsLost | None = None
        self.result: dict[str, Any] = {}
        m = machine()
        connection = connect(m, wired or wiring(), parts=parts, **options)
        try:
            with connection:
                plant = connection.driver("plant")
                assert isinstance(plant, Plant)
                self.plant, self.came = plant, plant.coming.copy()
                connection.machine.observers.append(lambda frame: self._look(m, connection.stop))
                self.result = drive(m, application or at())
        except PartsLost as error:
            self.error = error
        assert self.plant.outputs == dict.fromkeys(OUTPUTS, 0)

    def _look(self, m: Conveyor, stop: StopFlag) -> None:
        if m.now > 60.0:
            stop.request()

    def assert_sorted(self, parts: int = 10) -> None:
        assert self.error is None
        report = self.plant.report()
        assert (report["parts_delivered"], report["wrongly_sorted"]) == (parts, 0)
        assert self.result["accepted"] == len(self.plant.accepted)
        assert self.result["rejected"] == len(self.plant.rejected)

    def length_error(self) -> float:
        """The largest error of a measured length, mm."""
        pairs = zip(self.came, self.result["lengths_mm"], strict=True)
        return max(abs(item.length - float(measured)) for item, measured in pairs)


# Sorting -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", first(1, range(12)))
def test_every_part_is_sorted_rightly(seed: int) -> None:
    run = Run(seed=seed)
    run.assert_sorted()
    assert run.length_error() <= 0.7  # 0.3 m/s, 2 ms; rounded to 0.1 mm
    assert run.plant.speed < 10.0


@pytest.mark.full
@pytest.mark.parametrize("speed", [0.1, 0.6, 1.0])
def test_the_speed_of_the_belt_does_not_matter(speed: float) -> None:
    run = Run(at(speed), seed=5)
    run.assert_sorted()
    assert run.length_error() <= 2.0 * speed + 0.1


@pytest.mark.parametrize("seed", first(1, range(6)))
def test_a_part_is_measured_while_the_speed_changes(seed: int) -> None:
    """While every part covers the entry barrier, the setpoint changes between 0.15 and 0.45 m/s."""
    changes = []

    async def change(m: Conveyor) -> None:
        while True:
            await until(lambda: covered(m.sorter.entry))
            await wait("50 ms")
            assert covered(m.sorter.entry)
            m.sorter.belt.run_at(0.15 if m.sorter.belt.setpoint.pending > 0.3 else 0.45)
            changes.append(m.now)
            await until(lambda: not covered(m.sorter.entry))

    async def application(m: Conveyor) -> Any:
        m.cycle.start(change(m))
        return await main(m, speed=0.45)

    run = Run(application, seed=seed)
    run.assert_sorted()
    assert len(changes) == 10
    assert run.length_error() <= 1.0


@pytest.mark.full
def test_the_belt_may_stand_still_with_parts_on_it() -> None:
    async def pause(m: Conveyor) -> None:
        await wait("2.2 s")
        m.sorter.belt.run_at(0.0)
        await wait("5 s")
        m.sorter.belt.run_at(0.3)

    async def application(m: Conveyor) -> Any:
        m.cycle.start(pause(m))
        return await main(m)

    run = Run(application)
    run.assert_sorted()
    assert run.length_error() <= 0.7


def test_parts_that_are_pushed_one_right_after_the_other_are_sorted_rightly() -> None:
    Run(at(1.0, parts=20, nominal=40.0), parts=20, seed=3, nominal=40.0).assert_sorted(20)


def test_a_part_that_has_slipped_on_the_belt_is_met_by_the_diverter_all_the_same() -> None:
    async def slip(plant: Plant) -> None:
        await until(lambda: bool(plant.belt) and plant.belt[0].rear > 50.0)
        plant.belt[0].front -= 30.0

    async def application(m: Conveyor) -> Any:
        m.cycle.start(slip(plant))
        return await main(m, parts=1)

    plant = Plant(parts=1)
    with connect(machine(), wiring(window=35.0) | {"drivers": {"plant": {"type": plant}}}) as m:
        assert drive(m, application)["rejected"] == 1
    assert plant.report()["wrongly_sorted"] == 0


def test_another_drive_changes_lines_of_the_wiring_only() -> None:
    run = Run(wired=wiring("hertz"), seed=3)
    run.assert_sorted()
    assert run.length_error() <= 0.8


def test_the_parameters_of_the_modbus_wiring_suit_its_longer_period() -> None:
    modbus = wiring("modbus")
    slow = wiring() | {"parameters": modbus["parameters"]}
    slow["wire"]["timer"]["period"] = modbus["wire"]["timer"]["period"]
    run = Run(wired=slow, seed=4)
    run.assert_sorted()
    assert run.length_error() <= 1.6


# Ends ----------------------------------------------------------------------------------------------

ENDS: dict[str, str] = {
    "jam": "part 7 is jammed between the barriers",
    "jam-at-entry": "part 8 is jammed at the entry barrier, or the barrier is stuck",
    "jam-at-exit": "part 6 is jammed at the exit barrier, or the barrier is stuck",
    "taken-away": "part 6 was taken away: part 7 arrived without it",
    "entry-stuck": "the entry barrier is stuck: it stays covered while parts pass it",
    "exit-stuck": "the exit barrier is covered and no part can be there: it is stuck",
    "drive-dead": "the drive runs at 0.000 m/s, 0.300 m/s were commanded",
    "emergency-stop": "the emergency stop was pressed: release it, acknowledge, and clear the belt",
}


@pytest.mark.parametrize("fault", first(3, get_args(Defect)))
def test_every_fault_that_nobody_clears_ends_the_run_with_its_own_message(fault: str) -> None:
    """`Run` asserts that every output is at its default."""
    run = Run(faults=[fault], fault_at=4.0)
    assert ENDS[fault] in str(run.error)
    assert re.search(r"\([1-9] of 10 parts were not sorted\)$", str(run.error))


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("entry", "the entry barrier stays covered at the start: stuck, or a part is jammed there"),
        ("exit", "the exit barrier is covered and no part can be there: it is stuck"),
    ],
)
def test_a_barrier_that_stays_covered_at_the_start_is_found(name: str, text: str) -> None:
    run = Run(faults=[f"{name}-stuck"], fault_at=0.0)
    assert str(run.error).startswith(f"{text} (")


def test_an_entry_barrier_that_gets_stuck_under_a_part_is_told_from_a_jam_by_the_part_itself() -> None:
    async def application(m: Conveyor) -> Any:
        m.cycle.start(stick(m))
        return await at()(m)

    async def stick(m: Conveyor) -> None:
        await until(lambda: covered(m.sorter.entry))
        await wait("100 ms")
        assert covered(m.sorter.entry)
        plant.faults.add("entry-stuck")

    plant = Plant(fault_at=0.0)
    wired = wiring() | {"drivers": {"plant": {"type": plant}}}
    with pytest.raises(PartsLost, match="it stays covered while parts pass it"), connect(machine(), wired) as m:
        drive(m, application)


def test_a_part_that_is_missing_with_none_behind_it_was_taken_away_or_is_jammed() -> None:
    messages = set()
    for fault in ("taken-away", "jam"):
        run = Run(at(0.3, parts=1), parts=1, faults=[fault], fault_at=0.0)
        messages.add(str(run.error).partition(" (")[0])
    assert messages == {"part 1 did not arrive: taken away, or jammed with no part behind it"}


def test_a_run_without_parts_ends() -> None:
    run = Run(at(0.3, parts=4), parts=3)
    assert str(run.error) == "no part came on 500 mm of belt (1 of 4 parts were not sorted)"
    assert len(run.plant.accepted + run.plant.rejected) == 3


def test_a_drive_that_does_not_slow_down_is_found_as_well(monkeypatch: pytest.MonkeyPatch) -> None:
    connection = connect(machine(), wiring())
    with connection as m:
        m.sorter.belt.run_at(0.3)
        periods(m, 900)
        monkeypatch.setattr(connection.driver("plant"), "write", lambda channel, raw: None)
        m.sorter.belt.run_at(0.2)
        periods(m, 900)
        assert m.sorter.cycle.fault == "the drive runs at 0.300 m/s, 0.200 m/s were commanded"
        monkeypatch.undo()


def test_a_setpoint_of_a_drive_that_is_off_is_not_a_fault() -> None:
    with connect(machine(), wiring()) as m:
        m.sorter.belt.setpoint.write(0.3)
        periods(m, 1000)
        m.sorter.belt.run.write(OnOff.ON)
        periods(m, 1000)
        assert m.sorter.belt.speed.read() == pytest.approx(0.3, abs=0.01)


def test_a_dead_drive_is_found_at_a_low_speed() -> None:
    run = Run(at(0.01), faults=["drive-dead"], fault_at=0.0)
    assert "the drive runs at 0.000 m/s, 0.010 m/s were commanded" in str(run.error)


def test_after_a_jam_the_same_machine_sorts_again() -> None:
    m = machine()
    with pytest.raises(PartsLost), connect(m, wiring(), faults=["jam"]):
        drive(m, at())
    connection = connect(m, wiring())
    with connection:
        drive(m, main)
    assert connection.driver("plant").report()["wrongly_sorted"] == 0


# The emergency stop --------------------------------------------------------------------------------


def test_the_emergency_stop_inhibits_until_it_is_released_and_acknowledged() -> None:
    m = machine()
    connection = connect(m, wiring(), fault_at=0.0)
    with connection:
        plant = connection.driver("plant")
        assert isinstance(plant, Plant)
        m.sorter.belt.run_at(0.3)
        m.sorter.diverter.write(OnOff.ON)
        periods(m, 600)
        assert plant.speed > 250.0

        plant.faults.add("emergency-stop")
        periods(m, 2)
        assert plant.outputs == dict.fromkeys(OUTPUTS, 0)  # at once: without the ramp
        assert m.sorter.belt.setpoint.inhibited == m.sorter.belt.run.inhibited == m.sorter.diverter.inhibited
        assert m.sorter.belt.setpoint.inhibited == "the emergency stop was pressed"
        assert m.acknowledge() is False  # it is still pressed

        plant.faults.clear()
        periods(m, 200)
        m.sorter.belt.run_at(0.3)
        periods(m, 200)
        assert plant.outputs == dict.fromkeys(OUTPUTS, 0)

        assert m.acknowledge() is True
        periods(m, 200)
        assert plant.speed < 1.0  # nothing moves before it is commanded again
        m.sorter.belt.run_at(0.3)
        periods(m, 600)
        assert plant.speed > 250.0


def test_a_pressed_emergency_stop_does_not_let_a_run_begin() -> None:
    run = Run(faults=["emergency-stop"], fault_at=0.0)
    assert str(run.error).startswith("the emergency stop was pressed: release it and acknowledge")
    assert run.plant.belt[0].front == -100.0  # the belt has not moved


# Options -------------------------------------------------------------------------------------------


def test_the_options_reach_application_and_plant(umo: Callable[..., Result], tmp_path: Path) -> None:
    options = "--parts 3 --speed 0.5 --nominal 100 --tolerance 6 --seed 2"
    result = umo("run", "conveyor", "--no-plot", *options.split(), "--summary", "summary.json")
    assert result.exit_code == 0, result.output
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["reports"]["plant"]["parts_delivered"] == 3
    assert summary["reports"]["plant"]["wrongly_sorted"] == 0
    assert all(76 <= length <= 124 for length in summary["result"]["lengths_mm"])
    assert summary["progress"] == {"text": "done", "done": 3, "total": 3}


@pytest.mark.parametrize(
    "options, status, message",
    [
        pytest.param("--speed 1.5 --tolerance 8", 1, "speed: 1.5 m/s is outside 0 to 1", marks=pytest.mark.full),
        pytest.param("--speed 0", 1, "0 m/s is 0 mm in a period: it must be above 0", marks=pytest.mark.full),
        ("--tolerance 1 ", 1, "0.3 m/s is 0.6 mm in a period: it must be above 0, at most 0.5 mm"),
        ("--nominal 300", 2, "this must be within 20 to 250 mm"),
        ("--faults jamm", 2, "jamm"),
        pytest.param("--faults jam", 1, "part 7 is jammed between the barriers", marks=pytest.mark.full),
        pytest.param("--parts 0", 0, "accepted", marks=pytest.mark.full),
    ],
)
def test_what_the_application_refuses_and_every_fault_is_a_failure_in_a_line(
    umo: Callable[..., Result], options: str, status: int, message: str
) -> None:
    result = umo("run", "conveyor", "--no-plot", *options.split())
    assert result.exit_code == status, result.output
    assert message in (result.output + result.stderr).replace("\n", " ")
    assert "Traceback" not in result.output


# The plant -----------------------------------------------------------------------------------------


def opened(**options: Any) -> Plant:
    plant = Plant(**options)
    plant.period = 0.002
    plant.open()
    return plant


def test_an_unknown_channel_names_the_nearest_one() -> None:
    with pytest.raises(ChannelError, match="did you mean 'drive:speed'"):
        Plant().channel("drive:sped")


def test_the_drive_is_exact_whatever_the_period() -> None:
    travelled = []
    for period in (0.001, 0.005):
        plant = opened(parts=1)
        plant.period = period
        plant.write(plant.channel("drive:run"), 1)
        plant.write(plant.channel("drive:setpoint"), 8192)
        plant.advance(round(0.25 / period))
        travelled.append(plant.belt[0].front + 100.0)
        assert plant.read(plant.channel("drive:speed")) == round(8192 * (1 - math.exp(-0.25 / LAG)))
    assert travelled == pytest.approx([500.0 * (0.25 - LAG * (1 - math.exp(-0.25 / LAG)))] * 2)


def test_a_part_that_is_not_pushed_stays_on_the_belt_and_is_counted_as_wrong() -> None:
    plant = opened(seed=0, parts=1)
    assert not plant.coming[0].good
    plant.write(plant.channel("drive:run"), 1)
    plant.write(plant.channel("drive:setpoint"), 8192)
    plant.advance(2000)
    report = plant.report()
    assert (report["parts_delivered"], report["wrongly_sorted"]) == (1, 1)
    assert report["worst_length_error_mm"] > 4.0


@pytest.mark.parametrize("offset, hit", [(-45.0, False), (-15.0, True), (15.0, True), (45.0, False)])
def test_the_diverter_rejects_a_part_that_it_meets_near_its_middle(offset: float, hit: bool) -> None:
    """It takes 25 periods of 1 mm to move out."""
    plant = opened(parts=1)
    plant.write(plant.channel("drive:run"), 1)
    plant.write(plant.channel("drive:setpoint"), 8192)
    while not plant.belt or (plant.belt[0].front + plant.belt[0].rear) / 2 < 450.0 + offset - 25.0:
        plant.advance()
    plant.write(plant.channel("dio:diverter"), 1)
    plant.advance(26)
    plant.write(plant.channel("dio:diverter"), 0)
    plant.advance(500)
    assert (len(plant.accepted), len(plant.rejected)) == (not hit, hit)


def test_parts_pile_up_behind_a_jam() -> None:
    plant = opened(faults=["jam"], fault_at=0.0)
    plant.write(plant.channel("drive:run"), 1)
    plant.write(plant.channel("drive:setpoint"), 8192)
    plant.advance(5000)
    assert plant.belt[0].front == 150.0
    assert all(behind.front == before.rear for before, behind in zip(plant.belt, plant.belt[1:], strict=False))
    assert plant.read(plant.channel("dio:entry")) == 1


# Manual mode ---------------------------------------------------------------------------------------


@contextmanager
def operated(**options: Any) -> Iterator[tuple[Operator, Any, Plant]]:
    """An operator of a conveyor that sorts, the run, and the plant."""
    connection = connect(machine(), wiring(), parts=10, seed=1)
    with connection as m:
        ann = Operator(m)
        ann.do("lease", seconds=60.0)
        yield ann, m.cycle.start(main(m, **options)), connection.driver("plant")


@pytest.mark.full
@pytest.mark.parametrize("after", first(2, [300, 1_700, 500, 2_600]))
def test_manual_mode_stops_the_belt_and_parts_are_sorted_rightly_afterwards(after: int) -> None:
    with operated() as (ann, task, plant):
        ann.run(after)
        assert plant.belt
        ann.mode("manual")
        ann.run(500)
        assert (plant.speed, ann.driven) == (pytest.approx(0.0, abs=0.01), "")
        ann.mode("automatic")
        while not task.done:
            ann.run()
        report = plant.report()
        assert (report["parts_delivered"], report["wrongly_sorted"]) == (10, 0)


@pytest.mark.parametrize(("after", "speed"), [(800, 0.3), (1_300, 0.3), (1_000, 0.9)])
def test_parts_that_have_moved_unwatched_are_lost(after: int, speed: float) -> None:
    """Past a barrier, or further than they may slip."""
    with operated(speed=speed) as (ann, _, plant):
        ann.run(after)
        assert plant.belt
        ann.mode("manual")
        ann.run(500)
        ann.mode("automatic")
        ann.run(1_500)
        assert "mm unwatched: clear the belt" in str(ann.m.sorter.cycle.fault)
        assert ann.m.sorter.unit.state is PackMLState.ABORTED
        assert plant.speed == pytest.approx(0.0, abs=0.01)
