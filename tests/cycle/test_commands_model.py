"""The command stage against a model that is written down independently, in whole ticks and exact fractions.

Each actuator has a circuit of its own, so that any of them may fail in any period.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from helpers.conversions import CHOSEN_FIRST, choose
from helpers.machines import actuator, failed, relay, sensor, switch, timer
from helpers.telling import concerned
from helpers.tiers import first
from umo import BinaryActuator, BinarySensor, Compound, DigitalActuator, DigitalSensor, Interlock, Vector, connect
from umo.errors import DriverError, Interlocked
from umo.objects import find
from umo.states import OnOff, PassFail
from umo.testing import Scripted, VirtualTimer, put

PERIOD = Fraction(1, 1024)
"""s; steps and sums of floats are then exact."""
RATE = 1024  # units per s: a unit a tick
EXPIRES = 3  # ticks


class Drives(Compound):
    slow: DigitalActuator
    quick: DigitalActuator


class Machine(Compound):
    timer: DigitalSensor
    door: BinarySensor[PassFail]
    height: DigitalSensor
    drives: Drives
    remote: DigitalActuator
    brake: BinaryActuator[OnOff]

    def interlocks(self) -> Iterator[Interlock]:
        yield Interlock(lambda: self.door.read() is PassFail.FAIL, [self.drives.slow, self.brake], "door")
        yield Interlock(lambda: self.brake.read() is OnOff.ON, [self.drives, self.remote], "brake", effect="stop")
        yield Interlock(lambda: 1 / self.height.read() < 0, [self.drives.slow], "blind", latched=True)  # raises at 0


ACTUATORS = ("drives.slow", "drives.quick", "remote", "brake")


def machine() -> Machine:
    lasting = float(EXPIRES * PERIOD)
    return Machine(
        timer=timer(),
        door=switch(),
        height=sensor(),
        drives=Drives(slow=actuator(default=1.0, slew_rate=float(RATE), expires=lasting), quick=actuator()),
        remote=actuator(synchronous=False, expires=lasting),
        brake=relay(expires=lasting),
    )


# The model --------------------------------------------------------------------------------------------


@dataclass
class Act:
    """One actuator: what its circuit has confirmed, what was asked for, and when."""

    path: str
    default: Fraction
    synchronous: bool = True
    expires: bool = True
    rate: int | None = None
    confirmed: Fraction = Fraction(0)
    wanted: Fraction = Fraction(0)
    sent: Fraction = Fraction(0)
    age: int | None = None
    moved: bool = True
    """Whether it has had its step of this period."""
    owed: bool = False
    """A reset did not get through."""
    broken: bool = False
    failed: bool = False
    """Its last transfer did not get through."""

    def reset(self) -> bool:
        self.wanted = self.sent = self.default
        self.age, self.moved = None, True
        self.owed = self.broken and self.confirmed != self.default
        return self.transfer()

    def transfer(self) -> bool:
        self.failed = self.broken
        if not self.broken:
            self.confirmed = self.sent
        return not self.broken

    def ask(self, value: Fraction) -> bool:
        self.wanted, self.age = value, 0
        return True if self.synchronous else self.send(value)

    def send(self, value: Fraction) -> bool:
        self.sent = value
        return self.transfer()

    def update(self, ticks: int) -> bool:
        if self.rate is None:
            return self.send(self.wanted)
        if self.owed:
            self.sent, self.moved = self.default, True
        elif not self.moved:
            step = self.rate * ticks * PERIOD
            self.sent = self.confirmed + max(-step, min(step, self.wanted - self.confirmed))
            self.moved = True
        if self.transfer():
            self.owed = False
            return True
        return False


@dataclass
class Model:
    acts: dict[str, Act]
    held: dict[str, bool] = field(default_factory=lambda: {"door": False, "brake": False, "blind": False})
    """The conditions when they were last asked."""
    active: dict[str, bool] = field(default_factory=lambda: {"door": False, "brake": False, "blind": False})
    events: list[str] = field(default_factory=list)
    ticks: int = 1

    FORBIDS = {"door": ["drives.slow", "brake"], "brake": ["drives.slow", "drives.quick", "remote"],
               "blind": ["drives.slow"]}  # fmt: skip

    def tick(self, ticks: int) -> None:
        self.ticks = ticks
        for act in self.acts.values():
            act.moved = False
            act.age = None if act.age is None else act.age + ticks

    def sample(self, door: bool, blind: bool) -> list[str]:
        """The actuators whose default did not get through."""
        due = {path for path, act in self.acts.items() if not act.synchronous and act.failed and at_default(act)}
        self.held = {"door": door, "brake": self.acts["brake"].confirmed == 1, "blind": blind}
        for name, holds in self.held.items():
            if holds and not self.active[name]:
                self.events += self.FORBIDS[name]
                due.update(self.FORBIDS[name])
            self.active[name] = holds or (name == "blind" and self.active[name])
        for act in self.acts.values():
            if act.path not in due and act.expires and act.age is not None and act.age >= EXPIRES:
                self.events += [act.path] * (not at_default(act))  # where it is, nothing happens that is to be told
                act.wanted, act.age = act.default, None
                if not act.synchronous:
                    due.add(act.path)
        return [path for path in due if not self.acts[path].reset()]

    def reasons(self, path: str) -> list[str]:
        return [name for name, active in self.active.items() if active and path in self.FORBIDS[name]]

    def answer(self, values: dict[str, Fraction]) -> dict[str, bool] | None:
        """Whether each may be written; None where the interlock that stops the program says no."""
        moved = [path for path, value in values.items() if value != self.acts[path].default]
        if any("brake" in self.reasons(path) for path in moved):
            return None
        return {path: path not in moved or not self.reasons(path) for path in values}

    def acknowledge(self, paths: list[str]) -> bool:
        if not self.held["blind"] and "drives.slow" in paths:
            self.active["blind"] = False
        return not any(self.reasons(path) for path in paths)


def at_default(act: Act) -> bool:
    return act.wanted == act.default


def model() -> Model:
    acts = [
        Act("drives.slow", Fraction(1), rate=RATE, confirmed=Fraction(1), wanted=Fraction(1), sent=Fraction(1)),
        Act("drives.quick", Fraction(0), expires=False),
        Act("remote", Fraction(0), synchronous=False),
        Act("brake", Fraction(0)),
    ]
    return Model({act.path: act for act in acts})


# Both side by side ------------------------------------------------------------------------------------


def patient(box: Scripted) -> dict[str, Any]:
    """A driver that has 1 s for a call, however busy the computer is."""
    return {"type": box, "timeout": "1 s"}


class Pair:
    """The machine and its model, told the same; `check` compares them."""

    def __init__(self, missed: list[int]) -> None:
        self.m, self.model = machine(), model()
        self.boxes = {path: Scripted() for path in ACTUATORS}
        wire: dict[str, Any] = {path: {"driver": path.replace(".", "_")} for path in ACTUATORS}
        wire |= {"door": {"driver": "sensors"}, "height": {"driver": "sensors"}}
        wire["timer"] = {"driver": "clock", "period": float(PERIOD)}
        drivers: dict[str, Any] = {path.replace(".", "_"): patient(box) for path, box in self.boxes.items()}
        drivers |= {"sensors": patient(Scripted({"height": 2})), "clock": VirtualTimer(missed)}
        self.connection = connect(self.m, {"drivers": drivers, "wire": wire})
        self.vector = Vector([self.m.drives.slow, self.m.drives.quick])

    def find(self, path: str) -> Any:
        return find(self.m, path)

    def begin(self, missed: int, door: bool, blind: bool, broken: set[str]) -> None:
        for path, act in self.model.acts.items():
            act.broken = path in broken
            self.boxes[path].broken = OSError("cut") if act.broken else None
        put(self.m.door, PassFail.FAIL if door else PassFail.PASS)
        put(self.m.height, 0.0 if blind else 1.0)
        self.m.timer.read()
        self.model.tick(max(missed, 1))
        self.same_failures(self.m.sample, self.model.sample(door, blind))

    def same_failures(self, call: Callable[[], object], expected: list[str]) -> None:
        try:
            assert call() is not False
            assert expected == []
        except DriverError as error:
            assert sorted(failed(error)) == sorted(expected)

    def write(self, path: str, number: int) -> None:
        value = Fraction(number % 2 if path == "brake" else number)
        given = (OnOff.ON if value else OnOff.OFF) if path == "brake" else float(value)
        taken = self.model.answer({path: value})
        if taken is None:
            with pytest.raises(Interlocked) as caught:
                self.find(path).write(given)
            assert (caught.value.path, caught.value.reason) == (path, "brake")
        elif not taken[path]:
            assert self.find(path).write(given) is False
        else:
            fine = self.model.acts[path].ask(value)
            self.same_failures(lambda: self.find(path).write(given), [] if fine else [path])

    def write_both(self, number: int) -> None:
        values = {"drives.slow": Fraction(number), "drives.quick": Fraction(-number)}
        taken = self.model.answer(values)
        if taken is None:
            with pytest.raises(Interlocked):
                self.vector.write([float(value) for value in values.values()])
            return
        for path, value in values.items():
            if taken[path]:
                self.model.acts[path].ask(value)
        assert self.vector.write([float(value) for value in values.values()]) is all(taken.values())

    def acknowledge(self, part: str) -> None:
        paths = [path for path in ACTUATORS if path.startswith(part)]
        node = self.find(part) if part else self.m
        assert node.acknowledge() is self.model.acknowledge(paths)

    def reset(self, part: str) -> None:
        paths = [path for path in ACTUATORS if path.startswith(part)]
        lost = [path for path in paths if not self.model.acts[path].reset()]
        node = self.find(part) if part else self.m
        self.same_failures(node.reset, lost)

    def update(self, part: str) -> None:
        acts = [act for path, act in self.model.acts.items() if path.startswith(part) and act.synchronous]
        lost = [act.path for act in acts if not act.update(self.model.ticks)]
        node = self.find(part) if part else self.m
        self.same_failures(node.update, lost)

    def check(self) -> None:
        for path, act in self.model.acts.items():
            item, zero_one = self.find(path), {OnOff.ON: 1, OnOff.OFF: 0}
            assert zero_one.get(item.read(), item.read()) == act.confirmed, path
            assert zero_one.get(item.pending, item.pending) == act.wanted, path
            scale = 1 if path == "brake" else 2
            assert self.boxes[path].get(path) == act.confirmed * scale, path
            reason = next(iter(self.model.reasons(path)), None)
            if reason == "blind" and not self.model.held[reason]:
                reason = "blind (latched: acknowledge it)"
            found = re.sub(r"the condition '(\w+)' cannot be evaluated: .*", r"\1", item.inhibited or "")
            assert found == (reason or ""), path
        events = [event for event in self.connection.machine.events if not event.path.startswith("driver ")]
        assert concerned(events) == self.model.events


ACTIONS = st.one_of(
    st.tuples(st.just("write"), st.sampled_from(ACTUATORS), st.integers(-9, 9)),
    st.tuples(st.just("write_both"), st.integers(-9, 9)),
    st.tuples(st.just("reset"), st.sampled_from(["", "drives", *ACTUATORS])),
    st.tuples(st.just("acknowledge"), st.sampled_from(["", "drives", *ACTUATORS])),
    st.tuples(st.just("update"), st.sampled_from(["", "drives", *ACTUATORS])),
)
PERIODS = st.lists(
    st.tuples(
        st.sampled_from([0, 0, 0, 1, 2, 5]),  # missed
        st.sampled_from([False, False, False, True]),  # the door is open
        st.sampled_from([False, False, False, False, True]),  # the condition raises
        st.one_of(st.just(set()), st.just(set()), st.sets(st.sampled_from(ACTUATORS))),  # circuits that fail
        st.lists(ACTIONS, max_size=4),
    ),
    max_size=25,
)


@pytest.mark.parametrize("way", first(1, CHOSEN_FIRST))
@given(steps=PERIODS)
def test_the_command_stage_does_what_a_model_does(way: str, steps: list[Any]) -> None:
    with pytest.MonkeyPatch.context() as patch:
        choose(patch, way)
        pair = Pair([missed for missed, *_ in steps])
        with pair.connection:
            for missed, door, blind, broken, actions in steps:
                pair.begin(missed, door, blind, broken)
                pair.check()
                for verb, *rest in actions:
                    getattr(pair, verb)(*rest)
                    pair.check()
                pair.update("")
                pair.check()
            for box in pair.boxes.values():
                box.broken = None
