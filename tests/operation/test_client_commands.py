"""ClientControl, in virtual time: the lease, the modes, and every guard for client and program alike."""

from __future__ import annotations

import dataclasses
import gc
import json
import signal
import weakref
from collections.abc import Iterator
from typing import Annotated, Any, Literal, Self

import pytest
from hypothesis import given
from hypothesis import strategies as st

from helpers.letters import Letters
from helpers.machines import actuator, relay, sensor, switch, timer
from helpers.tiers import budget
from umo import (
    BinaryActuator,
    BinarySensor,
    Compound,
    DigitalActuator,
    DigitalSensor,
    Interlock,
    Number,
    Range,
    TaskFailed,
    action,
    connect,
)
from umo.control import next_period, state_of, wait
from umo.cycle.columns import ASKED, FREE, TAKEN_BY_CLIENT
from umo.cycle.events import EVENT_TEXT_BYTES, CommandState, Event
from umo.errors import DeclarationError
from umo.objects import actions_of, find
from umo.objects.linearization import Linearization
from umo.operation.commands.client_commands import DEAD_MAN_TIME, ClientCommand, Mode
from umo.operation.commands.client_control import COMMANDS_PER_PERIOD, ClientControl
from umo.states import OnOff, PassFail
from umo.testing import Scripted, VirtualTimer, put

PERIOD = 0.01


class Press(Compound):
    """The door inhibits ram and lamp; the program writes the ram and the heater in every period."""

    timer: DigitalSensor
    door: BinarySensor[PassFail]
    height: DigitalSensor
    ram: DigitalActuator
    lamp: BinaryActuator[OnOff]
    heater: DigitalActuator
    speed: Annotated[float, Number("mm/s", 0.5, 5.0, tunable=True)] = 2.0

    def setup(self) -> None:
        self.wanted = 1.0
        self.jogging = 0.0
        self.closed = 0
        self.cleaned = 0

    def interlocks(self) -> Iterator[Interlock]:
        yield Interlock(lambda: state_of(self.door) is PassFail.FAIL, [self.ram, self.lamp], "the door is open")

    def control(self) -> None:
        self.taken = self.ram.write(self.wanted)

    @action(force=Range("kN", 0.0, 80.0))
    async def close(self, force: float, how: Literal["soft", "hard"] = "soft") -> dict[str, Any]:
        """Close the press."""
        try:
            await wait(5 * PERIOD)
        finally:
            self.cleaned += 1
        self.closed += 1
        return {"force": force, "how": how}

    @action(velocity=Range("mm/s", -5.0, 5.0), release="halt")
    def jog(self, velocity: float) -> None:
        """Move as long as it is held."""
        self.jogging = velocity

    def halt(self) -> None:
        self.jogging = 0.0

    @action(harmless=True)
    def count(self) -> int:
        """How often it has closed."""
        return self.closed

    @action
    async def fail(self) -> None:
        """Fail after a period."""
        await next_period()
        raise TaskFailed("the press is stuck")

    @action
    def begin(self) -> None:
        """Close it in a sequence that nobody awaits."""
        self.cycle.start(self.close(1.0))

    @action
    async def start_another(self) -> None:
        """Close it in a sequence of its own."""
        await self.cycle.start(self.close(1.0))


BOOT = 1000.0
"""The clock of the heartbeats when the cycle's clock is 0, s."""


class Rig:
    """A connected press with clients."""

    def __init__(
        self, mode: Mode = Mode.MANUAL, kind: type[Press] = Press, period: float = PERIOD, **changes: Any
    ) -> None:
        parts: dict[str, Any] = {"ram": actuator(), "lamp": relay(), "heater": actuator()} | changes
        self.m = kind(timer=timer(), door=switch(), height=sensor(), **parts)
        names = ("door", "height", "ram", "lamp", "heater")
        wiring = {
            "drivers": {"box": Scripted(), "clock": VirtualTimer()},
            "wire": {"timer": {"driver": "clock", "period": period}, **{name: {"driver": "box"} for name in names}},
        }
        self.connection = connect(self.m, wiring)
        self.letters = Letters()
        self.mode = mode
        self.number = 0
        self.leases: dict[str, int] = {}
        """The number of the last lease of each client, by its key."""

    def __enter__(self) -> Rig:
        self.connection.__enter__()
        machine = self.connection.machine
        self.clients = machine.attach(ClientControl(self.letters, self.letters, self.mode, lambda: self.now))
        return self

    @property
    def now(self) -> float:
        """The clock of the heartbeats, s."""
        return BOOT + float(self.connection.machine.clock.now)

    def __exit__(self, *error: Any) -> None:
        self.connection.__exit__(*error)

    def send(self, do: str, path: str = "", value: Any = None, key: str = "a", **more: Any) -> int:
        self.number += 1
        arguments = more.pop("arguments", {})
        self.letters.waiting.append(
            ClientCommand(self.number, f"client {key}", key, do, path, value, arguments, **more)
        )
        return self.number

    def do(self, do: str, path: str = "", value: Any = None, key: str = "a", **more: Any) -> Event:
        """Send it with a heartbeat, and let a period pass; its first event."""
        self.sign(path, key=key)
        number = self.send(do, path, value, key, **more)
        self.periods()
        event = next((event for event in self.events if event.command == number), Event(0.0, "", "no event"))
        if (do, event.state) == ("lease", CommandState.DONE):
            self.leases[key] = int(event.text)
        return event

    def sign(self, *paths: str, key: str = "a") -> None:
        """A client is there, for its lease and for these paths."""
        if key in self.leases and self.leases[key] == self.clients.lease.number:
            self.letters.signs |= dict.fromkeys(("", *paths), (self.leases[key], self.now))

    def keep(self, *paths: str, key: str = "a") -> None:
        """The same, and a period passes."""
        self.sign(*paths, key=key)
        self.periods()

    def call(self, path: str, key: str = "a", **arguments: Any) -> Event:
        return self.do("call", path, key=key, arguments=arguments)

    def periods(self, count: int = 1) -> None:
        for _ in range(count):
            self.m.timer.read()
            self.m.sample()
            self.m.control()
            self.m.update()

    @property
    def events(self) -> list[Event]:
        return list(self.connection.machine.events)

    def last(self) -> tuple[CommandState, str]:
        return self.events[-1].state, self.events[-1].text


@pytest.fixture
def rig() -> Iterator[Rig]:
    with Rig() as rig:
        rig.do("lease")
        yield rig


# The lease ----------------------------------------------------------------------------------------------


def test_only_the_holder_of_the_lease_commands() -> None:
    with Rig() as rig:
        refused = rig.do("tune", "speed", 3.0)
        assert (refused.state, refused.text) == (
            CommandState.REFUSED,
            "CommandRefused: nobody has the lease; take it first",
        )
        assert rig.do("lease").state is CommandState.DONE
        assert rig.do("tune", "speed", 3.0, key="b").text == "LeaseHeld: client a has the lease"
        assert rig.m.speed == 2.0
        assert rig.do("tune", "speed", 3.0).text == '"2 -> 3"'
        assert rig.m.speed == 3.0


def test_a_second_client_gets_the_lease_only_by_taking_it_over(rig: Rig) -> None:
    assert "client a has the lease" in rig.do("lease", key="b").text
    assert rig.clients.lease.holder == "client a"
    assert rig.do("lease", key="b", over=True).state is CommandState.DONE
    assert rig.clients.lease.holder == "client b"
    assert rig.do("tune", "speed", 3.0).state is CommandState.REFUSED


def test_the_event_of_a_take_over_differs_from_that_of_a_lease_that_was_free(rig: Rig) -> None:
    assert rig.do("lease").asked == "lease"
    assert rig.do("lease", key="b", over=True).asked == "lease over=True"


def test_a_lease_that_is_not_renewed_ends_with_all_that_its_holder_had_begun(rig: Rig) -> None:
    rig.do("lease", seconds=1.0)
    rig.do("write", "heater", 5.0)
    begun = rig.call("close", force=3.0)
    assert begun.state is CommandState.BEGUN
    for _ in range(3):
        rig.keep("heater")
    rig.periods(102)
    assert rig.clients.lease.holder == ""
    assert rig.m.heater.read() == rig.m.heater.default
    assert any("was not renewed" in event.text for event in rig.events)


def test_what_runs_is_cancelled_when_the_lease_is_given_back_or_taken_over(rig: Rig) -> None:
    for end in ({"do": "give back"}, {"do": "lease", "key": "b", "over": True}):
        number = rig.call("close", force=3.0).command
        assert rig.m.cleaned == rig.m.closed
        rig.do(**end)  # type: ignore[arg-type]
        assert rig.m.cleaned == 1 + rig.m.closed
        assert [event.state for event in rig.events if event.command == number][-1] is CommandState.CANCELLED
        rig.m.closed += 1
        rig.do("lease", over=True)


# Modes --------------------------------------------------------------------------------------------------


def test_a_tuned_integer_keeps_all_of_its_digits() -> None:
    class Counting(Press):
        strokes: Annotated[int, Number("", 0, 2**70, tunable=True)] = 2**60 + 1

    with Rig(kind=Counting) as rig:
        assert rig.do("lease").state is CommandState.DONE
        assert rig.do("tune", "strokes", 2**61 + 1).text == f'"{2**60 + 1} -> {2**61 + 1}"'
        assert rig.do("tune", "strokes", 2.5).text == "RangeError: strokes: 2.5 is not a whole number"
        assert vars(rig.m)["strokes"] == 2**61 + 1


def test_in_automatic_mode_numbers_are_tuned_and_harmless_actions_called_and_nothing_else() -> None:
    with Rig(Mode.AUTOMATIC) as rig:
        rig.do("lease")
        assert rig.do("tune", "speed", 3.0).state is CommandState.DONE
        assert rig.call("count").state is CommandState.DONE
        refused = (
            "in manual mode only; the machine runs in automatic mode (change it: `umo do STATION mode manual`, "
            'in Python `station.mode = "manual"`)'
        )
        assert rig.call("close", force=1.0).text == f"CommandRefused: close can be called {refused}"
        assert refused in rig.do("write", "lamp", "ON").text
        assert rig.m.lamp.read() is OnOff.OFF


def test_in_manual_mode_no_time_passes_for_the_application() -> None:
    ticks = []

    async def application() -> None:
        while True:
            ticks.append((await next_period()).ticks)

    with Rig(Mode.AUTOMATIC) as rig:
        rig.m.cycle.start(application())
        rig.do("lease")
        rig.periods(3)
        rig.do("mode", value="manual")
        before = len(ticks)
        rig.periods(10)
        rig.keep()
        assert len(ticks) == before
        assert rig.m.taken  # the laws go on
        rig.do("mode", value="automatic")
        assert len(ticks) == before + 1
    assert "there is no mode 'fast'" in _refused(Mode.AUTOMATIC, "mode", value="fast")


def _refused(mode: Mode, do: str, path: str = "", **more: Any) -> str:
    with Rig(mode) as rig:
        rig.do("lease")
        event = rig.do(do, path, **more)
        assert event.state is CommandState.REFUSED
        return event.text


# Actuators ----------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("each_way")
@pytest.mark.parametrize("synchronous", [True, False])
def test_an_actuator_in_a_client_refuses_the_program_and_is_given_back_at_its_default(synchronous: bool) -> None:
    with Rig(ram=actuator(synchronous=synchronous)) as rig:
        rig.do("lease")
        rig.periods()
        assert rig.m.ram.read() == 1.0
        rig.do("write", "ram", 4.0)
        rig.periods(2)
        assert (rig.m.ram.read(), rig.m.taken, rig.m.ram.inhibited) == (4.0, False, "taken by client: client a")
        rig.m.wanted = 0.0
        rig.do("let go", "ram")
        rig.periods()
        assert rig.m.ram.read() == rig.m.ram.default
        rig.m.wanted = 2.0
        rig.periods(2)
        assert (rig.m.ram.read(), rig.m.taken, rig.m.ram.inhibited) == (2.0, True, None)


def test_what_a_client_holds_without_a_heartbeat_goes_to_its_default(rig: Rig) -> None:
    rig.do("write", "heater", 5.0)
    for _ in range(5):
        rig.periods(40)
        rig.keep("heater")
    assert rig.m.heater.read() == 5.0
    for _ in range(3):
        rig.periods(20)
        rig.keep()
    assert rig.m.heater.read() == rig.m.heater.default
    assert rig.last() == (CommandState.CANCELLED, "dead-man timeout")


class Breaking(Linearization):
    """A curve that fails between 5 and 10 V."""

    def over(self, minimum: float, maximum: float) -> Self:
        return self

    def to_value(self, x: float) -> float:
        return x

    def to_input(self, value: float) -> float:
        if 5.0 < value < 10.0:
            raise ValueError("off the curve")
        return value


@pytest.mark.usefixtures("each_way")
@pytest.mark.parametrize("held", [False, True])
def test_an_actuator_that_a_client_could_not_write_is_free_at_once(held: bool) -> None:
    with Rig(ram=actuator(linearization=Breaking())) as rig:
        rig.do("lease")
        if held:
            assert rig.do("write", "ram", 4.0).state is CommandState.DONE
        failed = rig.do("write", "ram", 6.0)
        assert (failed.state, "off the curve" in failed.text) == (CommandState.FAILED, True)
        assert rig.m.ram.inhibited is None
        rig.periods(2)
        assert (rig.m.ram.read(), rig.m.taken) == (1.0, True)
        rig.periods(100)  # the end of what was held is told at once, and nothing later
        ended = [
            (event.asked, event.time <= failed.time) for event in rig.events if event.state is CommandState.CANCELLED
        ]
        assert ended == ([("write ram 4.0", True)] if held else [])


def test_an_actuator_that_expires_sooner_ends_sooner_in_a_client_too() -> None:
    with Rig(heater=actuator(expires="50 ms")) as rig:
        rig.do("lease")
        rig.do("write", "heater", 5.0)
        rig.periods(4)
        assert rig.m.heater.read() == 5.0
        rig.periods(3)
        assert rig.m.heater.read() == rig.m.heater.default


def test_an_interlock_takes_the_actuator_out_of_the_client(rig: Rig) -> None:
    rig.do("write", "lamp", "ON")
    assert rig.m.lamp.read() is OnOff.ON
    put(rig.m.door, PassFail.FAIL)
    rig.periods()
    assert rig.m.lamp.read() is OnOff.OFF
    assert rig.last() == (CommandState.CANCELLED, "the door is open")
    assert "lamp is inhibited: the door is open" in rig.do("write", "lamp", "ON").text
    put(rig.m.door, PassFail.PASS)
    for _ in range(3):
        rig.keep("lamp")
    assert rig.m.lamp.read() is OnOff.OFF
    assert rig.do("write", "lamp", "ON").state is CommandState.DONE
    rig.periods()
    assert rig.m.lamp.read() is OnOff.ON


@pytest.mark.parametrize("period", [PERIOD, 0.4, 1.0, 6.0])
@pytest.mark.parametrize("what", ["heater", "jog"])
@given(st.floats(0.0, 3.0))
@budget(6, 20)
def test_what_a_dead_client_held_ends_after_its_time_and_a_period_however_long_that_is(
    what: str, period: float, lived: float
) -> None:
    """It wrote, lived on for so many periods, sending heartbeats, and died. The machine looks once a period; the
    signs come at any time."""
    with Rig(period=period) as rig:
        rig.do("lease", seconds=2.0)
        begun = rig.now
        died = begun + lived * period
        send = {"do": "write", "value": 5.0} if what == "heater" else {"do": "call", "arguments": {"velocity": 2.0}}
        rig.letters.signs = dict.fromkeys(("", what), (1, min(died, begun + period)))
        rig.send(path=what, **send)
        while rig.now < died + DEAD_MAN_TIME + period:
            rig.letters.signs = dict.fromkeys(("", what), (1, min(died, rig.now + period)))
            rig.periods()
            held = rig.m.heater.read() == 5.0 if what == "heater" else rig.m.jogging == 2.0
            if rig.now <= died:
                assert held
        assert rig.m.heater.read() == rig.m.heater.default
        assert rig.m.jogging == 0.0
        while rig.now < died + 2.0 + period:
            rig.periods()
        assert rig.clients.lease.holder == ""


def test_a_command_of_a_client_that_has_died_since_begins_nothing() -> None:
    with Rig(period=6.0) as rig:
        rig.do("lease")
        rig.sign("heater", "jog")
        rig.send("write", "heater", 5.0)
        rig.send("call", "jog", arguments={"velocity": 2.0})
        rig.periods()
        refused = [event.text for event in rig.events[-2:]]
        assert refused == ["CommandRefused: nobody has the lease; take it first"] * 2  # it has ended, too
        rig.do("lease", seconds=60.0)
        rig.sign("heater")
        rig.send("write", "heater", 5.0)
        rig.periods()
        assert rig.last()[1] == "CommandRefused: heater: dead-man timeout: no heartbeat from its client for 0.5 s"
        assert rig.m.heater.read() == rig.m.heater.default


def test_a_heartbeat_of_the_former_holder_that_comes_late_refuses_nobody() -> None:
    with Rig() as rig:
        rig.do("lease", key="b")
        former = rig.leases["b"]
        rig.do("lease", over=True)
        rig.sign("heater")
        rig.letters.signs |= dict.fromkeys(("", "heater"), (former, rig.now))  # written over those of the holder
        rig.send("write", "heater", 5.0)
        rig.periods()
        assert rig.last()[0] is CommandState.DONE
        assert rig.m.heater.read() == 5.0


WRONG = [float("nan"), float("inf"), float("-inf"), -1.0, 0.0, BOOT - 1.0, BOOT + 1e6, 1e300]


@pytest.mark.parametrize(("lease", "seen"), [*((1, seen) for seen in WRONG), (0, None), (2, None), (2**64 - 1, None)])
def test_a_heartbeat_of_a_wrong_time_or_another_lease_keeps_nothing_up(lease: int, seen: float | None) -> None:
    with Rig(period=0.1) as rig:
        rig.do("lease")
        written = rig.now
        rig.do("write", "heater", 5.0)
        assert rig.m.heater.read() == 5.0
        while rig.now < written + 2.2:
            rig.letters.signs = dict.fromkeys(("", "heater"), (lease, rig.now if seen is None else seen))
            rig.periods()
            assert (rig.m.heater.read() == 5.0) <= (rig.now <= written + DEAD_MAN_TIME)
        assert rig.clients.lease.holder == ""


def test_a_rate_holds_for_a_client() -> None:
    with Rig(heater=actuator(slew_rate=10.0)) as rig:
        rig.do("lease")
        rig.do("write", "heater", 5.0)
        assert rig.m.heater.read() == pytest.approx(10.0 * PERIOD)
        rig.periods(9)
        assert rig.m.heater.read() == pytest.approx(100.0 * PERIOD)


@pytest.mark.parametrize(
    ("path", "value", "said"),
    [
        ("heater", 1e9, "RangeError: heater: 1e9 V is outside"),
        ("heater", float("nan"), "RangeError: heater: nan is not a number in V"),
        ("heater", "ON", "RangeError: heater: 'ON' is not a number in V"),
        ("heater", True, "RangeError: heater: True is not a number in V"),
        ("lamp", "UP", "StateError: lamp has no state 'UP'"),
        ("lamp", 1, "StateError: lamp has no state 1"),
        ("lampe", "ON", "PathError: there is no actuator 'lampe'"),
        ("door", "PASS", "PathError: there is no actuator 'door'"),
    ],
)
def test_a_wrong_value_is_refused_in_the_machines_own_words(rig: Rig, path: str, value: Any, said: str) -> None:
    event = rig.do("write", path, value)
    assert event.state is CommandState.REFUSED
    assert event.text.startswith(said), event.text


# Actions ------------------------------------------------------------------------------------------------


def test_an_action_runs_to_its_end_and_its_result_is_told(rig: Rig) -> None:
    number = rig.call("close", force=3.0, how="hard").command
    rig.periods(6)
    ended = [event for event in rig.events if event.command == number]
    assert [event.state for event in ended] == [CommandState.BEGUN, CommandState.DONE]
    assert json.loads(ended[-1].text) == {"force": 3.0, "how": "hard"}
    assert ended[0].asked == "call close force=3.0 how=hard"
    assert rig.call("count").text == "1"


class Stacker(Press):
    """Its control and an action, with a sequence that it starts, tell progress in each period."""

    def control(self) -> None:
        super().control()
        self.cycle.progress("pressing")

    @action
    async def stack(self, layers: Literal["few", "many"]) -> None:
        """Stack layers."""
        await self.cycle.start(self.pile({"few": 10, "many": 110}[layers]))

    async def pile(self, layers: int) -> None:
        for layer in range(layers):
            self.cycle.progress(f"layer {layer}")
            await next_period()


@pytest.mark.parametrize(("layers", "told"), [("few", ["0"]), ("many", ["0", "50", "100"])])
def test_the_progress_that_an_action_tells_is_told_as_its_own_now_and_then(layers: str, told: list[str]) -> None:
    with Rig(kind=Stacker) as rig:
        rig.do("lease")
        number = rig.call("stack", layers=layers).command
        for _ in range(130):
            rig.keep()
        events = [event for event in rig.events if event.command == number]
        assert [event.state for event in events] == [*[CommandState.BEGUN] * (1 + len(told)), CommandState.DONE]
        assert [event.text for event in events] == ["", *(f"layer {layer}" for layer in told), ""]


def test_a_sequence_that_an_action_starts_goes_on_while_the_application_waits(rig: Rig) -> None:
    rig.call("start_another")
    rig.periods(8)
    assert rig.m.closed == 1
    assert rig.last()[0] is CommandState.DONE


def test_a_sequence_that_an_action_has_left_behind_goes_on_and_ends_with_the_lease(rig: Rig) -> None:
    rig.call("begin")
    rig.periods(8)
    assert (rig.m.closed, rig.m.cleaned) == (1, 1)
    rig.call("begin")
    rig.periods(2)
    rig.do("give back")
    rig.periods(8)
    assert (rig.m.closed, rig.m.cleaned) == (1, 2)


def test_the_default_of_a_choice_is_told_as_the_choice_that_it_is() -> None:
    class Belt(Compound):
        timer: DigitalSensor

        @action
        def select(self, step: Literal[1, 2, 3] = 2, part: PassFail = PassFail.FAIL) -> None: ...

    step, part = actions_of(Belt(timer=timer()))["select"].describe()["arguments"]
    assert (step["choices"], step["default"]) == (["1", "2", "3"], "2")
    assert part["default"] in part["choices"]
    assert part["default"] == PassFail.FAIL.name


def test_an_action_that_fails_is_answered_and_the_machine_goes_on(rig: Rig) -> None:
    rig.call("fail")
    rig.periods(3)
    assert rig.last() == (CommandState.FAILED, "TaskFailed: the press is stuck")
    assert rig.m.taken


def test_an_action_is_cancelled_by_its_path(rig: Rig) -> None:
    rig.call("close", force=1.0)
    assert rig.do("cancel", "close").state is CommandState.DONE
    assert (rig.m.closed, rig.m.cleaned) == (0, 1)
    assert rig.do("cancel", "close").text == "PathError: no action close is running"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({}, "RangeError: close: the argument force is missing"),
        ({"force": 81.0}, "RangeError: close: force: 81 kN is outside 0 to 80"),
        ({"force": "1"}, "RangeError: close: force: '1' is not a number in kN"),
        ({"force": 1.0, "how": "fast"}, "StateError: close: how: 'fast' is not one of soft, hard"),
        ({"force": 1.0, "fast": True}, "RangeError: close: there is no argument 'fast'"),
    ],
)
def test_wrong_arguments_are_refused(rig: Rig, arguments: dict[str, Any], said: str) -> None:
    event = rig.call("close", **arguments)
    assert event.state is CommandState.REFUSED
    assert event.text.startswith(said), event.text


class Exit(BaseException):
    """No Exception: nothing of Python's own catches it."""


def recurse() -> None:
    recurse()


def hold_itself() -> list[Any]:
    circle: list[Any] = []
    circle.append(circle)
    return circle


class Unshowable:
    def __str__(self) -> str:
        raise SystemExit(0)

    __repr__ = __str__


class Mischief(Press):
    """Its actions do what none should."""

    def setup(self) -> None:
        super().setup()
        self.deed: Any = lambda: None

    @action
    def at_once(self) -> Any:
        """It in the call."""
        return self.deed()

    @action
    async def later(self) -> Any:
        """It in a sequence."""
        await next_period()
        return self.deed()

    @action
    async def cleaning_up(self) -> None:
        """It while it is cancelled."""
        try:
            await wait(10.0)
        finally:
            self.deed()

    @action(release="stop_holding")
    def holding(self) -> None:
        """Until it is released."""
        self.heater.write(5.0)

    def stop_holding(self) -> Any:
        return self.deed()

    async def press_on(self) -> None:
        while True:
            self.wanted = 5.0
            await next_period()

    @action(release="let_up")
    async def pressing(self) -> None:
        """A sequence, until it is released."""
        await self.press_on()

    @action(release="let_up")
    async def tapping(self) -> None:
        """A sequence that ends by itself, and is held until it is released."""
        await next_period()

    @action(release="let_up")
    def starting(self) -> None:
        """A sequence that it starts, until it is released."""
        self.cycle.start(self.press_on())

    def let_up(self) -> None:
        self.wanted = 0.0


@pytest.mark.parametrize(
    "error", [SystemExit(0), KeyboardInterrupt(), Exit(), GeneratorExit(), ValueError(Unshowable())]
)
@pytest.mark.parametrize("path", ["at_once", "later", "cleaning_up", "holding"])
def test_whatever_an_action_raises_is_told_and_ends_nothing_else(path: str, error: BaseException) -> None:
    def deed() -> None:
        raise error

    with Rig(kind=Mischief) as rig:
        rig.do("lease")
        rig.m.deed = deed  # type: ignore[attr-defined]
        rig.call(path)
        rig.periods(3)
        rig.do("give back")
        rig.periods(3)
        assert rig.m.taken and rig.m.cycle.running
        assert any(type(error).__name__ in event.text for event in rig.events)
        states = [event.state for event in rig.events if event.path == path]
        told = {"at_once": CommandState.FAILED, "later": CommandState.FAILED}
        assert states[-1] is told.get(path, CommandState.CANCELLED)


@pytest.mark.parametrize("end", ["let go", "cancel", "give back", "nothing"])
@pytest.mark.parametrize("path", ["pressing", "starting"])
def test_what_a_held_action_drives_ends_with_it_however_it_ends(path: str, end: str) -> None:
    with Rig(kind=Mischief) as rig:
        rig.do("lease")
        number = rig.call(path).command
        rig.keep(path)
        rig.periods(3)
        assert rig.m.ram.read() == 5.0
        if end == "nothing":
            for _ in range(int(DEAD_MAN_TIME / PERIOD) + 2):
                rig.keep()  # the lease alone
                rig.periods()
        else:
            rig.do(end, path if end != "give back" else "")
        rig.periods(2)
        assert rig.m.ram.read() == 0.0
        assert sum(event.command == number and event.state is CommandState.CANCELLED for event in rig.events) <= 1


def test_a_held_sequence_that_has_ended_is_told_to_be_held_no_longer() -> None:
    with Rig(kind=Mischief) as rig:
        rig.do("lease")
        number = rig.call("tapping").command
        rig.periods(3 + int(DEAD_MAN_TIME / PERIOD))
        told = [(event.state, event.text) for event in rig.events if event.command == number]
        assert [state for state, _ in told] == [CommandState.BEGUN, CommandState.DONE, CommandState.CANCELLED]
        assert told[-1][1] == "dead-man timeout"


@pytest.mark.parametrize("deed", ["raises", "starts a sequence", "is a sequence"])
def test_a_release_that_fails_or_starts_something_resets_its_part(deed: str) -> None:
    with Rig(kind=Mischief) as rig:
        m: Any = rig.m
        m.deed = {
            "raises": lambda: 1 / 0,
            "starts a sequence": lambda: m.cycle.start(m.press_on()) and None,
            "is a sequence": m.press_on,
        }[deed]
        rig.do("lease")
        rig.call("holding")
        assert m.heater.read() == 5.0
        rig.do("let go", "holding")
        rig.periods(3)
        assert (m.heater.read(), m.ram.read()) == (0.0, 1.0)
        assert any("holding could not be released" in event.text for event in rig.events)


@pytest.mark.parametrize("path", ["at_once", "later"])
def test_an_action_without_an_end_in_itself_is_told(path: str) -> None:
    with Rig(kind=Mischief) as rig:
        rig.do("lease")
        rig.m.deed = recurse  # type: ignore[attr-defined]
        rig.call(path)
        rig.periods(2)
        assert rig.last()[0] is CommandState.FAILED
        assert rig.last()[1].startswith("RecursionError")


@pytest.mark.parametrize("path", ["at_once", "later"])
@pytest.mark.parametrize(
    ("deed", "said"),
    [
        (lambda: {(1, 2): 3}, "{(1, 2): 3}"),
        (hold_itself, "[[...]]"),
        (lambda: float("nan"), "nan"),
        (lambda: {"of": OnOff.ON}, {"of": "ON"}),
        (lambda: list(range(100)), list(range(100))),
        (Unshowable, "<Unshowable, which cannot be shown: "),
    ],
)
def test_a_result_that_is_no_plain_data_arrives_as_its_text(path: str, deed: Any, said: Any) -> None:
    with Rig(kind=Mischief) as rig:
        rig.do("lease")
        rig.m.deed = deed  # type: ignore[attr-defined]
        rig.call(path)
        rig.periods(2)
        state, text = rig.last()
        result = json.loads(text)
        assert state is CommandState.DONE
        assert result == said or (isinstance(said, str) and result.startswith(said)), result


@pytest.mark.parametrize(
    "result", ["x" * 1_000_000, "\N{SNOWMAN}" * 400, list(range(1000)), {"key": "\N{GRINNING FACE}" * 99}]
)
def test_a_long_result_is_cut_stays_json_and_says_so(result: Any) -> None:
    with Rig(kind=Mischief) as rig:
        rig.do("lease")
        rig.m.deed = lambda: result  # type: ignore[attr-defined]
        rig.call("at_once")
        _, text = rig.last()
        assert len(text.encode()) <= EVENT_TEXT_BYTES
        whole = result if isinstance(result, str) else repr(result)
        assert json.loads(text).endswith(f"... (cut: {len(whole):,} characters)")
        assert json.loads(text)[:10] == whole[:10]


def test_an_action_that_has_failed_keeps_nothing_alive() -> None:
    """The collector is off while a machine runs."""

    class Large:
        pass

    left: list[weakref.ref[Large]] = []

    def deed() -> None:
        at_client = Large()
        left.append(weakref.ref(at_client))
        try:
            raise KeyError(at_client.__class__)
        except KeyError as error:
            raise ValueError("of a chain") from error

    with Rig(kind=Mischief) as rig:
        rig.do("lease")
        rig.m.deed = deed  # type: ignore[attr-defined]
        gc.disable()
        try:
            for path in ("at_once", "later", "holding"):
                rig.call(path)
                rig.periods(2)
            rig.do("let go", "holding")
            rig.periods(2)
            assert len(left) == 3
            assert [each() for each in left] == [None] * 3
        finally:
            gc.enable()


def test_a_sequence_that_an_action_has_started_is_cancelled_with_it(rig: Rig) -> None:
    rig.call("start_another")
    rig.periods()
    rig.do("cancel", "start_another")
    assert (rig.m.closed, rig.m.cleaned) == (0, 1)
    rig.call("begin")  # it has ended, what it has started goes on
    rig.do("cancel", "begin")
    assert (rig.m.closed, rig.m.cleaned) == (0, 2)


class Guarded(Press):
    """Its door latches."""

    def interlocks(self) -> Iterator[Interlock]:
        for each in super().interlocks():
            yield dataclasses.replace(each, latched=True)


def test_a_latched_interlock_is_acknowledged_by_client_under_the_lease_when_its_cause_is_gone() -> None:
    with Rig(Mode.AUTOMATIC, kind=Guarded) as rig:
        put(rig.m.door, PassFail.FAIL)
        rig.periods()
        assert "nobody has the lease" in rig.do("acknowledge", "ram").text
        rig.do("lease")
        for path in ("", "ram"):
            refused = rig.do("acknowledge", path)
            assert refused.state is CommandState.REFUSED
            assert refused.text.endswith("is still inhibited: the door is open")
        put(rig.m.door, PassFail.PASS)
        rig.periods()
        assert not rig.m.taken
        assert "no object 'rom'" in rig.do("acknowledge", "rom").text
        for text in ("", '"nothing was latched"'):
            done = rig.do("acknowledge", "ram")
            assert (done.state, done.text) == (CommandState.DONE, text)
        rig.periods()
        assert rig.m.taken


class Waiting(Guarded):
    """Its ram waits for something that is no fault, beside the door that latches."""

    def interlocks(self) -> Iterator[Interlock]:
        yield from super().interlocks()
        yield Interlock(lambda: True, [self.ram], "no sheet")


def test_an_interlock_that_does_not_latch_refuses_no_acknowledgement() -> None:
    with Rig(Mode.AUTOMATIC, kind=Waiting) as rig:
        put(rig.m.door, PassFail.FAIL)
        rig.periods()
        put(rig.m.door, PassFail.PASS)
        rig.periods()
        rig.do("lease")
        for text in ("", '"nothing was latched"'):
            done = rig.do("acknowledge")
            assert (done.state, done.text) == (CommandState.DONE, text)


def test_a_jog_ends_without_a_heartbeat(rig: Rig) -> None:
    rig.call("jog", velocity=2.0)
    rig.periods(int(DEAD_MAN_TIME / PERIOD) - 2)
    assert rig.m.jogging == 2.0
    rig.keep("jog")
    rig.periods(int(DEAD_MAN_TIME / PERIOD) - 2)
    assert rig.m.jogging == 2.0
    rig.periods(5)
    assert rig.m.jogging == 0.0


def test_the_machine_that_stops_cancels_what_hands_have_begun() -> None:
    with Rig() as rig:
        rig.do("lease")
        rig.call("close", force=1.0)
    assert rig.m.cleaned == 1


def test_anybody_may_stop_the_machine() -> None:
    with Rig() as rig:
        for _ in range(3 * COMMANDS_PER_PERIOD):  # no queue delays it
            rig.send("tune", "speed", 1.0)
        rig.letters.asked[0] = 7  # garbage
        rig.periods()
        assert rig.m.cycle.running
        rig.letters.stop = signal.SIGINT, "ann, a test"
        rig.periods()
        assert not rig.m.cycle.running
        assert rig.connection.stop.signal == signal.SIGINT
        assert rig.clients.stopped_by == "ann, a test"
        rig.periods()
        asked = [(event.who, event.asked) for event in rig.events if event.state is CommandState.DONE]
        assert asked == [("ann, a test", "stop")]


def test_no_more_than_a_few_commands_are_carried_out_in_one_period(rig: Rig) -> None:
    for _ in range(3 * COMMANDS_PER_PERIOD):
        rig.send("tune", "speed", 1.0)
    rig.periods()
    assert len(rig.letters.waiting) == 2 * COMMANDS_PER_PERIOD


@pytest.mark.parametrize("do", ["", "leese", "look", "__init__"])
def test_an_unknown_command_is_refused(rig: Rig, do: str) -> None:
    assert "there is no command" in rig.do(do).text


# What is declared ---------------------------------------------------------------------------------------


def test_a_number_without_a_range_is_refused_where_it_is_declared() -> None:
    class Wrong(Compound):
        lamp: BinaryActuator[OnOff]

        @action
        def go(self, far: float) -> None: ...

    with pytest.raises(DeclarationError, match=r"action go: argument far needs a range"):
        actions_of(Wrong(lamp=relay()))


def test_an_argument_whose_annotation_cannot_be_evaluated_is_a_mistake_of_the_declaration() -> None:
    class Wrong(Compound):
        lamp: BinaryActuator[OnOff]

        @action
        def go(self, where: Nowhere) -> None: ...  # type: ignore[name-defined]  # noqa: F821

    with pytest.raises(DeclarationError, match="action go: argument where must be annotated as float"):
        actions_of(Wrong(lamp=relay()))


@pytest.mark.parametrize("name", ["later", "needing", "nowhere"])
def test_a_release_that_cannot_be_called_at_once_is_refused_where_it_is_declared(name: str) -> None:
    class Wrong(Compound):
        lamp: BinaryActuator[OnOff]

        @action(release=name)
        def go(self) -> None: ...

        async def later(self) -> None: ...

        def needing(self, what: str) -> None: ...

    with pytest.raises(DeclarationError, match=f"action go: release='{name}' (is|cannot be called without arguments)"):
        actions_of(Wrong(lamp=relay()))


# Properties ---------------------------------------------------------------------------------------------

VALUES = st.sampled_from([-1e9, -3.0, 0.0, 2.0, 5.0, 1e9, float("nan"), "ON", None])
STEPS = st.lists(
    st.one_of(
        st.tuples(st.just("lease"), st.sampled_from("ab"), st.booleans()),
        st.tuples(st.just("write"), st.sampled_from("ab"), st.sampled_from(["ram", "heater", "lamp"]), VALUES),
        st.tuples(st.just("keep"), st.sampled_from("ab"), st.sampled_from([("ram",), ("heater", "lamp"), ()])),
        st.tuples(st.just("mode"), st.sampled_from("ab"), st.sampled_from(["manual", "automatic"])),
        st.tuples(st.just("door"), st.booleans()),
        st.tuples(st.just("program"), st.sampled_from([0.0, 1.0, 5.0])),
        st.tuples(st.just("pass"), st.integers(1, 80)),
    ),
    max_size=30,
)


@budget(50, 150)
@given(STEPS, st.booleans())
def test_guards_hold_for_any_interleaving_of_program_and_clients(steps: list[tuple[Any, ...]], slow: bool) -> None:
    rate = 100.0
    with Rig(ram=actuator(slew_rate=rate) if slow else actuator(), heater=actuator(expires="100 ms")) as rig:
        kept: dict[str, int] = {}
        holder = ""
        for step in steps:
            match step:
                case "lease", key, over:
                    done = rig.do("lease", key=key, over=over).state is CommandState.DONE
                    assert done == (holder in ("", f"client {key}") or over)
                case "write", key, path, value:
                    if rig.do("write", path, value, key=key).state is CommandState.DONE:
                        assert rig.clients.lease.holder == f"client {key}"
                        assert rig.clients.mode is Mode.MANUAL
                        kept[path] = rig.connection.machine.clock.number
                case "keep", key, held:
                    rig.keep(*held, key=key)
                    if rig.clients.lease.holder == f"client {key}":
                        kept |= dict.fromkeys(held, rig.connection.machine.clock.number)
                case "mode", key, mode:
                    rig.do("mode", value=mode, key=key)
                case "door", is_open:
                    put(rig.m.door, PassFail.FAIL if is_open else PassFail.PASS)
                    rig.periods()
                case "program", wanted:
                    rig.m.wanted = wanted
                    rig.periods()
                case "pass", count:
                    for _ in range(count):
                        ram = rig.m.ram.read()
                        rig.periods()
                        if slow and rig.m.ram.read() != rig.m.ram.default:
                            assert abs(rig.m.ram.read() - ram) <= rate * PERIOD * 1.001
            holder = rig.clients.lease.holder
            if rig.m.door.read() is PassFail.FAIL:
                assert rig.m.lamp.read() is OnOff.OFF
                assert rig.m.ram.read() == rig.m.ram.default
            claims = rig.connection.machine.claims
            for actuator_ in (rig.m.ram, rig.m.heater, rig.m.lamp):
                slot = rig.connection.image.slot_of[id(actuator_)]
                state, client = rig.connection.image.restrictions[slot], claims.client_of(slot)
                assert (state == TAKEN_BY_CLIENT, state in (FREE, ASKED)) == (bool(client), actuator_.inhibited is None)
            now = rig.connection.machine.clock.number
            for path in ("heater", "lamp"):  # only clients write them
                item: Any = find(rig.m, path)
                if item.read() != item.default:
                    lasts = 0.1 if path == "heater" else DEAD_MAN_TIME
                    assert (now - kept[path]) * PERIOD <= lasts + 2 * PERIOD
                    assert holder
                    assert rig.clients.mode is Mode.MANUAL


# A station ----------------------------------------------------------------------------------------------


def test_an_axis_whose_motor_a_client_takes_goes_on_from_where_it_then_stands() -> None:
    pytest.importorskip("mujoco")
    from umo.process.station import find

    station = find("ztheta")
    m: Any = station.machine()
    connection = connect(m, station.wiring(None))
    letters, number = Letters(), 0

    def send(do: str, path: str = "", **more: Any) -> None:
        nonlocal number
        number += 1
        letters.waiting.append(ClientCommand(number, "a test", "a", do, path, **more))

    def periods(count: int) -> None:
        for _ in range(count):
            letters.signs = dict.fromkeys(("", "z.motor"), (1, BOOT + connection.machine.clock.now))
            m.timer.read()
            m.sample()
            m.control()
            m.update()

    def done(path: str) -> bool:
        return any(e.path == path and e.state is CommandState.DONE for e in connection.machine.events)

    with connection:
        machine = connection.machine
        machine.attach(ClientControl(letters, letters, Mode.MANUAL, lambda: BOOT + machine.clock.now))
        send("lease")
        send("call", "home")
        for _ in range(100):
            periods(100)
            if done("home"):
                break
        assert done("home")
        before = m.z.encoder.read()
        send("write", "z.motor", value=-1.5)
        periods(150)
        assert m.z.motor.read() == -1.5
        moved = m.z.encoder.read()
        assert abs(moved - before) > m.z.following_error
        send("let go", "z.motor")
        periods(500)
        assert abs(m.z.error) < m.z.window
        send("call", "z.move_to", arguments={"position": 100_000.0})
        periods(2000)
        assert done("z.move_to")
        assert m.z.encoder.read() == pytest.approx(100_000.0, abs=m.z.window)
