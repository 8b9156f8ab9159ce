"""Manual mode, and the end of a lease in it: nothing stays driven with nobody in charge, and the way back."""

from __future__ import annotations

import gc
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import pytest

from helpers.machines import relay, switch, timer
from helpers.operator import Operator
from umo import (
    BinaryActuator,
    BinarySensor,
    Compound,
    DigitalActuator,
    DigitalSensor,
    Interlock,
    TaskFailed,
    Vector,
    action,
    connect,
)
from umo.control import next_period, state_of, wait
from umo.cycle.columns import FREE
from umo.cycle.events import CommandState
from umo.errors import DeclarationError, DriverError
from umo.objects import atoms, described
from umo.operation.commands.client_commands import ClientCommand, Mode
from umo.states import OnOff, PassFail
from umo.testing import Scripted, VirtualTimer, put

PERIOD = 0.01


def spindle(**changes: Any) -> DigitalActuator:
    return DigitalActuator("rpm", default=0.0, minimum=0.0, maximum=500.0, resolution=1.0, **changes)


class Winder(Compound):
    """A spindle that a sequence starts, a clamp that holds the reel, a fan."""

    spindle: DigitalActuator
    clamp: BinaryActuator[OnOff]
    fan: BinaryActuator[OnOff]
    door: BinarySensor[PassFail]
    timer: DigitalSensor

    def setup(self) -> None:
        self.wound: list[float] = []
        self.speed: float | None = None  # of the law, if it runs the spindle
        self.said: list[str] = []

    def interlocks(self) -> Iterator[Interlock]:
        yield Interlock(lambda: state_of(self.door) is PassFail.FAIL, [self.spindle], "the door is open")

    def control(self) -> None:
        if self.speed is not None:
            self.spindle.write(self.speed)

    async def wind(self) -> None:
        """Wind for 20 periods."""
        self.clamp.write(OnOff.ON)
        self.spindle.write(240.0)
        try:
            for _ in range(20):
                await next_period()
                self.wound.append(self.spindle.read())
        finally:
            self.spindle.write(0.0)
            self.clamp.write(OnOff.OFF)

    @action
    def blow(self) -> None:
        """Leave the fan on."""
        self.fan.write(OnOff.ON)

    @action
    def grip(self) -> None:
        """Leave the clamp closed."""
        self.clamp.write(OnOff.ON)

    @action
    async def blow_in_sequence(self) -> None:
        """Leave a sequence that keeps the fan on."""
        self.cycle.start(self._blow())

    async def _blow(self) -> None:
        while True:
            self.fan.write(OnOff.ON)
            await next_period()


def winder(kind: type[Winder] = Winder, **parts: Any) -> Winder:
    of_machine: dict[str, Any] = {
        "spindle": spindle(), "clamp": relay(when_suspended="hold"), "fan": relay(), "door": switch(),
    }  # fmt: skip
    return kind(timer=timer(), **of_machine | parts)


class Box(Scripted):
    """A circuit of which channels may fail."""

    def __init__(self) -> None:
        super().__init__()
        self.failing: set[str] = set()

    def write(self, channel: Any, raw: int) -> None:
        if channel.text in self.failing:
            raise DriverError("gone")
        super().write(channel, raw)

    def reset(self, channel: Any, default: int | None) -> None:
        if channel.text in self.failing:
            raise DriverError("gone")
        super().reset(channel, default)


@contextmanager
def operated(machine: Any, mode: Mode = Mode.AUTOMATIC, box: Scripted | None = None) -> Iterator[Operator]:
    """It runs on scripted channels, and an operator has the lease."""
    wire: dict[str, Any] = {item.path: {"driver": "box"} for item in atoms(machine)}
    wire["timer"] = {"driver": "clock", "period": PERIOD}
    with connect(machine, {"drivers": {"box": box or Scripted(), "clock": VirtualTimer()}, "wire": wire}):
        operator = Operator(machine, mode)
        operator.do("lease", seconds=60.0)
        yield operator


# Actuators ------------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("each_way")
@pytest.mark.parametrize("synchronous", [True, False])
def test_what_a_suspended_sequence_has_started_stops_and_goes_on_when_the_sequence_does(synchronous: bool) -> None:
    m = winder(spindle=spindle(synchronous=synchronous))
    with operated(m) as ann:
        m.cycle.start(m.wind())
        ann.run(5)
        assert m.spindle.read() == 240.0
        ann.mode("manual")
        assert (m.spindle.read(), m.clamp.read()) == (0.0, OnOff.ON)
        assert ann.notes[-1] == "manual mode: to the default: spindle; held: clamp"
        assert ann.driven == "clamp ON (held, or its law)"
        ann.run(100)
        assert m.spindle.read() == 0.0
        assert ann.mode("automatic").state is CommandState.DONE
        assert (m.spindle.read(), ann.driven) == (240.0, "")
        ann.run(30)
        assert m.wound == [240.0] * 20
        assert (m.spindle.read(), m.clamp.read()) == (0.0, OnOff.OFF)


def test_what_a_law_writes_in_each_period_is_in_its_charge_and_said() -> None:
    m = winder()
    with operated(m) as ann:
        m.speed = 240.0
        ann.run(3)
        ann.mode("manual")
        ann.run(10)
        assert m.spindle.read() == 240.0
        assert ann.notes[-1] == "manual mode: its law writes: spindle"
        assert ann.driven == "spindle 240 rpm (its law or an action)"
        ann.do("give back")
        ann.run(10)
        assert ann.driven == "spindle 240 rpm (its law)"
        m.speed = None  # the law's own end
        m.spindle.write(0.0)


def test_a_vector_that_a_law_writes_is_in_its_charge() -> None:
    class Fans(Compound):
        timer: DigitalSensor
        fans: Sequence[BinaryActuator[OnOff]]

        def setup(self) -> None:
            self.vector = Vector(self.fans)

        def control(self) -> None:
            self.vector.write(OnOff.ON)

    m = Fans(timer=timer(), fans=[relay() for _ in range(5)])
    with operated(m) as ann:
        ann.run(2)
        ann.mode("manual")
        ann.run(2)
        assert {fan.read() for fan in m.fans} == {OnOff.ON}
        assert ann.driven.startswith("fans.0 ON (its law or an action), ") and ann.driven.endswith(" and 2 others")


def test_an_actuator_that_a_law_has_written_before_is_in_nobodys_charge() -> None:
    class Once(Winder):
        def control(self) -> None:
            if self.now < 3.5 * PERIOD:
                self.fan.write(OnOff.ON)

    m = winder(Once)
    with operated(m) as ann:
        ann.run(5)
        assert m.fan.read() is OnOff.ON
        ann.mode("manual")
        assert m.fan.read() is OnOff.OFF


def test_a_write_costs_no_more_after_the_period_of_the_change() -> None:
    m = winder()
    with operated(m) as ann:
        ann.mode("manual")
        assert set(ann.machine.image.restrictions) == {FREE}
        assert ann.machine.image.commands is ann.machine.commands


def test_an_actuator_in_a_client_stays_so() -> None:
    m = winder()
    with operated(m, Mode.MANUAL) as ann:
        ann.do("write", "fan", "ON")
        ann.clients.suspension.lease_ended()
        ann.run(2)
        assert (m.fan.read(), ann.driven) == (OnOff.ON, "fan ON (client ann)")


def test_an_actuator_that_does_not_take_its_default_gets_it_again() -> None:
    box = Box()
    m = winder(spindle=spindle(synchronous=False))
    with operated(m, box=box) as ann:
        m.cycle.start(m.wind())
        ann.run(3)
        box.failing.add("spindle")
        ann.mode("manual")
        assert (m.spindle.pending, m.spindle.read()) == (0.0, 240.0)
        box.failing.clear()
        ann.run()
        assert m.spindle.read() == 0.0


# Declarations ---------------------------------------------------------------------------------------------


def test_the_nearest_declaration_counts() -> None:
    class Head(Compound):
        valve: BinaryActuator[OnOff]
        pump: BinaryActuator[OnOff]

    class Holding(Head, when_suspended="hold"): ...

    class RunningOn(Holding, when_suspended="run on"): ...

    class Machine(Compound, when_suspended="hold"):
        plain: Head
        holding: Holding
        running: RunningOn
        own: BinaryActuator[OnOff]
        timer: DigitalSensor

    def head(kind: type[Head]) -> Any:
        return kind(valve=relay(), pump=relay(when_suspended="default"))

    m = Machine(plain=head(Head), holding=head(Holding), running=head(RunningOn), own=relay(), timer=timer())
    assert {each.when_suspended for each in (m.plain.valve, m.holding.valve, m.running.valve, m.own)} == {"hold"}
    assert {each.pump.when_suspended for each in (m.plain, m.holding, m.running)} == {"default"}
    assert (relay().when_suspended, head(Head).valve.when_suspended) == ("default", "default")
    assert "held when suspended" in m.own.describe() and "held when suspended" not in m.plain.pump.describe()
    assert described(m.own).is_held


def test_a_reaction_that_there_is_not_is_refused() -> None:
    with pytest.raises(DeclarationError, match="when_suspended='run on' is neither"):
        relay(when_suspended="run on")
    with pytest.raises(DeclarationError, match='class Press: when_suspended is "default", "hold" or "run on", not'):
        type("Press", (Compound,), {}, when_suspended="held")
    with pytest.raises(DeclarationError, match="did you mean 'when_suspended'"):
        type("Press", (Compound,), {}, when_suspend="hold")
    with pytest.raises(DeclarationError, match="give `when_suspended` as a class keyword"):
        type("Press", (Compound,), {"when_suspended": "hold"})


def test_hooks_of_the_other_kind_are_refused() -> None:
    async def sequence(self: object) -> None: ...

    def function(self: object) -> None: ...

    with pytest.raises(DeclarationError, match="on_suspend is a sequence; it must act at once"):
        type("Press", (Compound,), {"on_suspend": sequence})
    with pytest.raises(DeclarationError, match="on_resume must be a sequence"):
        type("Press", (Compound,), {"on_resume": function})


# Leases ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("end", ["give back", "expire"])
def test_what_an_action_has_left_driven_goes_to_its_reaction_when_the_lease_ends(end: str) -> None:
    m = winder()
    with operated(m, Mode.MANUAL) as ann:
        for action_ in ("blow", "grip"):
            ann.call(action_)
        ann.run(10)
        assert (m.fan.read(), m.clamp.read()) == (OnOff.ON, OnOff.ON)  # its holder is in charge
        if end == "expire":
            ann.alive = False
            ann.run(round(61.0 / PERIOD))
        else:
            ann.do("give back")
        assert (m.fan.read(), m.clamp.read()) == (OnOff.OFF, OnOff.ON)
        assert ann.notes[-1] == "the lease has ended: to the default: fan; held: clamp"
        assert ann.driven == "clamp ON (held, or its law)"


def test_a_sequence_that_an_action_has_started_ends_with_the_action_and_leaves_nothing_driven() -> None:
    m = winder()
    with operated(m, Mode.MANUAL) as ann:
        ann.call("blow_in_sequence")
        ann.run(10)
        assert m.fan.read() is OnOff.ON
        ann.do("give back")
        ann.run(3)
        assert m.fan.read() is OnOff.OFF
        assert not ann.machine.sequences.running


def test_a_lease_that_is_taken_over_leaves_somebody_in_charge() -> None:
    m = winder()
    with operated(m, Mode.MANUAL) as ann:
        ann.call("blow")
        ann.letters.waiting.append(ClientCommand(99, "bob", "other key", "lease", over=True))
        ann.run(3)
        assert ann.clients.lease.holder == "bob"
        assert m.fan.read() is OnOff.ON


def test_what_actions_have_left_goes_to_its_default_before_an_application_that_has_not_begun() -> None:
    m = winder()

    async def application() -> None:
        m.spindle.write(100.0)
        await wait(1.0)

    with operated(m, Mode.MANUAL) as ann:
        m.cycle.start(application())
        ann.call("blow")
        ann.call("grip")
        ann.mode("automatic")
        ann.run(2)
        assert (m.fan.read(), m.clamp.read(), m.spindle.read()) == (OnOff.OFF, OnOff.ON, 100.0)


# Back to automatic ----------------------------------------------------------------------------------------


def test_what_actions_have_changed_is_as_the_application_left_it() -> None:
    m = winder()
    with operated(m) as ann:
        m.cycle.start(m.wind())
        ann.run(5)
        ann.mode("manual")
        ann.call("blow")
        ann.do("write", "clamp", "OFF")
        ann.run(5)
        ann.mode("automatic")
        assert (m.fan.read(), m.clamp.read(), m.spindle.read()) == (OnOff.OFF, OnOff.ON, 240.0)


def test_what_an_action_writes_in_the_period_of_the_change_is_not_taken_for_a_laws() -> None:
    m = winder()
    with operated(m) as ann:
        m.cycle.start(m.wind())
        ann.run(5)
        ann.send("mode", value="manual")
        ann.send("call", "blow")
        ann.run(3)
        assert m.fan.read() is OnOff.ON  # its caller is in charge
        assert ann.notes[-1] == "manual mode: to the default: spindle; held: clamp; just written: fan"
        ann.mode("automatic")
        assert m.fan.read() is OnOff.OFF


def test_an_application_does_not_go_on_while_an_actuator_that_it_needs_is_inhibited() -> None:
    m = winder()
    with operated(m) as ann:
        m.cycle.start(m.wind())
        ann.run(5)
        ann.mode("manual")
        put(m.door, PassFail.FAIL)
        ann.run(2)
        refused = ann.mode("automatic")
        assert refused.state is CommandState.REFUSED
        assert refused.text == (
            "CommandRefused: the application cannot continue: spindle is inhibited: the door is open; remove the cause "
            "in manual mode, or stop the run"
        )
        assert (ann.clients.mode, m.spindle.read(), m.clamp.read()) == (Mode.MANUAL, 0.0, OnOff.ON)
        put(m.door, PassFail.PASS)
        ann.run(2)
        assert ann.mode("automatic").state is CommandState.DONE
        assert m.spindle.read() == 240.0


def test_what_a_law_runs_is_not_restored_and_keeps_nobody_from_going_on() -> None:
    m = winder()
    with operated(m) as ann:
        m.speed = 240.0
        ann.run(3)
        ann.mode("manual")
        put(m.door, PassFail.FAIL)
        ann.run(2)
        assert m.spindle.read() == 0.0
        assert ann.mode("automatic").state is CommandState.DONE


def test_a_value_that_its_device_refuses_leads_back_to_manual_mode() -> None:
    box = Box()
    m = winder(spindle=spindle(synchronous=False))
    with operated(m, box=box) as ann:
        m.cycle.start(m.wind())
        ann.run(5)
        ann.mode("manual")
        box.failing.add("spindle")
        assert ann.mode("automatic").state is CommandState.FAILED
        box.failing.clear()
        ann.run(3)
        assert (ann.clients.mode, m.spindle.read()) == (Mode.MANUAL, 0.0)
        assert ann.mode("automatic").state is CommandState.DONE
        assert m.spindle.read() == 240.0


def test_modes_that_change_back_and_forth_in_following_periods_leave_all_as_it_was() -> None:
    m = winder()
    with operated(m) as ann:
        m.cycle.start(m.wind())
        ann.run(5)
        for count in (2, 3):
            for number in range(count):
                ann.send("mode", value="automatic" if number % 2 else "manual")
            ann.run(2 * count)  # one in a period; what was restored is sent before the application goes on
            assert m.spindle.read() == (240.0 if count == 2 else 0.0)
            assert set(ann.machine.image.restrictions) == {FREE}
        ann.mode("automatic")
        ann.run(30)
        assert m.wound == [240.0] * 20
        assert len(ann.machine.groups.whole.laws) == 1


# Hooks ----------------------------------------------------------------------------------------------------


class Told(Winder):
    """It slows the spindle down, and runs it up again."""

    broken = ""

    def on_suspend(self) -> None:
        self.said.append("suspended")
        if self.broken == "on_suspend":
            raise TaskFailed("no way to hold")
        self.spindle.write(30.0)

    async def on_resume(self) -> None:
        assert self.spindle.pending == 240.0
        self.said.append("resumed")
        self.cycle.start(self._beside())
        await wait(5 * PERIOD)
        if self.broken == "on_resume":
            raise TaskFailed("too slow")

    async def _beside(self) -> None:
        await wait(8 * PERIOD)
        self.said.append("beside")


def test_what_on_suspend_writes_stays_and_on_resume_comes_before_the_application() -> None:
    m = winder(Told)
    with operated(m) as ann:
        m.cycle.start(m.wind())
        ann.run(5)
        ann.mode("manual")
        ann.run(5)
        assert m.spindle.read() == 30.0
        before = len(m.wound)
        assert ann.mode("automatic").state is CommandState.BEGUN
        ann.run(6)
        assert (len(m.wound), m.said) == (before, ["suspended", "resumed"])
        ann.run(4)
        assert len(m.wound) > before
        assert m.said == ["suspended", "resumed", "beside"]
        assert set(m.wound) == {240.0}


def test_an_on_suspend_that_fails_is_told_and_its_actuators_go_to_their_defaults() -> None:
    m = winder(Told)
    m.broken = "on_suspend"
    with operated(m) as ann:
        m.cycle.start(m.wind())
        ann.run(5)
        ann.mode("manual")
        ann.run()
        assert (m.spindle.read(), m.clamp.read()) == (0.0, OnOff.OFF)  # held or not
        assert [(event.path, event.text) for event in ann.events if "no way to hold" in event.text] == [
            ("on_suspend", "failed: TaskFailed: no way to hold")
        ]


def test_an_on_resume_that_fails_leads_back_to_manual_mode() -> None:
    m = winder(Told)
    m.broken = "on_resume"
    with operated(m) as ann:
        m.cycle.start(m.wind())
        ann.run(5)
        ann.mode("manual")
        ann.mode("automatic")
        ann.run(10)
        assert ann.clients.mode is Mode.MANUAL
        assert "back to manual mode: on_resume failed: TaskFailed: too slow" in ann.notes
        assert m.said == ["suspended", "resumed", "suspended"]
        assert m.spindle.read() == 30.0
        m.broken = ""
        ann.mode("automatic")
        ann.run(40)
        assert set(m.wound) == {240.0} and len(m.wound) == 20


def test_a_change_to_manual_mode_cancels_what_runs_before_the_application() -> None:
    m = winder(Told)
    with operated(m) as ann:
        m.cycle.start(m.wind())
        ann.run(5)
        ann.mode("manual")
        ann.mode("automatic")
        ann.mode("manual")
        before = len(m.wound)
        ann.run(30)
        assert (len(m.wound), ann.clients.mode) == (before, Mode.MANUAL)
        assert m.said == ["suspended", "resumed", "suspended"]


@pytest.mark.parametrize(
    ("end", "state", "text"),
    [
        ("", CommandState.DONE, ""),
        ("on_resume", CommandState.FAILED, "back to manual mode: on_resume failed: TaskFailed: too slow"),
        ("manual", CommandState.CANCELLED, "the mode has changed to manual"),
        ("give back", CommandState.DONE, ""),
        ("stop", CommandState.CANCELLED, "the machine stops"),
    ],
)
def test_a_change_to_automatic_mode_is_answered_when_its_hooks_have_ended(
    end: str, state: CommandState, text: str, caplog: pytest.LogCaptureFixture
) -> None:
    m = winder(Told)
    m.broken = end
    with operated(m) as ann:
        m.cycle.start(m.wind())
        ann.run(5)
        ann.mode("manual")
        begun = ann.mode("automatic")
        assert (begun.state, ann.clients.mode) == (CommandState.BEGUN, Mode.AUTOMATIC)
        ann.run(2)
        if end == "manual":
            ann.mode("manual")
        elif end == "give back":
            ann.do("give back")
        elif end == "stop":
            ann.clients.cancel()
        else:
            ann.run(10)
        ann.run(10)
        told = [(event.state, event.text) for event in ann.events if event.command == begun.command]
        assert told == [(CommandState.BEGUN, ""), (state, text)]
        assert [each.getMessage() for each in caplog.records] == ([text] if state is CommandState.FAILED else [])


def test_a_second_change_to_automatic_mode_is_refused_until_the_first_has_ended() -> None:
    with operated(winder(Told)) as ann:
        ann.m.cycle.start(ann.m.wind())
        ann.run(5)
        ann.mode("manual")
        begun = ann.mode("automatic")
        again = ann.mode("automatic")
        assert again.state is CommandState.REFUSED
        assert again.text == "CommandRefused: the change to automatic mode has not ended yet"
        ann.run(20)
        assert [each.state for each in ann.events if each.command == begun.command][-1] is CommandState.DONE
        assert ann.mode("automatic").state is CommandState.DONE


def test_a_change_to_automatic_mode_without_hooks_is_answered_at_once() -> None:
    with operated(winder()) as ann:
        ann.m.cycle.start(ann.m.wind())
        ann.run(5)
        ann.mode("manual")
        assert ann.mode("automatic").state is CommandState.DONE


def test_a_parent_is_told_before_its_parts() -> None:
    order: list[str] = []

    class Part(Compound):
        valve: BinaryActuator[OnOff]

        def on_suspend(self) -> None:
            order.append(self.valve.path)

    class Whole(Compound):
        part: Part
        timer: DigitalSensor

        def on_suspend(self) -> None:
            order.append("whole")

    m = Whole(part=Part(valve=relay()), timer=timer())
    with operated(m) as ann:
        ann.mode("manual")
        ann.do("give back")
        assert order == ["whole", "part.valve"]


def test_a_machine_that_stops_while_it_resumes_cleans_up() -> None:
    m = winder(Told)
    with operated(m) as ann:
        m.cycle.start(m.wind())
        ann.run(5)
        ann.mode("manual")
        ann.mode("automatic")
        resuming = ann.clients.suspension.resuming
        assert resuming is not None and resuming.running
    assert not resuming.running


@pytest.mark.parametrize("broken", ["", "on_suspend", "on_resume"])
def test_changes_of_the_mode_leave_nothing_that_only_the_collector_would_free(broken: str) -> None:
    m = winder(Told)
    m.broken = broken

    async def forever() -> None:
        m.spindle.write(240.0)
        while True:
            await next_period()

    with operated(m) as ann:
        m.cycle.start(forever())
        for count in (3, 10):
            gc.collect()
            gc.disable()
            try:
                for _ in range(count):
                    ann.mode("manual")
                    ann.run(3)
                    ann.mode("automatic")
                    ann.run(10)
                left = gc.collect()
            finally:
                gc.enable()
        assert left == 0
