"""Alarms and clients: what a client may do with them, what it is answered, and what others see of them."""

from __future__ import annotations

from collections.abc import Iterator
from math import inf, nan
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.machines import sensor, timer, wired
from helpers.operator import Operator
from umo import Compound, DigitalSensor, connect
from umo.cycle.events import ALARM, KEPT_EVENTS, CommandState
from umo.operation.alarms import Alarm, AlarmState, High, Operation, Priority
from umo.operation.alarms.alarm_times import AlarmTimes
from umo.operation.alarms.alarming import engine_of
from umo.operation.alarms.engine import AlarmRequest
from umo.operation.commands.client_commands import Mode
from umo.process.frames.alarm_list import alarm_rows, alarms_text
from umo.testing import Scripted


class Tank(
    Compound,
    alarms={
        "full": Alarm(High("level", 80.0), "too full"),
        "flooded": Alarm(High("level", 90.0), "flooded", priority=Priority.CRITICAL, latch=True),
    },
):
    level: DigitalSensor


class Plant(Compound):
    timer: DigitalSensor
    tanks: list[Tank]


class Rig:
    def __init__(self, mode: Mode = Mode.AUTOMATIC) -> None:
        self.box = Scripted()
        machine = Plant(timer=timer(), tanks=[Tank(level=sensor(resolution=1.0)) for _ in range(2)])
        self.connection = connect(machine, wired(machine, self.box))
        self.m = self.connection.__enter__()
        self.ann = Operator(machine, mode)

    def flood(self, number: int, level: int = 95) -> None:
        self.box.set(f"tanks.{number}.level", level)
        self.ann.run()

    @property
    def rows(self) -> list[Any]:
        machine = self.connection.machine
        engine = engine_of(machine)
        assert engine is not None
        described = [each.describe() for each in engine.declared]
        times = list(map(AlarmTimes, *engine.times.tolist()))
        return alarm_rows(described, machine.image.columns.alarms.tolist(), machine.events, times)

    def states(self) -> dict[str, str]:
        return {row.path: str(row.state) for row in self.rows}


@pytest.fixture(params=[Mode.AUTOMATIC, Mode.MANUAL], ids=str)
def rig(request: pytest.FixtureRequest) -> Iterator[Rig]:
    rig = Rig(request.param)
    yield rig
    rig.connection.__exit__(None, None, None)


@pytest.mark.parametrize("do", ["acknowledge alarm", "reset alarm", "shelve", "unshelve"])
def test_every_command_needs_the_lease(rig: Rig, do: str) -> None:
    rig.flood(0)
    answer = rig.ann.do(do, "tanks.0.full", 60.0)
    assert (answer.state, answer.text) == (
        CommandState.REFUSED,
        "CommandRefused: nobody has the lease; take it first",
    )
    assert rig.states()["tanks.0.full"] == "unacknowledged"


def test_one_is_acknowledged_by_its_path_and_several_by_a_pattern(rig: Rig) -> None:
    rig.flood(0)
    rig.flood(1)
    rig.ann.do("lease")
    assert rig.ann.do("acknowledge alarm", "tanks.0.full").text == '"acknowledged: tanks.0.full"'
    assert rig.ann.do("acknowledge alarm", "tanks.*.flooded").text == (
        '"acknowledged: tanks.0.flooded and tanks.1.flooded"'
    )
    assert rig.states() == {
        "tanks.0.full": "acknowledged",
        "tanks.0.flooded": "acknowledged",
        "tanks.1.full": "unacknowledged",
        "tanks.1.flooded": "acknowledged",
    }
    assert [row.who for row in rig.rows if row.path == "tanks.0.full"] == ["ann"]


def test_commands_for_many_alarms_are_carried_out_one_after_another_each_in_a_period_of_its_own(rig: Rig) -> None:
    rig.flood(0)
    rig.flood(0, level=10)
    assert rig.states()["tanks.0.flooded"] == "latched unacknowledged"
    rig.ann.do("lease")
    asked: dict[str, Any] = {"acknowledge alarm": None, "reset alarm": None, "shelve": 60.0}
    commands = [rig.ann.send(do, "tanks.0.flooded", value) for do, value in asked.items()]
    rig.ann.run(len(commands))
    assert {rig.ann.answer(each).state for each in commands} == {CommandState.DONE}
    told = [event.text.partition(" (")[0] for event in rig.ann.events if event.asked == ALARM and event.who == "ann"]
    assert told == ["latched acknowledged", "normal", "shelved"]


def test_many_are_reset_at_once_after_they_were_acknowledged() -> None:
    box, machine = Scripted(), Plant(timer=timer(), tanks=[Tank(level=sensor(resolution=1.0)) for _ in range(60)])
    with connect(machine, wired(machine, box)) as m:
        ann = Operator(m)
        ann.do("lease", seconds=5.0)
        for level in (95, 10):
            for number in range(60):
                box.set(f"tanks.{number}.level", level)
            ann.run(10)
        assert ann.do("acknowledge alarm").text.endswith('and 118 others"')
        assert ann.do("reset alarm").text.endswith('and 58 others"')
        ann.run(10)
        assert not ann.machine.image.columns.alarms.any()


ASKED = st.sampled_from([each for each in Operation if each > Operation.CANNOT_EVALUATE])


@given(st.lists(st.tuples(ASKED, st.sets(st.integers(0, 5), min_size=1)), max_size=6), ASKED)
@settings(max_examples=40, deadline=None)
def test_what_can_be_done_is_known_before_what_was_asked_for_is_carried_out(
    asked: list[tuple[Operation, set[int]]], then: Operation
) -> None:
    box, machine = Scripted(), Plant(timer=timer(), tanks=[Tank(level=sensor(resolution=1.0)) for _ in range(3)])
    with (connection := connect(machine, wired(machine, box))) as m:
        ann, engine = Operator(m), engine_of(connection.machine)
        box.set("tanks.0.level", 95)
        box.set("tanks.1.level", 85)
        ann.run(3)
        for operation, rows in asked:
            able = engine.able(sorted(rows), operation)
            engine.request(able, AlarmRequest(operation, "ann", 600.0))
        foreseen = engine.able(range(6), then)
        ann.run(10)
        assert foreseen == engine.able(range(6), then)


def test_what_cannot_be_done_is_refused_with_the_state(rig: Rig) -> None:
    rig.ann.do("lease")
    assert (
        rig.ann.do("reset alarm", "tanks.0.full").text == "CommandRefused: tanks.0.full is normal: it cannot be reset"
    )
    assert rig.ann.do("reset alarm").text == '"none of these alarms can be reset"'
    assert rig.ann.do("shelve", "tanks.0.fall", 60.0).text == ("PathError: there is no alarm 'tanks.0.fall'")
    assert rig.ann.do("shelve", "*.full", 60.0).text == (
        "PathError: there is no alarm '*.full'; * stands for one part of a path"
    )


@pytest.mark.parametrize("path", ["", "tanks.0", "tanks.0.full"])
def test_an_acknowledgement_without_effect_is_no_error(rig: Rig, path: str) -> None:
    rig.ann.do("lease")
    answer = rig.ann.do("acknowledge alarm", path)
    assert answer.state is CommandState.DONE and answer.text == '"nothing to acknowledge"'


@pytest.mark.parametrize("time", [0.0, -1.0, True, "10 mi", "8 d", float("nan"), float("inf"), 1e9, [], 10**400])
def test_a_shelf_has_a_time(rig: Rig, time: Any) -> None:
    rig.ann.do("lease")
    answer = rig.ann.do("shelve", "tanks.0.full", time)
    assert answer.state is CommandState.REFUSED
    assert answer.text.startswith("RangeError: time must be a time from 0.001 to 604800 s, not ")


def test_the_time_of_a_shelf_may_have_a_unit_and_must_not_be_left_out(rig: Rig) -> None:
    rig.ann.do("lease")
    assert rig.ann.do("shelve", "tanks.0.full").text == (
        'RangeError: shelve needs time: a time from 0.001 to 604800 s, such as "10 min"'
    )
    assert rig.ann.do("shelve", "tanks.0.full", "10 min").state is CommandState.DONE
    assert rig.rows[0].until == pytest.approx(600.0, abs=1.0)


@pytest.mark.parametrize("do", ["acknowledge alarm", "clear", "let go"])
def test_arguments_that_a_verb_does_not_have_are_refused(rig: Rig, do: str) -> None:
    rig.ann.do("lease")
    assert rig.ann.do(do, "tanks.0", 1.0).text == f"RangeError: {do} takes no value"
    answer = rig.ann.do(do, "tanks.0", arguments={"tme": 1.0})
    assert answer.text == f"RangeError: {do} has no argument 'tme': it takes no arguments"


def test_a_shelved_alarm_is_not_told_until_it_is_unshelved(rig: Rig) -> None:
    rig.ann.do("lease")
    answer = rig.ann.do("shelve", "tanks.0", 60.0).text
    assert "shelved for 60 s, or until the run ends: tanks.0.full and tanks.0.flooded" in answer
    (until,) = {row.until for row in rig.rows}
    assert until == pytest.approx(60.0, abs=1.0)
    assert {(row.note, row.who) for row in rig.rows} == {("", "ann")}
    rig.flood(0)
    assert set(rig.states().values()) == {"shelved active"}
    assert alarms_text(rig.rows) == []
    rig.ann.do("unshelve", "tanks.0.full")
    assert rig.states() == {"tanks.0.full": "unacknowledged", "tanks.0.flooded": "shelved active"}


def test_what_is_to_be_acknowledged_stands_first_then_by_priority(rig: Rig) -> None:
    rig.flood(0)
    rig.ann.do("lease")
    rig.ann.do("acknowledge alarm", "tanks.0.flooded")
    rig.flood(1)
    assert [row.path for row in rig.rows] == ["tanks.1.flooded", "tanks.1.full", "tanks.0.full", "tanks.0.flooded"]
    assert alarms_text(rig.rows)[-2:] == ["tanks.0.full: too full (medium, unacknowledged)", "and 1 more"]


def test_an_alarm_out_of_service_comes_back_when_it_is_returned(rig: Rig) -> None:
    rig.ann.do("lease")
    rig.ann.do("remove from service", "tanks.0.full")
    rig.flood(0, level=85)
    assert rig.states() == {"tanks.0.full": str(AlarmState.OUT_OF_SERVICE)}
    rig.ann.do("return to service", "tanks.0.full")
    assert rig.states() == {"tanks.0.full": "unacknowledged"}


def test_the_time_at_which_an_alarm_began_is_known_also_when_its_event_is_no_longer_kept(rig: Rig) -> None:
    rig.flood(0)
    began = [row.since for row in rig.rows]
    assert None not in began
    for _ in range(KEPT_EVENTS):
        rig.connection.machine.root.cycle.tell("something else")
    assert [(row.since, row.who) for row in rig.rows] == [(time, "") for time in began]


@pytest.mark.parametrize("raised", [inf, -inf, nan, -1.0, 0.0])
def test_a_count_in_a_damaged_ring_that_is_no_number_is_not_told(raised: float) -> None:
    entries = [{"path": "tank.full", "text": "full", "priority": "high"}]
    (row,) = alarm_rows(entries, [int(AlarmState.UNACKNOWLEDGED)], [], [AlarmTimes(raised)])
    assert row.raised == 0
