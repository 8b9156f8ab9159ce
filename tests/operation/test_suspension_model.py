"""Random programs, modes, leases and operators: nothing is driven with nobody in charge, and no result changes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import umo
from helpers.machines import actuator, relay, timer
from helpers.operator import Operator
from helpers.slide import DT, Slide, servo, stepper
from helpers.tiers import budget, first
from umo import BinaryActuator, Compound, DigitalActuator, DigitalSensor, action
from umo.control import Axis, wait
from umo.control.axis_state import AxisState
from umo.errors import TaskFailed
from umo.objects import Actuator, atoms, find
from umo.operation.commands.client_commands import Mode
from umo.states import OnOff
from umo.testing import Scripted

ON = {"x.motor": "motor", "x.step": "step", "x.direction": "direction", "x.encoder": "counter", "timer": "tick"}
WRITTEN = ("spindle", "valve", "clamp", "pump.motor", "pump.valve")
"""The actuators that programs, actions and operators write."""


class Pump(Compound, when_suspended="hold"):
    motor: DigitalActuator
    valve: BinaryActuator[OnOff]


class Cell(Compound):
    """An axis, actuators that react in different ways, and a law that runs the fan."""

    x: Axis
    spindle: DigitalActuator
    valve: BinaryActuator[OnOff]
    clamp: BinaryActuator[OnOff]
    pump: Pump
    fan: DigitalActuator
    timer: DigitalSensor

    def setup(self) -> None:
        self.by_actions: set[str] = set()

    def control(self) -> None:
        self.fan.write(3.0)

    def put(self, name: str, on: bool) -> None:
        item: Any = find(self, name)
        item.write((OnOff.ON if on else OnOff.OFF) if isinstance(item, BinaryActuator) else 5.0 * on)

    @action
    def leave(self, name: str, on: bool) -> None:
        """Write an actuator, and leave it so."""
        self.by_actions.add(name)
        self.put(name, on)

    @action
    async def work(self, name: str) -> None:
        """Write an actuator for a while, in a sequence that this one leaves behind."""
        self.by_actions.add(name)
        self.cycle.start(self._work(name))

    async def _work(self, name: str) -> None:
        while True:
            self.put(name, True)
            await wait(0.01)

    async def program(self, steps: list[tuple[Any, ...]]) -> None:
        for what, *how in steps:
            if what == "put":
                self.put(*how)
            elif what == "wait":
                await wait(*how)
            else:
                await self.x.move_to(*how)


NAMES = st.sampled_from(WRITTEN)
PROGRAM = st.lists(
    st.one_of(
        st.tuples(st.just("put"), NAMES, st.booleans()),
        st.tuples(st.just("wait"), st.sampled_from([0.01, 0.05, 0.2])),
        st.tuples(st.just("move"), st.sampled_from([38.0, 40.0, 41.0, 43.5])),
    ),
    min_size=1,
    max_size=8,
)
COMMANDS = st.one_of(
    st.tuples(st.just("mode"), st.sampled_from(["manual", "automatic"])),
    st.tuples(st.just("lease")),
    st.tuples(st.just("give back")),
    st.tuples(st.just("die")),
    st.tuples(st.just("jog"), st.sampled_from([-10.0, 10.0])),
    st.tuples(st.just("let go"), st.sampled_from(["x.jog", *WRITTEN])),
    st.tuples(st.just("write"), NAMES),
    st.tuples(st.just("leave"), NAMES, st.booleans()),
    st.tuples(st.just("work"), NAMES),
    st.tuples(st.just("move"), st.sampled_from([39.0, 42.0])),
    st.tuples(st.just("disable")),
)
REACTIONS = st.sampled_from(["", "default", "run on"])
DEEDS = st.lists(st.tuples(st.integers(1, 250), COMMANDS), max_size=12)
"""How many periods pass, and what is done then."""


@contextmanager
def cell(make: Any, reaction: str) -> Iterator[tuple[Operator, Any]]:
    kind: Any = type("Cell", (Cell,), {}, when_suspended=reaction) if reaction else Cell
    pump = Pump(motor=actuator(), valve=relay(when_suspended="default"))
    m = kind(
        x=make(settling_time=5.0), spindle=actuator(), valve=relay(synchronous=False),
        clamp=relay(when_suspended="hold"), pump=pump, fan=actuator(), timer=timer(),
    )  # fmt: skip
    slide = Slide(40.0)
    wire: dict[str, Any] = {
        item.path: {"driver": "slide", "channel": ON[item.path]} if item.path in ON else {"driver": "box"}
        for item in atoms(m)
    }
    wire["timer"]["period"] = DT
    with umo.connect(m, {"drivers": {"slide": slide, "box": Scripted()}, "wire": wire}):
        ann = Operator(m)
        ann.do("lease", seconds=0.3)
        m.x.encoder.referenced(at=40.0)
        yield ann, slide


class Watch:
    """Looks at every period: who is in charge of what is driven, and the limits of the axis."""

    def __init__(self, ann: Operator) -> None:
        self._ann, self._m = ann, ann.m
        self._lease = ann.clients.lease.number
        self._actuators = [item for item in atoms(ann.m) if isinstance(item, Actuator)]
        self.setpoints: list[Any] = []
        ann.machine.observers.append(self.look)

    def look(self, frame: object) -> None:
        m: Any = self._m
        lease = self._ann.clients.lease
        if lease.number != self._lease or not lease.holder:
            self._lease = lease.number
            m.by_actions.clear()
        self.setpoints.append(m.x.profile.setpoint if m.x.enabled else None)
        if self._ann.clients.mode is not Mode.MANUAL:
            return
        for item in self._actuators:
            image = self._ann.machine.image
            slot = image.slot_of[id(item)]
            away = image.columns.defaults[slot] != image.pending[slot]
            charge = (
                item.when_suspended == "hold"
                or item is m.fan
                or (item.path.startswith("x.") and m.x.enabled)
                or item.path in m.by_actions
                or bool(self._ann.machine.claims.client_of(slot))
            )
            assert not away or charge, f"{item.path} is driven with nobody in charge"

    def assert_smooth(self, velocity: float, acceleration: float) -> None:
        for before, after in pairwise(self.setpoints):
            if before is not None and after is not None:
                assert abs(after.velocity) <= velocity * 1.001
                assert abs(after.velocity - before.velocity) <= acceleration * DT * 1.001


LIMITS = {servo: (200.0, 2_000.0), stepper: (15.0, 200.0)}


def obey(ann: Operator, deed: tuple[Any, ...]) -> None:
    """Carry out what the operator does; whatever the machine answers."""
    what, *how = deed
    if what == "mode":
        ann.mode(how[0])
    elif what == "lease":
        ann.alive = True
        ann.do("lease", seconds=0.3)
    elif what == "die":
        ann.alive = False
    elif what == "give back":
        ann.do("give back")
    elif what == "jog":
        ann.call("x.jog", velocity=how[0])
    elif what == "let go":
        ann.do("let go", how[0])
    elif what == "write":
        ann.do("write", how[0], 4.0 if how[0] in ("spindle", "pump.motor") else "ON")
    elif what == "leave":
        ann.call("leave", name=how[0], on=how[1])
    elif what == "work":
        ann.call("work", name=how[0])
    elif what == "move":
        ann.call("x.move_to", position=how[0])
    else:
        ann.call("x.disable")


@pytest.mark.parametrize("make", first(1, [servo, stepper]))
@budget(12, 30)
@given(program=PROGRAM, deeds=DEEDS, reaction=REACTIONS)
def test_nothing_is_driven_with_nobody_in_charge(make: Any, program: Any, deeds: Any, reaction: str) -> None:
    with cell(make, reaction) as (ann, _):
        watch = Watch(ann)
        ann.m.cycle.start(ann.m.program(program))
        try:
            for pause, deed in deeds:
                ann.run(pause)
                obey(ann, deed)
            ann.run(500)
        except TaskFailed as error:  # the operator has disabled the axis of a program that moves it
            assert "was disabled during its motion" in str(error)
        watch.assert_smooth(*LIMITS[make])


@pytest.mark.parametrize("make", first(1, [servo, stepper]))
@budget(8, 20)
@given(program=PROGRAM, modes=st.lists(st.integers(1, 200), max_size=10), reaction=REACTIONS)
def test_manual_mode_without_interference_changes_no_result(make: Any, program: Any, modes: Any, reaction: str) -> None:
    with cell(make, reaction) as (ann, slide):
        watch = Watch(ann)
        task = ann.m.cycle.start(ann.m.program(program))
        for number, pause in enumerate(modes):
            ann.run(pause)
            ann.mode("automatic" if number % 2 else "manual")
            assert ann.clients.mode is (Mode.AUTOMATIC if number % 2 else Mode.MANUAL), ann.notes
        ann.mode("automatic")
        for _ in range(20_000):
            if task.done:
                break
            ann.run()
        ended = {item.path: item.pending for item in atoms(ann.m) if item.path in WRITTEN}  # type: ignore[attr-defined]
        position = slide.position
        watch.assert_smooth(*LIMITS[make])
    with cell(make, reaction) as (ann, slide):
        alone = ann.m.cycle.start(ann.m.program(program))
        while not alone.done:
            ann.run()
        assert ended == {item.path: item.pending for item in atoms(ann.m) if item.path in WRITTEN}  # type: ignore[attr-defined]
        assert position == pytest.approx(slide.position, abs=0.11)


MOVED = st.lists(
    st.tuples(
        st.integers(1, 250),
        st.one_of(
            st.tuples(st.just("jog"), st.sampled_from([-10.0, 10.0])),
            st.tuples(st.just("let go"), st.just("x.jog")),
            st.tuples(st.just("move"), st.sampled_from([39.0, 42.0])),
            st.tuples(st.just("disable")),
            st.tuples(st.just("give back")),
            st.tuples(st.just("lease")),
        ),
    ),
    max_size=3,
)
"""What an operator does with an axis."""


@pytest.mark.full
@pytest.mark.parametrize("make", first(1, [stepper, servo]))
@settings(max_examples=10)
@given(at=st.integers(5, 200), before=MOVED, after=MOVED, back=st.booleans(), reaction=REACTIONS)
def test_a_program_that_ends_in_manual_mode_leaves_its_axis_to_the_operator_and_then_at_rest(
    make: Any, at: int, before: Any, after: Any, back: bool, reaction: str
) -> None:
    with cell(make, reaction) as (ann, _):
        m: Any = ann.m
        watch = Watch(ann)
        task = m.cycle.start(m.program([("move", position) for position in (43.5, 38.0, 42.0, 40.0)]))
        ann.run(at)
        ann.mode("manual")
        for pause, deed in before:
            obey(ann, deed)
            ann.run(pause)
        there = m.x.state, m.x.profile.setpoint
        task.cancel()
        if there[0] in (AxisState.DISCRETE_MOTION, AxisState.CONTINUOUS_MOTION, AxisState.HOMING):
            assert (m.x.state, m.x.profile.setpoint) == there
        for pause, deed in after:
            obey(ann, deed)
            ann.run(pause)
        if back:
            ann.mode("automatic")
        ann.do("give back")
        ann.run(1500)
        assert m.x.state in (AxisState.DISABLED, AxisState.STANDSTILL)
        if m.x.enabled:
            here = m.x.profile.setpoint
            ann.run(100)
            assert m.x.profile.setpoint == here
        watch.assert_smooth(*LIMITS[make])
