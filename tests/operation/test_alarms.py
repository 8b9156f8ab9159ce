"""Alarms: what is declared is checked, conditions count after their delays, clients acknowledge and shelve."""

from __future__ import annotations

from collections.abc import Iterator
from math import nan
from typing import Any

import pytest

from helpers.machines import actuator, relay, sensor, switch, timer, wired
from umo import BinaryActuator, BinarySensor, Compound, DigitalActuator, DigitalSensor, Interlock, connect
from umo.control import value_of
from umo.cycle.events import ALARM
from umo.errors import DeclarationError
from umo.operation.alarms import Alarm, AlarmState, Bad, High, In, Low, Operation, Priority, alarms_of
from umo.operation.alarms.alarming import engine_of
from umo.operation.alarms.change_events import LEFT_OUT, MOST_IN_A_PERIOD, MOST_OF_ALL, MOST_OF_ONE
from umo.operation.alarms.conditions import FREE_PER_PERIOD
from umo.operation.alarms.engine import AlarmRequest
from umo.states import HighLow, OnOff, PassFail
from umo.testing import Scripted, periods

S = AlarmState
FULL = Alarm(High("level", 80.0, deadband=10.0), "too full", priority=Priority.HIGH)


class Base(Compound, alarms={"full": FULL, "empty": Alarm(Low("level", 5.0), "empty")}):
    timer: DigitalSensor
    level: DigitalSensor
    pump: BinaryActuator[OnOff]
    door: BinarySensor[PassFail]
    motor: DigitalActuator


def tank(alarms: Any = None, **changes: Any) -> Any:
    class Tank(Base, alarms=alarms):
        odd: Any = None

    parts: dict[str, Any] = {"level": sensor(resolution=1.0), "pump": relay(), "door": switch(), "motor": actuator()}
    return Tank(timer=timer(), **parts | changes)


class Rig:
    """A connected tank; the raw integer of its level is the level."""

    def __init__(self, alarms: Any = None, **changes: Any) -> None:
        self.box = Scripted()
        machine = tank(alarms, **changes)
        self.gauge = Scripted({"level": 50})
        wiring = wired(machine, self.box, entries={"level": {"driver": "gauge"}}, gauge=self.gauge)
        self.connection = connect(machine, wiring)
        self.m = self.connection.__enter__()
        self.engine: Any = engine_of(self.connection.machine)

    def periods(self, count: int = 1, **raws: int) -> None:
        for channel, raw in raws.items():
            (self.gauge if channel == "level" else self.box).set(channel, raw)
        for _ in range(count):
            self.m.timer.read()
            self.m.sample()
            self.m.control()
            self.m.update()

    def state(self, path: str) -> AlarmState:
        return AlarmState(int(self.engine.states[self.engine.paths.index(path)]))

    def ask(self, path: str, operation: Operation, seconds: float = 0.0) -> bool:
        row = self.engine.paths.index(path)
        accepted = bool(self.engine.able([row], operation))
        self.engine.request([row], AlarmRequest(operation, "ann", seconds))
        return accepted

    @property
    def told(self) -> list[tuple[str, str, str]]:
        return [(e.path, e.text, e.who) for e in self.connection.machine.events if e.asked == ALARM]


@pytest.fixture
def rig() -> Iterator[Rig]:
    rig = Rig()
    yield rig
    rig.connection.__exit__(None, None, None)


@pytest.fixture
def with_alarms() -> Iterator[Any]:
    made: list[Rig] = []

    def make(alarms: Any, **changes: Any) -> Rig:
        made.append(Rig(alarms, **changes))
        return made[-1]

    yield make
    for each in made:
        each.connection.__exit__(None, None, None)


def test_a_limit_is_exceeded_and_left_by_its_deadband(rig: Rig) -> None:
    rig.periods(level=80)
    assert rig.state("full") is S.NORMAL
    rig.periods(level=81)
    assert rig.state("full") is S.UNACKNOWLEDGED
    rig.periods(level=71)
    assert rig.state("full") is S.UNACKNOWLEDGED
    rig.periods(level=70)
    assert rig.state("full") is S.RETURNED
    assert [text for _, text, _ in rig.told] == [
        "unacknowledged (high): too full",
        "returned (high): too full",
    ]


def test_the_alarms_of_bases_are_kept_and_replaced_by_name(with_alarms: Any) -> None:
    rig = with_alarms({"full": Alarm(High("level", 60.0), "full"), "more": Alarm(In("pump", OnOff.ON), "pumps")})
    assert sorted(rig.engine.paths) == ["empty", "full", "more"]
    rig.periods(level=61)
    assert rig.state("full") is S.UNACKNOWLEDGED


def test_a_client_acknowledges_and_is_told_as_who_did_it(rig: Rig) -> None:
    rig.periods(level=90)
    assert rig.ask("full", Operation.ACKNOWLEDGE)
    rig.periods()
    assert rig.state("full") is S.ACKNOWLEDGED
    assert rig.told[-1] == ("full", "acknowledged (high): too full", "ann")
    assert not rig.ask("full", Operation.ACKNOWLEDGE)
    rig.periods(level=50)
    assert rig.state("full") is S.NORMAL


def test_delays_count_on_the_cycles_clock(with_alarms: Any) -> None:
    rig = with_alarms({"late": Alarm(High("level", 60.0), "late", on_delay="3 ms", off_delay=0.002)})
    rig.periods(3, level=61)
    assert rig.state("late") is S.NORMAL
    rig.periods(level=50)  # it was not for long enough
    rig.periods(3, level=61)
    assert rig.state("late") is S.NORMAL
    rig.periods(level=61)
    assert rig.state("late") is S.UNACKNOWLEDGED
    rig.periods(2, level=50)
    assert rig.state("late") is S.UNACKNOWLEDGED
    rig.periods(level=50)
    assert rig.state("late") is S.RETURNED


def test_a_latched_alarm_stays_until_it_is_acknowledged_and_reset(with_alarms: Any) -> None:
    rig = with_alarms({"held": Alarm(High("level", 60.0), "held", latch=True)})
    rig.periods(level=61)
    rig.periods(level=50)
    assert rig.state("held") is S.LATCHED_UNACKNOWLEDGED
    assert not rig.ask("held", Operation.RESET)
    rig.ask("held", Operation.ACKNOWLEDGE)
    rig.periods()
    assert rig.state("held") is S.LATCHED_ACKNOWLEDGED
    rig.ask("held", Operation.RESET)
    rig.periods()
    assert rig.state("held") is S.NORMAL


def test_a_shelf_ends_by_its_time_and_the_alarm_comes_back(rig: Rig) -> None:
    rig.periods(level=90)
    rig.ask("full", Operation.SHELVE, seconds=0.003)
    rig.periods()
    assert rig.state("full") is S.SHELVED_ACTIVE
    rig.periods(2)
    assert rig.state("full") is S.SHELVED_ACTIVE
    rig.periods()
    assert rig.state("full") is S.UNACKNOWLEDGED
    assert rig.told[-2] == ("full", "normal (high): too full; the shelving time has ended", "")


def test_a_shelved_alarm_tells_when_it_becomes_active_and_returns(rig: Rig) -> None:
    rig.ask("full", Operation.SHELVE, seconds=1.0)
    rig.periods()
    states = []
    for level in (90, 50, 90):
        rig.periods(level=level)
        states.append(rig.state("full"))
    assert states == [S.SHELVED_ACTIVE, S.SHELVED, S.SHELVED_ACTIVE]
    assert rig.told[-3:] == [
        ("full", f"{state} (high): too full", "") for state in ("shelved active", "shelved", "shelved active")
    ]
    rig.ask("full", Operation.UNSHELVE)
    rig.periods()
    assert rig.state("full") is S.UNACKNOWLEDGED


def test_a_shelved_alarm_that_cannot_be_evaluated_is_active(with_alarms: Any) -> None:
    rig = with_alarms({"odd": Alarm(lambda tank: 1 / 0 > 0, "odd")})
    rig.ask("odd", Operation.SHELVE, seconds=1.0)
    rig.periods(2)
    assert rig.state("odd") is S.SHELVED_ACTIVE


def test_a_state_of_an_actuator_and_of_a_sensor(with_alarms: Any) -> None:
    rig = with_alarms(
        {"off": Alarm(In("pump", OnOff.OFF), "off"), "open": Alarm(In("door", PassFail.FAIL), "open")}, odd=1
    )
    rig.periods(door=1)
    assert (rig.state("off"), rig.state("open")) == (S.UNACKNOWLEDGED, S.UNACKNOWLEDGED)
    rig.m.pump.write(OnOff.ON)
    rig.periods(door=0)
    assert (rig.state("off"), rig.state("open")) == (S.RETURNED, S.RETURNED)


def test_a_value_that_is_bad_leaves_the_alarm_as_it_is_and_has_its_own(with_alarms: Any) -> None:
    level = sensor(resolution=1.0, on_error="mark")
    rig = with_alarms({"no level": Alarm(Bad("level"), "not known")}, level=level)
    rig.periods(level=90)
    rig.gauge.set("level", OSError("the wire is broken"))
    rig.periods(2)
    assert rig.state("full") is S.UNACKNOWLEDGED
    assert (rig.state("no level"), rig.state("level.bad")) == (S.UNACKNOWLEDGED, S.UNACKNOWLEDGED)
    rig.periods(level=50)
    assert rig.state("full") is S.RETURNED
    assert rig.state("level.bad") is S.RETURNED


@pytest.mark.parametrize(
    ("condition", "words"),
    [
        (lambda tank: 1 / 0, "ZeroDivisionError: division by zero"),
        (lambda tank: None, "it gives null, which is not True or False"),
        (lambda tank: exec("raise SystemExit(0)"), "SystemExit"),
    ],
)
def test_a_condition_that_cannot_be_evaluated_is_told_and_ends_no_run(
    with_alarms: Any, condition: Any, words: str
) -> None:
    rig = with_alarms({"odd": Alarm(condition, "odd")})
    rig.periods(3)
    assert rig.state("odd") is S.BAD_UNACKNOWLEDGED
    assert [path for path, *_ in rig.told] == ["odd"]
    assert f"cannot be evaluated: {words}" in rig.told[0][1]


def test_free_conditions_take_turns(with_alarms: Any) -> None:
    asked: list[int] = []
    rig = with_alarms(
        {f"n{i}": Alarm(lambda tank, i=i: asked.append(i) is not None, "n") for i in range(50)},
    )
    rig.periods(1)
    assert asked == list(range(20))
    rig.periods(2)
    assert asked == [*range(50), *range(10)]
    assert rig.engine.turns == 3


def test_an_avalanche_is_noticed_in_its_period_and_told_in_several(with_alarms: Any) -> None:
    rig = with_alarms({f"n{i}": Alarm(High("level", 60.0), "n") for i in range(70)})
    rig.periods(level=65)
    assert {rig.state(f"n{i}") for i in range(70)} == {S.UNACKNOWLEDGED}
    assert len(rig.told) == MOST_IN_A_PERIOD
    rig.periods(3)
    assert len(rig.told) == 70


class Cell(Compound, equipment=True):
    motor: DigitalActuator
    level: DigitalSensor

    def interlocks(self) -> Iterator[Interlock]:
        yield Interlock(lambda: self.level.read() > 60.0, [self.motor], "too high", latched=True)

    def control(self) -> None:
        if self.level.read() > 90.0:
            raise ValueError("broken")


class Line(Compound):
    timer: DigitalSensor
    cell: Cell


class Watched(Line, alarms={}):
    pass


def line(kind: type[Line]) -> Line:
    return kind(timer=timer(), cell=Cell(motor=actuator(), level=sensor(resolution=1.0)))


def test_latched_interlocks_and_equipment_in_fault_have_alarms_where_a_class_has_the_keyword() -> None:
    box, machine = Scripted(), line(Watched)
    connection = connect(machine, wired(machine, box))
    with connection as m:
        alarms: Any = engine_of(connection.machine)
        assert alarms.paths == ["cell.fault", "cell.interlock.0"]
        for level, states in ((0, [0, 0]), (61, [0, 1]), (50, [0, 1]), (91, [1, 1])):
            box.set("cell.level", level)
            m.timer.read()
            m.sample()
            m.control()
            m.update()
            assert list(alarms.states) == states
        told = [each.text for each in connection.machine.events if each.path == "cell.fault"]
        assert told[0].startswith("unacknowledged (high): cell is in fault; ValueError: broken (")  # and why
        box.set("cell.level", 0)
        m.cell.cycle.clear()
        m.sample()
        m.acknowledge()
        m.update()
        assert list(alarms.states) == [AlarmState.RETURNED, AlarmState.RETURNED]


class Careful(Cell):
    def interlocks(self) -> Iterator[Interlock]:
        yield Interlock(lambda: value_of(self.level) > 60.0, [self.motor], "too high", latched=True)


def test_the_alarm_of_an_interlock_that_cannot_be_evaluated_says_so_and_not_that_its_condition_is_true() -> None:
    box = Scripted()
    cell = Careful(motor=actuator(), level=sensor(resolution=1.0, on_error="mark", invalid_raws=[7]))
    machine = Watched(timer=timer(), cell=cell)
    connection = connect(machine, wired(machine, box))
    with connection as m:
        alarms: Any = engine_of(connection.machine)
        number = alarms.paths.index("cell.interlock.0")
        periods(m)
        assert alarms.state_of(number) is AlarmState.NORMAL
        box.set("cell.level", 7)
        periods(m)
        assert alarms.state_of(number) is AlarmState.BAD_UNACKNOWLEDGED
        (told,) = [each.text for each in connection.machine.events if each.path == "cell.interlock.0"]
        assert told == "bad unacknowledged (medium): too high; cannot be evaluated: cell.level is BAD"


def test_states_of_an_earlier_run_are_gone_on_with(with_alarms: Any) -> None:
    rig = with_alarms({"held": Alarm(High("level", 60.0), "held", latch=True), "odd": Alarm(lambda _: False, "odd")})
    rig.engine.restore(
        {"full": S.ACKNOWLEDGED, "empty": S.RETURNED, "held": S.LATCHED_ACKNOWLEDGED, "odd": S.UNACKNOWLEDGED, "x": 99}
    )
    rig.periods(level=75)  # within the deadband of what was too full, and above the limit of what was held
    assert [rig.state(path) for path in ("full", "empty", "held", "odd")] == [
        S.ACKNOWLEDGED,
        S.RETURNED,
        S.UNACKNOWLEDGED,
        S.RETURNED,
    ]
    rig.periods(level=65)
    assert rig.state("full") is S.NORMAL


def test_a_condition_that_could_not_be_evaluated_is_gone_on_with_though_its_turn_comes_later(with_alarms: Any) -> None:
    rig = with_alarms({f"odd{i}": Alarm(lambda tank: tank.odd[0], "odd") for i in range(2 * FREE_PER_PERIOD)})
    rig.engine.restore(dict.fromkeys(rig.engine.paths[-2 * FREE_PER_PERIOD :], S.BAD_ACKNOWLEDGED))
    rig.periods(4)
    assert {rig.state(f"odd{i}") for i in range(2 * FREE_PER_PERIOD)} == {S.BAD_ACKNOWLEDGED}
    assert rig.told == []
    rig.m.odd = [False]
    rig.periods(4)
    assert rig.state("odd0") is rig.state(f"odd{2 * FREE_PER_PERIOD - 1}") is S.NORMAL


@pytest.mark.parametrize("number", [-1, 77, S.SHELVED, S.SHELVED_ACTIVE, S.LATCHED_ACKNOWLEDGED])
def test_a_state_that_an_alarm_cannot_have_is_not_gone_on_with(rig: Rig, number: int) -> None:
    rig.engine.restore({"full": number})
    rig.periods()
    assert rig.state("full") is S.NORMAL


def test_a_machine_without_alarms_has_no_engine() -> None:
    machine = line(Line)
    connection = connect(machine, wired(machine, Scripted()))
    with connection:
        assert engine_of(connection.machine) is None


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Alarm(High("levl", 3.0), "x"), "did you mean 'level'"),
        (lambda: Alarm(High("level", 300.0), "x"), "outside the range of level: 0 to 100"),
        (lambda: Alarm(High("level", 3.0, deadband=4.0), "x"), "limit with its deadband, -1 mm, is outside"),
        (lambda: Alarm(High("pump", 3.0), "x"), "pump has states and no numbers; use In"),
        (lambda: Alarm(In("level", OnOff.ON), "x"), "level has no states; use High or Low"),
        (lambda: Alarm(In("pump", HighLow.HIGH), "x"), "not a state of pump, which has OnOff: ON, OFF"),
        (lambda: "x", "is not an Alarm"),
    ],
)
def test_what_fits_nothing_is_refused_when_the_machine_is_connected(make: Any, words: str) -> None:
    machine = tank({"wrong": make()})
    with pytest.raises(DeclarationError, match=words), connect(machine, wired(machine, Scripted())):
        raise AssertionError


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: High("level", nan), "limit=nan is not a finite number"),
        (lambda: High("level", True), "limit=True is not a finite number"),
        (lambda: Low("level", 1.0, deadband=-1.0), "deadband=-1.0 is negative"),
        (lambda: In("pump", "ON"), "'ON' is not a state"),
        (lambda: Bad(""), "'' is not the path"),
        (lambda: Alarm(3, "x"), "not 3"),
        (lambda: Alarm(Bad("level"), "a\nb"), "must be one line"),
        (lambda: Alarm(Bad("level"), "x", priority="hgh"), r"did you mean 'HIGH'"),
        (lambda: Alarm(Bad("level"), "x", on_delay="3 apples"), "on_delay: '3 apples' is not a duration"),
        (lambda: Alarm(Bad("level"), "x", off_delay=nan), "off_delay: nan is not a duration"),
        (lambda: Alarm(Bad("level"), "x", latch=1), "latch=1 is not True or False"),
        (lambda: tank(3), "alarms is a mapping of names to Alarms"),
    ],
)
def test_what_is_wrong_by_itself_is_refused_at_once(make: Any, words: str) -> None:
    with pytest.raises(DeclarationError, match=words):
        make()


@pytest.mark.parametrize("alarms", [{"a.b": FULL}, {3: FULL}, lambda tank: 3, lambda tank: tank.nothing])
def test_what_a_class_declares_is_a_mapping_of_names(alarms: Any) -> None:
    with pytest.raises(DeclarationError, match="alarms of Tank"):
        alarms_of(tank(alarms))


# An alarm that comes and goes all the time ---------------------------------------------------------------


def test_of_an_alarm_that_comes_and_goes_a_few_changes_are_told_and_its_last_state(with_alarms: Any) -> None:
    rig = with_alarms({"full": Alarm(High("level", 80.0), "too full", acknowledge=False)})
    for number in range(401):  # periods of 1 ms
        rig.periods(level=90 if number % 2 == 0 else 50)
    assert len(rig.told) == MOST_OF_ONE
    rig.periods(1000)
    *_, last = rig.told
    assert len(rig.told) == MOST_OF_ONE + 1
    assert last == (
        "full",
        f"acknowledged (medium): too full; {401 - MOST_OF_ONE - 1} changes before this one are not shown",
        "",
    )


def test_what_a_client_does_is_always_told(with_alarms: Any) -> None:
    rig = with_alarms({"full": Alarm(High("level", 80.0), "too full")})
    for number in range(20):
        rig.periods(level=90 if number % 2 == 0 else 50)
    rig.ask("full", Operation.ACKNOWLEDGE)
    rig.periods()
    assert rig.told[-1][2] == "ann"


def test_an_avalanche_leaves_room_for_other_events_and_every_state_is_told_in_the_end(with_alarms: Any) -> None:
    rig = with_alarms({f"full{number}": Alarm(High("level", 80.0), "too full") for number in range(300)})
    rig.periods(50, level=90)
    assert len(rig.told) == MOST_OF_ALL
    rig.periods(1100)
    assert sorted(path for path, *_ in rig.told) == sorted(["full", *(f"full{number}" for number in range(300))])
    assert not any(LEFT_OUT in text for _, text, _ in rig.told)
