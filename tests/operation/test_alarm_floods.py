"""A flood of alarms: every edge is noticed in its period, whatever else happens in it; only the telling is spread.

Random floods are played by the engine and by a model that knows one alarm at a time and has no arrays.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from math import isnan
from types import SimpleNamespace
from typing import Any

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import Phase, given, settings

from helpers.machines import timer
from helpers.tiers import budget
from tools.planted_faults import Edit, edited
from umo import Compound, DigitalSensor
from umo.cycle.columns import Columns
from umo.objects import atoms
from umo.operation.alarms import Alarm, AlarmEngine, AlarmState, High, Operation, Priority, alarms_of
from umo.operation.alarms.alarm_states import PUT_AWAY, PUTTING_AWAY, transitions
from umo.operation.alarms.change_events import LEFT_OUT, MOST_IN_A_PERIOD, WINDOW, ChangeEvents
from umo.operation.alarms.engine import AlarmRequest

PERIOD = 0.25
"""s; sums of it are exact."""
DELAYS = st.sampled_from([0.0, 0.0, 0.5, 1.0])
BY_CLIENTS = (Operation.ACKNOWLEDGE, Operation.RESET, *sorted(PUTTING_AWAY))


@dataclass
class Told:
    """What is told of one alarm."""

    states: list[str] = field(default_factory=list)
    times: list[float] = field(default_factory=list)
    left_out: int = 0


class Engine:
    """The engine alone: a sensor for each alarm, which is active above 50."""

    def __init__(self, alarms: list[dict[str, Any]], period: float = PERIOD) -> None:
        count = len(alarms)
        declared = {
            f"a{n}": Alarm(High(f"sensors.{n}", 50.0), "above", **({"priority": Priority(1 + n % 4)} | options))
            for n, options in enumerate(alarms)
        }

        class Plant(Compound, alarms=declared):
            timer: DigitalSensor
            sensors: list[DigitalSensor]

        sensors = [DigitalSensor("mm", minimum=0, maximum=100, resolution=1) for _ in range(count)]
        machine = Plant(timer=timer(), sensors=sensors)
        items = list(atoms(machine))
        columns = Columns(len(items), alarms=count)
        self._slots = [items.index(each) for each in sensors]
        self._values = columns.values
        self.now, self._period = 0.0, period
        self.told = [Told() for _ in alarms]
        self.in_a_period: list[int] = []
        image: Any = SimpleNamespace(columns=columns, items=items)
        self.engine = AlarmEngine(alarms_of(machine), image, lambda: self.now, self._tell)
        self.paths = self.engine.paths

    def _tell(self, path: str, text: str, who: str) -> None:
        told = self.told[self.paths.index(path)]
        told.states.append(text.partition(" (")[0])
        told.times.append(self.now)
        told.left_out += int(found[1]) if (found := re.search(rf"(\d+) {LEFT_OUT}", text)) else 0
        self.in_a_period[-1] += not who

    def period(self, active: list[bool], asked: Sequence[tuple[int, Operation]] = ()) -> list[tuple[int, Operation]]:
        """What was accepted of what was asked for, as the alarms were before this period."""
        self.now += self._period
        self.in_a_period.append(0)
        self._values[self._slots] = np.where(active, 90.0, 10.0)
        accepted = [(row, operation) for row, operation in asked if self.engine.able([row], operation)]
        for row, operation in accepted:
            self.engine.request([row], AlarmRequest(operation, "ann", 1e6))
        self.engine.look()
        return accepted


class Model:
    """One alarm: its condition with delays, its state, its times."""

    def __init__(
        self, latch: bool = False, acknowledge: bool = True, on_delay: float = 0, off_delay: float = 0
    ) -> None:
        self.table = transitions(latch, acknowledge)
        self.delays = {True: on_delay, False: off_delay}
        self.state, self.counts, self.due = AlarmState.NORMAL, False, None
        self.raised: list[float] = []
        self.changes = 0

    def period(self, now: float, active: bool, asked: list[Operation]) -> None:
        if active == self.counts:
            self.due = None
        elif self.due is None:
            self.due = now + self.delays[active]
        if self.due is not None and self.due <= now:
            self.counts, self.due = active, None
            self.raised += [now] if active else []
            self.happens(Operation.ACTIVE if active else Operation.INACTIVE)
        for operation in asked:
            before = self.state
            self.happens(operation)
            if before in PUT_AWAY and self.state not in PUT_AWAY and self.counts:
                self.happens(Operation.ACTIVE)

    def happens(self, operation: Operation) -> None:
        after = self.table.get((self.state, operation))
        self.changes += after is not None and (after is not self.state or operation is Operation.SHELVE)
        self.state = self.state if after is None else after


OPTIONS = st.fixed_dictionaries(
    {"latch": st.booleans(), "acknowledge": st.booleans(), "on_delay": DELAYS, "off_delay": DELAYS}
)


@st.composite
def floods(draw: Any) -> tuple[list[dict[str, Any]], list[tuple[list[bool], list[tuple[int, Operation]]]]]:
    """Alarms with their options; of some periods what is active, and what clients ask for."""
    size = draw(st.sampled_from([1, 3, 50]))
    alarms = draw(st.lists(OPTIONS, min_size=size, max_size=size))
    rows = range(len(alarms))
    asked = st.lists(
        st.tuples(st.sampled_from(rows), st.sampled_from(BY_CLIENTS)), max_size=3, unique_by=lambda each: each[0]
    )
    chatter, count = draw(st.randoms(use_true_random=False)), draw(st.integers(1, 20))
    share = draw(st.sampled_from([0.05, 0.5, 1.0]))
    active, periods = [False] * len(alarms), []
    for _ in range(count):
        active = [each != (chatter.random() < share) for each in active]
        periods.append((active, draw(asked)))
    return alarms, periods


def played(flood: Any) -> str:
    """What the engine does otherwise than the model; "": nothing."""
    alarms, periods = flood
    rig, models = Engine(alarms), [Model(**each) for each in alarms]
    quiet = [(periods[-1][0], [])] * (8 + round(2 * WINDOW / PERIOD))
    for number, (active, asked) in enumerate([*periods, *quiet]):
        accepted = rig.period(active, asked)
        for row, model in enumerate(models):
            model.period(rig.now, active[row], [operation for each, operation in accepted if each == row])
        for row, model in enumerate(models):
            if wrong := _difference(rig.engine, row, model):
                return f"period {number}, alarm {row}: {wrong}"
    if max(rig.in_a_period) > MOST_IN_A_PERIOD:
        return f"{rig.in_a_period} told"
    for row, (told, model) in enumerate(zip(rig.told, models, strict=True)):
        if len(told.states) + told.left_out != model.changes:
            return f"alarm {row}: {told} of {model.changes} changes"
        if model.changes and told.states[-1] != str(model.state):
            return f"alarm {row}: {told.states[-1]} is told last, it is {model.state}"
    return ""


def _difference(engine: AlarmEngine, row: int, model: Model) -> str:
    first, last = (float(each[row]) for each in (engine.first_raised, engine.last_raised))
    if engine.state_of(row) is not model.state:
        return f"{engine.state_of(row)} in place of {model.state}"
    if engine.raised[row] != len(model.raised):
        return f"raised {engine.raised[row]} times, not {model.raised}"
    expected = (model.raised[0], model.raised[-1]) if model.raised else None
    return "" if (first, last) == expected or (expected is None and isnan(first + last)) else f"{first}, {last}"


@budget(15, 40)
@given(flood=floods())
def test_every_edge_of_a_flood_is_noticed_in_its_period_and_told_or_counted(flood: Any) -> None:
    assert played(flood) == ""


@pytest.mark.full
@settings(max_examples=3000)
@given(flood=floods())
def test_every_edge_of_many_floods_is_noticed_in_its_period_and_told_or_counted(flood: Any) -> None:
    assert played(flood) == ""


FAULTS = {
    "few": Edit(AlarmEngine, "look", ("!= self._seen))", "!= self._seen)[:REQUESTS_PER_PERIOD])")),
    "without_delays": Edit(AlarmEngine, "_notice", ("turned & (delays > 0.0)", "turned & (delays < 0.0)")),
    "one_delay": Edit(AlarmEngine, "_notice", ("self._delays[1, rows]", "self._delays[0, rows]")),
    "another_kind": Edit(AlarmEngine, "_step", ("self._kinds[rows]", "self._kinds[0]")),
    "first_is_last": Edit(AlarmEngine, "_count", ("np.fmin(self.first_raised[came], self._now())", "self._now()")),
    "told_all": Edit(
        ChangeEvents, "tell", ("self._told_in_all >= MOST_OF_ALL", "False"), ("len(rows) > room", "False")
    ),
    "not_counted": Edit(ChangeEvents, "changed", ("self._untold[rows] += 1", "self._untold[rows] = 1")),
    "longer_with_each_edge": Edit(
        AlarmEngine, "_notice", ("turned = active", "self._due[self._due < NOT_DUE] += 0.25\n    turned = active")
    ),
}


@pytest.mark.full
@pytest.mark.parametrize("fault", FAULTS)
def test_a_planted_fault_is_found(fault: str) -> None:
    """All of them are found within 100 floods: python -m pytest tests/operation/test_alarm_floods.py -k planted."""

    @settings(max_examples=100, derandomize=True, database=None, phases=[Phase.generate])
    @given(flood=floods())
    def plays(flood: Any) -> None:
        assert played(flood) == ""

    with edited([FAULTS[fault]]), pytest.raises(AssertionError):
        plays()
