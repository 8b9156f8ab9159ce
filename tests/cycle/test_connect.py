"""Connecting and leaving: what happens, in which order, also when something fails."""

from __future__ import annotations

import threading
from typing import Any

import pytest

from helpers.machines import actuator, bench, failed, relay, sensor, switch, timer, wired
from umo import (
    BinaryActuator,
    BinarySensor,
    Compound,
    DigitalActuator,
    DigitalSensor,
    Quality,
    TaskFailed,
    UmoError,
    connect,
)
from umo.control import next_period
from umo.errors import DeclarationError, DriverError, StopError
from umo.objects import Atomic, atoms
from umo.states import OnOff, PassFail
from umo.testing import Scripted, VirtualTimer, periods


class Joint(Compound):
    motor: DigitalActuator
    encoder: DigitalSensor
    brake: BinaryActuator[OnOff]


class Arm(Compound, stop_order=("z.motor", "theta", "z")):
    timer: DigitalSensor
    lamp: BinaryActuator[OnOff]
    z: Joint
    theta: Joint
    gripper: BinarySensor[PassFail]
    gain: float = 1.0


def arm() -> Arm:
    def joint() -> Joint:
        return Joint(motor=actuator(default=1.0), encoder=sensor(), brake=relay(default=OnOff.ON, synchronous=False))

    return Arm(timer=timer(), lamp=relay(), z=joint(), theta=joint(), gripper=switch())


ACTUATORS = ["lamp", "z.motor", "z.brake", "theta.motor", "theta.brake"]
DECLARED = ["lamp", "z.motor", "z.encoder", "z.brake", "theta.motor", "theta.encoder", "theta.brake", "gripper"]
STOPPING = ["z.motor", "theta.motor", "theta.brake", "z.brake", "lamp"]
DEFAULTS = {"lamp": 0, "z.motor": 2, "z.brake": 1, "theta.motor": 2, "theta.brake": 1}


def log(box: Scripted) -> list[tuple[str, str]]:
    return [(call.segment, ",".join(call.channels)) for call in box.calls]


# Entering --------------------------------------------------------------------------------------------


def test_nothing_touches_hardware_when_declared_or_when_connect_is_called():
    machine, box = arm(), Scripted()
    connect(machine, wired(machine, box))
    assert box.calls == []


def test_entering_opens_initialises_every_object_at_its_default_arms_the_watchdog_then_samples_once():
    machine, box = arm(), Scripted()
    wiring = wired(machine, box)
    wiring["drivers"]["box"] = {"type": box, "watchdog": "200 ms"}
    with connect(machine, wiring):
        assert log(box) == [
            ("open", ""),
            *(("initialize", path) for path in DECLARED),
            ("watchdog", ""),
            ("read_many", "z.encoder,theta.encoder,gripper"),
        ]
        initialised = {call.channels[0]: call.raws[0] for call in box.segments("initialize")}
        assert initialised == dict.fromkeys(DECLARED) | DEFAULTS
        assert box.segments("watchdog")[0].raws == (0.2,)


def test_after_entering_pending_and_commanded_are_the_default_and_sensors_have_their_first_sample():
    machine, box = arm(), Scripted({"z.encoder": 40, "gripper": 1})
    with connect(machine, wired(machine, box)) as m:
        assert (m.z.motor.pending, m.z.motor.read(), m.z.motor.raw) == (1.0, 1.0, 2)
        assert (m.z.brake.pending, m.z.brake.read()) == (OnOff.ON, OnOff.ON)
        assert (m.z.encoder.read(), m.gripper.read()) == (20.0, PassFail.FAIL)
        assert all(item.quality is Quality.GOOD for item in atoms(m) if item is not m.timer)


def test_without_a_watchdog_in_the_wiring_none_is_armed():
    machine, box = arm(), Scripted()
    with connect(machine, wired(machine, box)):
        assert box.segments("watchdog") == []


def test_drivers_open_in_the_order_of_the_wiring_and_close_in_reverse():
    order: list[str] = []

    class Noting(Scripted):
        def __init__(self, name):
            super().__init__()
            self.name = name

        def open(self):
            order.append(f"open {self.name}")

        def close(self):
            order.append(f"close {self.name}")

    machine = bench()
    wiring = wired(machine, Noting("box"), other=Noting("other"), entries={"valve": {"driver": "other"}})
    with connect(machine, wiring):
        pass
    assert order == ["open box", "open other", "close other", "close box"]


# Leaving ---------------------------------------------------------------------------------------------


def test_without_a_declared_order_actuators_stop_as_declared():
    machine, box = bench(), Scripted()
    with connect(machine, wired(machine, box)):
        pass
    assert [call.channels[0] for call in box.segments("reset")] == ["motor", "valve"]


@pytest.mark.parametrize("error", [ValueError("mine"), KeyboardInterrupt(), SystemExit(3)])
def test_however_the_block_ends_the_actuators_are_reset_and_the_error_comes_out(error):
    machine, box = arm(), Scripted()
    with pytest.raises(type(error)) as caught, connect(machine, wired(machine, box)) as m:
        m.z.motor.write(9.0)
        m.update()
        raise error
    assert caught.value is error
    assert {path: box.get(path) for path in ACTUATORS} == DEFAULTS
    assert not machine.cycle.connected


def test_one_failing_reset_never_stops_the_rest_and_all_are_listed_by_path():
    machine, box = arm(), Scripted()
    with (
        pytest.raises(StopError, match="not brought to their defaults") as caught,
        connect(machine, wired(machine, box)) as m,
    ):
        for item in (m.z.motor, m.theta.motor):
            item.write(9.0)
        m.update()
        start = len(box.calls)
        box.at(start, OSError("cut"))  # z.motor
        box.at(start + 3, RuntimeError("bug"))  # z.brake
        box.at(start + 5, OSError("cut"))  # finalise the gripper
    assert failed(caught.value) == ["z.motor", "z.brake", "gripper"]
    assert "\n  box: RuntimeError: bug; z.brake\n" in str(caught.value)
    assert (box.get("z.motor"), box.get("theta.motor")) == (18, 2)
    assert log(box)[start:] == [
        *(("reset", path) for path in STOPPING),
        *(("finalize", path) for path in reversed(DECLARED)),
        ("close", ""),
    ]


def test_what_could_only_not_be_given_back_is_a_driver_error_that_is_no_stop_error():
    machine, box = arm(), Scripted()
    with (
        pytest.raises(DriverError, match="failures at the end of the run") as caught,
        connect(machine, wired(machine, box)),
    ):
        box.at(len(box.calls) + len(STOPPING), OSError("cut"))
    assert not isinstance(caught.value, StopError)
    assert failed(caught.value) == ["gripper"]


def test_the_error_of_the_block_is_the_cause_of_the_stop_error():
    machine, box = arm(), Scripted()
    mine = ValueError("mine")
    with pytest.raises(StopError) as caught, connect(machine, wired(machine, box)):
        box.broken = OSError("dead")
        raise mine
    assert caught.value.__cause__ is mine
    assert failed(caught.value)[: len(STOPPING)] == STOPPING
    assert "driver box" in failed(caught.value)


@pytest.mark.parametrize(
    ("error", "comes_out"),
    [(ValueError("cleanup"), ValueError), (SystemExit(1), TaskFailed), (KeyboardInterrupt(), TaskFailed)],
)
def test_a_sequence_that_fails_while_it_is_cancelled_does_not_keep_the_actuators_from_their_defaults(error, comes_out):
    async def stubborn():
        try:
            while True:
                await next_period()
        finally:
            raise error

    machine, box = arm(), Scripted()
    with pytest.raises(comes_out) as caught, connect(machine, wired(machine, box)) as m:
        m.z.motor.write(9.0)
        m.cycle.start(stubborn())
        m.cycle.start(stubborn())
        periods(m, 2)
    assert "stubborn" in [entry.name for entry in caught.traceback] or caught.value.__cause__ is error
    assert {path: box.get(path) for path in ACTUATORS} == DEFAULTS


def test_an_error_of_the_application_keeps_its_place_when_its_sequences_fail_while_they_are_cancelled():
    async def stubborn():
        try:
            while True:
                await next_period()
        finally:
            raise ValueError("cleanup")

    machine = arm()
    with pytest.raises(KeyError) as caught, connect(machine, wired(machine, Scripted())) as m:
        m.cycle.start(stubborn())
        periods(m, 2)
        raise KeyError("the first")
    also, moment = caught.value.__notes__
    assert also.startswith("also, while stopping its sequences: ValueError: cleanup (")
    assert moment == "at 0.002 s"


def test_a_sequence_may_still_write_while_it_is_cancelled_and_the_defaults_come_last():
    async def parking(m):
        try:
            while True:
                await next_period()
        finally:
            m.z.brake.write(OnOff.OFF)

    machine, box = arm(), Scripted()
    with connect(machine, wired(machine, box)) as m:
        m.cycle.start(parking(m))
        periods(m, 2)
    assert box.segments("write")[-1].raws == (0,)
    assert box.get("z.brake") == 1


# Failure at every call -------------------------------------------------------------------------------


def session(machine: Arm, box: Scripted) -> None:
    with connect(machine, wired(machine, box, entries={"z.motor": {"maximum": 8.0}})) as m:
        m.z.brake.write(OnOff.OFF)
        m.z.motor.write(8.0)
        m.lamp.write(OnOff.ON)
        periods(m, 2)
        m.reset()
        periods(m, 1)


PERIOD = [("read_many", "z.encoder,theta.encoder,gripper"), ("write_many", "lamp,z.motor,theta.motor")]
SESSION = [
    ("open", ""),
    *(("initialize", path) for path in DECLARED),
    PERIOD[0],
    ("write", "z.brake"),
    *PERIOD * 2,
    *(("reset", path) for path in STOPPING),
    *(("reset", path) for path in DECLARED if path not in ACTUATORS),
    *PERIOD,
    *(("reset", path) for path in STOPPING),
    *(("finalize", path) for path in reversed(DECLARED)),
    ("close", ""),
]


def test_the_calls_of_a_whole_session():
    box = Scripted()
    session(arm(), box)
    assert log(box) == SESSION


def initialised(box: Scripted) -> list[str]:
    return [call.channels[0] for call in box.segments("initialize")]


def leaving(box: Scripted) -> list[tuple[str, str]]:
    """The calls from the last reset in stopping order on."""
    calls = log(box)
    count = len([p for p in STOPPING if p in initialised(box)]) + len(initialised(box)) + 1
    return calls[-count:]


@pytest.mark.parametrize("number", range(len(SESSION)), ids=[f"{i}-{s}-{c}" for i, (s, c) in enumerate(SESSION)])
@pytest.mark.parametrize("dead", [False, True], ids=["once", "from then on"])
def test_a_failure_at_any_call_leaves_what_was_initialised_reset_and_finalised(number, dead):
    machine, box = arm(), Scripted()

    def fail(call):
        box.broken = OSError("dead") if dead else None
        raise OSError("cut")

    box.at(number, fail)
    with pytest.raises(DriverError) as caught:
        session(machine, box)
    begun = initialised(box)
    assert leaving(box) == [
        *(("reset", path) for path in STOPPING if path in begun),
        *(("finalize", path) for path in reversed(begun)),
        ("close", ""),
    ]
    assert not machine.cycle.connected
    assert machine.z.motor.maximum == 10.0
    first = len(box.calls) - len(leaving(box))
    unreached = [
        c for i, (s, c) in enumerate(log(box)) if s == "reset" and i >= first and (i == number or (dead and i > number))
    ]
    assert isinstance(caught.value, StopError) is bool(unreached)
    if unreached:
        assert failed(caught.value)[: len(unreached)] == unreached
    _, channels = SESSION[number]
    if not dead and channels:  # the call that failed is named, object by object
        assert failed(caught.value) == channels.split(",")
    for path in set(ACTUATORS) & set(begun) - set(unreached):
        assert box.get(path) == DEFAULTS[path], path


def test_a_driver_that_cannot_be_opened_is_closed_and_nothing_is_initialised():
    machine, box = arm(), Scripted()
    box.at(0, OSError("no route"))
    with pytest.raises(DriverError, match="driver box could not be opened: no route"):
        connect(machine, wired(machine, box)).__enter__()
    assert log(box) == [("open", ""), ("close", "")]


def test_a_watchdog_that_cannot_be_armed_fails_the_connection():
    machine, box = arm(), Scripted()
    wiring = wired(machine, box)
    wiring["drivers"]["box"] = {"type": box, "watchdog": "200 ms"}
    box.at(1 + len(DECLARED), OSError("refused"))
    with pytest.raises(DriverError, match="driver box could not be armed with its watchdog: refused"):
        connect(machine, wiring).__enter__()
    assert {path: box.get(path) for path in ACTUATORS} == DEFAULTS
    assert log(box)[-1] == ("close", "")


def test_a_first_sample_that_fails_is_a_failed_connection():
    machine, box = arm(), Scripted({"gripper": 5})
    with pytest.raises(DriverError, match="box: read 5, but a binary channel reads 0 or 1; gripper"):
        connect(machine, wired(machine, box)).__enter__()
    assert not machine.cycle.connected
    assert log(box)[-1] == ("close", "")


# What is restored ------------------------------------------------------------------------------------


CALIBRATED = {
    "z.motor": {"resolution": 0.25, "zero_offset": 1.0, "maximum": 5.0},
    "z.encoder": {"resolution": -0.1},
    "gripper": {"inverted": True},
}


def settings_of(machine: Arm) -> Any:
    digital = [item.calibration for item in atoms(machine) if isinstance(item, DigitalActuator | DigitalSensor)]
    return digital, machine.gripper._inverted, machine.gain


@pytest.mark.parametrize("fails", [False, True])
def test_calibration_and_parameters_hold_while_connected_and_are_restored(fails):
    machine, box = arm(), Scripted()
    before = settings_of(machine)
    wiring = wired(machine, box, entries=CALIBRATED) | {"parameters": {"gain": 0.25}}
    if fails:
        box.at(3, OSError("cut"))
        with pytest.raises(DriverError):
            connect(machine, wiring).__enter__()
    else:
        with connect(machine, wiring) as m:
            assert (m.z.motor.resolution, m.z.motor.zero_offset, m.z.motor.maximum) == (0.25, 1.0, 5.0)
            assert (m.z.encoder.resolution, m.gripper.read(), m.gain) == (-0.1, PassFail.FAIL, 0.25)
            assert box.get("z.motor") == 0  # the default 1.0 V at this circuit
    assert settings_of(machine) == before


def test_connecting_assigns_to_an_object_its_place_and_else_what_its_wiring_changes(monkeypatch):
    machine, box, assigned = arm(), Scripted(), set()
    look = Atomic.__setattr__

    def note(item, name, value):
        assigned.add((item.path, name))
        look(item, name, value)

    monkeypatch.setattr(Atomic, "__setattr__", note)
    with connect(machine, wired(machine, box, entries={"z.motor": {"maximum": 5.0}})):
        changed = {("z.motor", name) for name in ("_calibration", "_minimum", "_maximum")}
        assert assigned == changed | {(item.path, name) for item in atoms(machine) for name in ("_image", "_slot")}


def test_a_parameter_that_cannot_be_set_leaves_nothing_half_done():
    class Strict(Compound):
        motor: DigitalActuator
        gain: float = 1.0

        def __setattr__(self, name, value):
            if name == "gain" and value > 5:
                raise ValueError("too much")
            super().__setattr__(name, value)

    machine, box = Strict(motor=actuator()), Scripted()
    wiring = wired(machine, box, entries={"motor": {"maximum": 2.0}}) | {"parameters": {"gain": 9.0}}
    with pytest.raises(ValueError, match="too much"):
        connect(machine, wiring).__enter__()
    assert (machine.motor.maximum, machine.gain, machine.cycle.connected, box.calls) == (10.0, 1.0, False, [])


def test_the_same_machine_reconnects_with_another_wiring():
    machine, one, other = arm(), Scripted(), Scripted({"z.encoder": 10})
    with connect(machine, wired(machine, one, entries=CALIBRATED)) as m:
        m.z.motor.write(3.0)
        periods(m, 3)
        assert one.get("z.motor") == 8
    count = len(one.calls)
    with connect(machine, wired(machine, other)) as m:
        assert (m.z.encoder.read(), m.now, m.z.motor.read()) == (5.0, 0.0, 1.0)
        m.z.motor.write(3.0)
        periods(m, 1)
        assert other.get("z.motor") == 6
    assert len(one.calls) == count


def test_one_connect_may_be_entered_again():
    machine, box = arm(), Scripted()
    connection = connect(machine, wired(machine, box))
    for _ in range(2):
        with connection as m:
            assert m.cycle.running
            periods(m, 1)
            connection.stop.request()
            assert not m.cycle.running


# Mistakes --------------------------------------------------------------------------------------------


def test_a_connected_machine_cannot_be_connected_again_and_stays_connected():
    machine, box = arm(), Scripted()
    with connect(machine, wired(machine, box)) as m:
        with pytest.raises(DeclarationError, match="Arm is already connected"):
            connect(machine).__enter__()
        periods(m, 1)
    assert log(box)[-1] == ("close", "")


def test_only_the_whole_machine_is_connected():
    with pytest.raises(DeclarationError, match="z is a part of a machine"):
        connect(arm().z)


# Odd machines ----------------------------------------------------------------------------------------


class Empty(Compound):
    pass


class Outputs(Compound):
    motor: DigitalActuator


class Inputs(Compound):
    encoder: DigitalSensor


class Quick(Compound):
    motor: DigitalActuator
    encoder: DigitalSensor


@pytest.mark.parametrize(
    "make",
    [
        Empty, lambda: Outputs(motor=actuator()), lambda: Inputs(encoder=sensor()),
        lambda: Quick(motor=actuator(synchronous=False), encoder=sensor(synchronous=False)),
    ],
)  # fmt: skip
@pytest.mark.usefixtures("each_way")
def test_machines_without_sensors_actuators_synchronous_objects_or_anything_run(make):
    with connect(make()) as m:
        for _ in range(3):
            assert m.sample() is True
            m.control()
            assert m.update() is True
        m.reset()
        assert m.now >= 0.0  # without a timer, the wall clock's


def test_two_machines_may_be_connected_at_once_each_on_its_own():
    one, other = arm(), arm()
    left, right = Scripted(), Scripted()
    with connect(one, wired(one, left)) as a, connect(other, wired(other, right, clock=VirtualTimer(missed=[3]))) as b:
        a.z.motor.write(5.0)
        periods(a, 2)
        periods(b, 1)
        assert (left.get("z.motor"), right.get("z.motor")) == (10, 2)
        assert (a.now, b.now) == (pytest.approx(0.002), pytest.approx(0.003))


def test_a_machine_may_be_connected_in_a_thread():
    machine, box = arm(), Scripted()
    seen: list[Any] = []

    def work():
        try:
            with connect(machine, wired(machine, box)) as m:
                periods(m, 3)
                seen.append(m.now)
        except UmoError as error:  # pragma: no cover
            seen.append(error)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert seen == [pytest.approx(0.003)]
    assert {path: box.get(path) for path in ACTUATORS} == DEFAULTS


def test_without_a_timer_dt_is_the_time_since_the_sample_before_and_execution_that_since_the_sample():
    class Untimed(Compound):
        encoder: DigitalSensor
        motor: DigitalActuator

    machine, box = Untimed(encoder=sensor(), motor=actuator()), Scripted()
    connection = connect(
        machine, {"drivers": {"box": box}, "wire": {p: {"driver": "box"} for p in ("encoder", "motor")}}
    )
    executions: list[float] = []
    with connection as m:
        ticks = iter([1.0, 3.5])
        connection.machine.clock._source = lambda: connection.machine.clock._start + next(ticks)
        connection.machine.observers.append(lambda frame: executions.append(frame.execution))
        steps = []
        for _ in range(2):
            m.sample()
            steps.append(m.dt)
            m.update()
    assert steps[1] == pytest.approx(2.5)
    assert len(executions) == 2
    assert max(executions) < 1.0


def test_the_period_whose_sample_failed_is_shown_when_the_next_begins_or_the_machine_is_left():
    machine, box = arm(), Scripted()
    connection = connect(machine, wired(machine, box))
    shown: list[tuple[int, Quality]] = []
    with pytest.raises(DriverError), connection as m:
        connection.machine.observers.append(lambda frame: shown.append((frame.number, m.z.encoder.quality)))
        periods(m)
        m.timer.read()
        box.at(len(box.calls), OSError("cut"))
        with pytest.raises(DriverError):
            m.sample()
        periods(m)
        m.timer.read()
        box.at(len(box.calls), OSError("cut again"))
        m.sample()
    assert shown == [(1, Quality.GOOD), (2, Quality.BAD), (3, Quality.GOOD), (4, Quality.BAD)]
