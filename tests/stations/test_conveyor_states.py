"""The states of the conveyor's sorter, in virtual time: held, suspended, stopped and aborted with parts on the belt."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from random import Random
from typing import Any

import pytest

from helpers.operator import Operator
from helpers.tiers import first
from umo import TaskFailed, connect
from umo.cycle.events import CommandState
from umo.errors import CommandRefused
from umo.operation import PackMLState
from umo.operation.alarms import AlarmState
from umo.operation.alarms.alarming import engine_of
from umo.process.station import find
from umo.stations.conveyor.application import main
from umo.stations.conveyor.control import Conveyor
from umo.stations.conveyor.objects import machine
from umo.stations.conveyor.plant import OUTPUTS, Plant, Workpiece
from umo.testing import periods

S = PackMLState
SIMULATED = find("conveyor").wirings["simulated"]
WHILE_SORTING = (S.HOLDING, S.HELD, S.UNHOLDING, S.SUSPENDING, S.SUSPENDED, S.UNSUSPENDING)


class Sorted:
    """A conveyor on which the application runs, its plant, and what an operator does."""

    def __init__(self, connection: connect[Conveyor], plant: Plant, options: dict[str, Any]) -> None:
        m = connection.root
        self.connection, self.m, self.plant, self.unit = connection, m, plant, m.sorter.unit
        self.parts = options["parts"]
        self.task = m.cycle.start(main(m, **options))

    def until(self, *states: PackMLState, within: int = 10_000) -> None:
        for _ in range(within):
            if self.unit.state in states:
                return
            periods(self.m)
        raise AssertionError(f"{self.unit.state.name}: {self.cause}")

    @property
    def cause(self) -> str:
        """Why nothing is sorted. A signal to the process of the tests stops every machine in it."""
        stop = self.connection.stop
        return f"this process got the signal {stop.signal}" if stop.requested else self.m.sorter.cause

    def to(self, command: str, *states: PackMLState) -> None:
        """Give a command, and let periods pass until a state is reached."""
        self.unit.command(command)
        self.until(*states)

    def lead_to(self, state: PackMLState) -> None:
        """Bring a sorter that sorts into a state."""
        ways = {
            S.HOLDING: ["hold"],
            S.HELD: ["hold"],
            S.UNHOLDING: ["hold", "unhold"],
            S.SUSPENDING: ["suspend"],
            S.SUSPENDED: ["suspend"],
            S.UNSUSPENDING: ["suspend", "unsuspend"],
            S.COMPLETING: ["complete"],
            S.STOPPING: ["stop"],
        }
        for command in ways.get(state, []):
            self.until(S.EXECUTE, S.HELD, S.SUSPENDED)
            self.unit.command(command)
        self.until(state)

    def fail(self) -> None:
        async def fails() -> None:
            raise TaskFailed("a failure")

        self.m.sorter.cycle.start(fails())
        periods(self.m, 2)

    def go_on(self) -> None:
        """What an operator does after a fault or a stop."""
        if self.unit.state is S.ABORTED:
            self.to("clear", S.STOPPED)
        self.to("reset", S.IDLE)
        self.to("start", S.EXECUTE)

    def finish(self) -> dict[str, Any]:
        """Let the lot be carried out: the result of the application."""
        for _ in range(20_000):
            if self.task.done:
                break
            periods(self.m)
        assert self.task.done and self.task.result is not None, self.cause
        assert self.unit.state is S.COMPLETE
        assert self.plant.outputs == dict.fromkeys(OUTPUTS, 0)
        return dict(self.task.result)

    def assert_all_sorted(self) -> None:
        """No part was lost, and the plant agrees."""
        result, report = self.finish(), self.plant.report()
        assert (report["parts_delivered"], report["wrongly_sorted"]) == (self.parts, 0)
        assert result["accepted"] == len(self.plant.accepted) == self.unit.produced
        assert result["rejected"] == len(self.plant.rejected) == self.unit.rejected == self.m.sorter.in_bin


@contextmanager
def sorting(*, faults: Any = (), parts: int = 8, more: int = 0, **options: Any) -> Iterator[Sorted]:
    """A sorter that has begun to sort; `more` parts come than were ordered."""
    connection = connect(machine(), SIMULATED, parts=parts + more, seed=1, faults=faults)
    with connection:
        plant = connection.driver("plant")
        assert isinstance(plant, Plant)
        run = Sorted(connection, plant, {"parts": parts} | options)
        run.until(S.STARTING)
        yield run


def test_without_an_operator_a_run_starts_sorts_and_is_complete() -> None:
    seen = []
    connection = connect(machine(), SIMULATED, parts=3)
    with connection as m:
        task = m.cycle.start(main(m, parts=3))
        while not task.done:
            periods(m)
            if m.sorter.unit.state not in seen:
                seen.append(m.sorter.unit.state)
    assert seen == [
        S.RESETTING, S.STARTING, S.EXECUTE, S.COMPLETING, S.COMPLETE,
    ]  # fmt: skip


@pytest.mark.parametrize("state", first(1, WHILE_SORTING), ids=lambda each: each.name.lower())
def test_parts_on_the_belt_stay_known_in_each_state_in_which_it_brakes_or_stands(state: PackMLState) -> None:
    with sorting() as run:
        periods(run.m, 1_300)
        run.lead_to(state)
        assert run.m.sorter.on_belt
        if state in (S.HELD, S.SUSPENDED):
            periods(run.m, 2_000)
            assert run.plant.speed == pytest.approx(0.0, abs=0.01)
            run.unit.command("unhold" if state is S.HELD else "unsuspend")
        else:
            run.until(S.HELD, S.SUSPENDED, S.EXECUTE)
            if run.unit.state is not S.EXECUTE:
                run.unit.command("unhold" if run.unit.state is S.HELD else "unsuspend")
        run.assert_all_sorted()


@pytest.mark.parametrize("seed", first(1, range(40)))
@pytest.mark.parametrize("speed", first(1, [0.3, 1.0]))
def test_a_sorter_that_is_held_and_suspended_at_any_moments_sorts_rightly(seed: int, speed: float) -> None:
    """At 1 m/s a part passes all of the belt while it brakes."""
    random = Random(seed)
    with sorting(speed=speed) as run:
        for _ in range(6):
            periods(run.m, random.randrange(600))
            command, back = random.choice([("hold", "unhold"), ("suspend", "unsuspend")])
            if command not in run.unit.possible:
                continue
            run.unit.command(command)
            periods(run.m, random.randrange(1_500))
            if back in run.unit.possible:
                run.unit.command(back)
        run.until(S.EXECUTE, S.HELD, S.SUSPENDED, S.COMPLETE)
        if run.unit.state in (S.HELD, S.SUSPENDED):
            run.unit.command("unhold" if run.unit.state is S.HELD else "unsuspend")
        run.assert_all_sorted()


ACTING = [S.STARTING, S.EXECUTE, S.HOLDING, S.UNHOLDING, S.SUSPENDING, S.UNSUSPENDING, S.COMPLETING, S.STOPPING]


@pytest.mark.parametrize("state", first(1, ACTING), ids=lambda each: each.name.lower())
def test_a_failure_in_each_acting_state_is_aborted_and_can_be_cleared(state: PackMLState) -> None:
    """What is on the belt is pushed onto the chute by the next start, and the lot is completed."""
    with sorting(patience=100.0, more=2) as run:
        if state is not S.STARTING:
            periods(run.m, 1_500)
            run.lead_to(state)
        run.fail()
        assert (run.unit.state, run.m.sorter.cycle.fault) == (S.ABORTED, "a failure")
        assert run.plant.outputs == dict.fromkeys(OUTPUTS, 0)
        periods(run.m, 100)
        on_belt = run.m.sorter.on_belt
        run.to("clear", S.STOPPED)
        assert (run.unit.rejected, run.m.sorter.lot.lost) == (len(on_belt), len(on_belt))
        run.go_on()
        result = run.finish()
        assert run.unit.produced + run.unit.rejected == result["accepted"] + result["rejected"] == 8
        assert abs(len(run.plant.rejected) - run.unit.rejected) <= 1, "one that moved while the drive braked"
        assert run.plant.report()["wrongly_sorted"] <= len(on_belt)


@pytest.mark.parametrize("seed", first(1, range(60)))
@pytest.mark.parametrize(("command", "state"), [("stop", S.STOPPED), ("abort", S.ABORTED)])
def test_after_a_stop_or_an_abort_at_any_moment_no_part_that_was_not_measured_is_accepted(
    seed: int, command: str, state: PackMLState
) -> None:
    with sorting(patience=100.0, parts=6, more=4) as run:
        periods(run.m, Random(seed).randrange(500, 2_200))
        if run.unit.state is S.COMPLETE:
            return
        run.to(command, state)
        periods(run.m, 500)
        on_belt = [part for part in run.plant.belt if part.front > 0.0 and (part.front + part.rear) / 2 < 470.0]
        if run.m.sorter.lot.done + len(run.m.sorter.on_belt) < 6:
            run.go_on()
            run.finish()
            assert [part for part in on_belt if part not in run.plant.rejected] == []


def test_without_parts_the_sorter_suspends_itself_tells_it_and_goes_on_when_parts_come() -> None:
    with sorting(parts=4, patience=100.0) as run:
        assert len(run.plant.coming) == 3  # one lies on the belt
        late, run.plant.coming[1:] = run.plant.coming[1:], []
        run.until(S.SUSPENDED)
        assert (len(run.plant.accepted) + len(run.plant.rejected), run.m.sorter.waits) == (2, True)
        assert run.m.sorter.cause == "no part came on 500 mm of belt"
        alarms = engine_of(run.connection.machine)
        assert alarms is not None
        number = alarms.paths.index("sorter.no parts")
        periods(run.m, 4_900)
        assert AlarmState(alarms.states[number]) is AlarmState.NORMAL
        periods(run.m, 200)
        assert AlarmState(alarms.states[number]) is AlarmState.UNACKNOWLEDGED
        run.plant.coming += late
        run.unit.unsuspend()
        run.assert_all_sorted()


@pytest.mark.full
def test_with_a_full_bin_the_sorter_suspends_itself_until_it_is_emptied() -> None:
    with sorting(parts=8, patience=100.0) as run:
        run.m.sorter.bin_capacity = 2
        run.until(S.SUSPENDED)
        assert run.m.sorter.in_bin == 2
        with pytest.raises(CommandRefused, match="the reject bin is full: empty it and call bin_emptied"):
            run.unit.unsuspend()
        run.m.sorter.bin_emptied()
        run.m.sorter.bin_capacity = 100
        run.unit.unsuspend()
        assert run.finish()["rejected"] == run.unit.rejected == run.m.sorter.in_bin + 2


def test_a_jam_is_an_alarm_until_it_is_cleared() -> None:
    with sorting(faults=["jam"], patience=100.0) as run:
        run.until(S.ABORTED)
        periods(run.m, 2)
        alarms = engine_of(run.connection.machine)
        assert alarms is not None
        number = alarms.paths.index("sorter.jam")
        assert AlarmState(alarms.states[number]) is AlarmState.UNACKNOWLEDGED
        run.plant.faults.clear()
        run.to("clear", S.STOPPED)
        periods(run.m, 2)
        assert AlarmState(alarms.states[number]) is AlarmState.RETURNED
        run.plant.belt.clear()  # by the operator
        run.go_on()


def test_after_the_emergency_stop_it_must_be_released_acknowledged_and_cleared() -> None:
    with sorting(patience=100.0) as run:
        periods(run.m, 1_000)
        run.plant.fault_at = 0.0
        run.plant.faults.add("emergency-stop")
        run.until(S.ABORTED, within=3)
        assert run.plant.outputs == dict.fromkeys(OUTPUTS, 0)
        run.to("clear", S.STOPPED)
        run.to("reset", S.IDLE)
        with pytest.raises(CommandRefused, match="the emergency stop was pressed: release it and acknowledge"):
            run.unit.start()
        run.plant.faults.clear()
        periods(run.m)
        assert run.m.acknowledge()
        run.to("start", S.EXECUTE)


def test_an_order_that_an_operator_completes_early_ends_the_run_with_what_was_sorted() -> None:
    with sorting(parts=8) as run:
        while len(run.m.sorter.lot.measured) < 3:
            periods(run.m)
        run.unit.complete()
        assert len(run.finish()["lengths_mm"]) == 3


def test_a_second_order_goes_on_with_the_parts_that_are_on_the_belt() -> None:
    with sorting(parts=3, more=3) as run:
        run.finish()
        assert run.m.sorter.on_belt
        run.task, run.parts = run.m.cycle.start(main(run.m, parts=3)), 6
        periods(run.m, 2)
        run.until(S.COMPLETE)
        periods(run.m)
        assert run.task.result["accepted"] + run.task.result["rejected"] == 3
        assert run.plant.report()["parts_delivered"] == 6
        assert run.plant.report()["wrongly_sorted"] == 0


def test_a_client_gives_the_commands() -> None:
    with sorting() as run:
        ann = Operator(run.m)
        ann.do("lease", seconds=60.0)
        ann.run(1_000)
        for command, state in [("hold", S.HELD), ("unhold", S.EXECUTE), ("abort", S.ABORTED), ("clear", S.STOPPED)]:
            assert ann.call(f"sorter.unit.{command}").state is CommandState.DONE
            ann.run(600)
            assert run.unit.state is state
        assert ann.call("sorter.unit.start").state is CommandState.REFUSED


def test_the_counts_and_the_bin_are_kept_over_a_restart() -> None:
    with (connection := connect(machine(), SIMULATED)):
        kept = set(connection.machine.directory.kept)
        assert kept == {"sorter.in_bin", "sorter.unit.produced", "sorter.unit.rejected"}


def test_parts_that_lie_on_the_belt_at_the_first_start_are_pushed_onto_the_chute() -> None:
    with sorting(parts=4, patience=100.0) as run:
        run.plant.belt[:0] = [Workpiece(80.0, True, 30.0, front) for front in (430.0, 260.0, 120.0)]
        run.until(S.EXECUTE)
        result = run.finish()
        assert len(run.plant.rejected) == result["rejected"] + 3
        assert len(run.plant.accepted) == result["accepted"]
