"""Replays of small machines: whatever a program and its devices do, a replay repeats it to the bit."""

from __future__ import annotations

import random
import signal
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from random import Random
from typing import Annotated, Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.flaky import Flaky, loop
from helpers.machines import Bench, actuator, bench, relay, sensor, switch, timer, wired
from helpers.operator import Operator
from helpers.tapes import Case, listen, taped
from umo import (
    BinaryActuator,
    BinarySensor,
    Compound,
    DigitalActuator,
    DigitalSensor,
    Number,
    Quality,
    Range,
    UmoError,
    action,
    connect,
    drive,
)
from umo.control import next_period
from umo.errors import ChannelsFailed, DriverError
from umo.operation.commands.client_commands import DEAD_MAN_REASON, NOT_RENEWED
from umo.recording.block import Block
from umo.recording.replay.program import Program
from umo.recording.replay.replaying import replay
from umo.recording.replay.tape import NotReplayable
from umo.states import OnOff, PassFail
from umo.testing import Scripted, VirtualTimer, periods
from umo.wiring import resolve


class Unit(Compound, equipment=True):
    level: DigitalSensor
    valve: DigitalActuator

    def control(self) -> None:
        if not self.cycle.fault:
            self.valve.write(self.level.read() / 10.0)


class SlowUnit(Unit, every=5):
    pass


class Restless(Compound):
    """Synchronous and asynchronous objects, that hold, retry or raise; parts that fail alone, one at another rate."""

    timer: DigitalSensor
    motor: DigitalActuator
    encoder: DigitalSensor
    probe: DigitalSensor
    held: DigitalSensor
    valve: BinaryActuator[OnOff]
    door: BinarySensor[PassFail]
    heater: DigitalActuator
    unit: Unit
    slow: SlowUnit

    def control(self) -> None:
        random = Random(round(self.now * 1000))  # the same in each run
        for _ in range(random.randrange(3)):
            with suppress(UmoError):
                self.act(random)
        with suppress(UmoError):
            self.motor.write(self.encoder.read() / 20.0)

    def act(self, random: Random) -> None:
        what = random.randrange(7)
        if what == 0:
            self.heater.write(self.probe.read() / 10.0)
        elif what == 1:
            self.valve.write(random.choice(list(OnOff)))
        elif what == 2:
            self.unit.sample()
        elif what == 3:
            self.unit.update()
        elif what == 4:
            self.motor.reset()
        elif what == 5:
            self.slow.reset()
        elif self.unit.cycle.fault:
            self.unit.cycle.clear()


def restless() -> Restless:
    def unit(kind: type[Unit]) -> Unit:
        return kind(level=sensor(), valve=actuator(slew_rate=500.0))

    return Restless(
        timer=timer(),
        motor=actuator(on_error="retry", max_age="50 ms"),
        encoder=sensor(on_error="hold", max_age="20 ms"),
        probe=sensor(synchronous=False, on_error="hold", max_age="20 ms"),
        held=sensor(on_error="hold", max_age="3 ms"),
        valve=relay(synchronous=False, expires="30 ms"),
        door=switch(on_error="hold", max_age="20 ms"),
        heater=actuator(synchronous=False, on_error="retry", max_age="20 ms"),
        unit=unit(Unit),
        slow=unit(SlowUnit),
    )


def case(seed: int, share: float, count: int = 300, **process: Any) -> Case:
    def wiring(machine: Any) -> Any:
        random = Random(seed)
        missed = [random.choice([0, 0, 0, 0, 1, 3]) for _ in range(count)]
        box, other = Flaky(seed, share), Flaky(seed + 1, share)

        def begin(number: int) -> None:
            box.quiet = other.quiet = number < 3

        entries = {path: {"driver": "other"} for path in ("unit.level", "unit.valve", "held", "heater")}
        clock = VirtualTimer(missed, on_period=begin)
        return wired(machine, box, clock=clock, entries=entries, other=other) | (
            {"process": process} if process else {}
        )

    return Case(restless, wiring, loop(count))


@settings(max_examples=3)
@given(st.integers(0, 10_000), st.sampled_from([0.0, 0.01, 0.1, 0.4]), st.booleans())
def test_a_replay_repeats_a_machine_whose_devices_fail_at_random(seed: int, share: float, later: bool) -> None:
    check_failing(seed, share, later)


@pytest.mark.full
@pytest.mark.parametrize("seed", range(200))
def test_a_replay_repeats_machines_with_other_failures(seed: int) -> None:
    check_failing(seed, [0.0, 0.01, 0.1, 0.4][seed % 4], seed % 8 < 4)


def check_failing(seed: int, share: float, later: bool) -> None:
    each = case(seed, share, **({"outputs": "at next tick"} if later else {}))
    tape = each.record()
    result = each.replay(tape)
    assert result.identical, str(result)
    assert result.periods == sum(len(block.frames) for block in tape.recorded)


# Clients ---------------------------------------------------------------------------------------------------


class Jogged(Compound):
    timer: DigitalSensor
    motor: DigitalActuator
    encoder: DigitalSensor
    valve: BinaryActuator[OnOff]
    gain: Annotated[float, Number("", 0.0, 2.0, tunable=True)] = 0.1

    def control(self) -> None:
        if not self.cycle.manual:
            self.motor.write(self.encoder.read() * self.gain)

    @action(release="close")
    def open(self) -> None:
        """Open the valve."""
        self.valve.write(OnOff.ON)

    def close(self) -> None:
        self.valve.write(OnOff.OFF)

    @action(volts=Range("V", -10.0, 10.0))
    async def swing(self, volts: float = 1.0) -> None:
        """Swing."""
        for number in range(20):
            self.motor.write(volts if number % 2 else -volts)
            await next_period()


def jogged() -> Jogged:
    return Jogged(timer=timer(), motor=actuator(limits="clamp"), encoder=sensor(), valve=relay())


def operated(m: Any, seed: int, tape: Any) -> None:
    """An operator who does this and that, and now and then falls asleep."""
    random, operator = Random(seed), Operator(m)
    if tape is not None:
        listen(tape, operator.clients)
    for _ in range(60):
        do = random.choice(DEEDS)
        if do[0] == "lease":
            operator.alive = True
            operator.do("lease", seconds=random.choice([0.3, 2.0]), over=random.random() < 0.5)
        elif do[0] == "sleep":
            operator.alive = False
        else:
            operator.do(*do[:3], **(do[3] if len(do) > 3 else {}))
        operator.run(random.choice([1, 3, 60, 600]))


DEEDS: list[Any] = [
    ("lease",),
    ("lease",),
    ("sleep",),
    ("mode", "", "manual"),
    ("mode", "", "automatic"),
    ("write", "motor", 2.0),
    ("write", "motor", 99.0),
    ("write", "valve", "ON"),
    ("let go", "motor"),
    ("call", "open", None, {"arguments": {}}),
    ("call", "swing", None, {"arguments": {"volts": 2.0}}),
    ("call", "nothing", None, {"arguments": {}}),
    ("cancel", ""),
    ("tune", "gain", 0.5),
    ("tune", "gain", 1.5),
    ("give back",),
    ("nonsense",),
]


def client_case(seed: int) -> Case:
    return Case(jogged, lambda machine: wired(machine, Flaky(seed, 0.0)), drive)


def record_operated(seed: int) -> Any:
    each = client_case(seed)
    machine = each.machine()
    connection = connect(machine, each.wiring(machine))
    with connection as m, taped(connection, size=5000) as tape:
        operated(m, seed, tape)
    return tape


def check_operated(seed: int) -> set[str]:
    """Replay a run with an operator; what its events tell."""
    tape = record_operated(seed)
    result = client_case(seed).replay(tape)
    assert result.identical, str(result)
    assert result.periods == len(tape.frames)
    return {event.text for event in tape.events}


@pytest.mark.full
def test_a_replay_repeats_what_clients_did_and_what_ended_without_a_heartbeat() -> None:
    told = check_operated(4) | check_operated(9)
    assert DEAD_MAN_REASON in told and any(text.endswith(NOT_RENEWED) for text in told)


@pytest.mark.full
@pytest.mark.parametrize("seed", range(40))
def test_a_replay_repeats_what_other_operators_did(seed: int) -> None:
    check_operated(seed)


def test_a_command_that_is_not_in_the_recording_is_missed() -> None:
    """A test of the test: without the commands the replay differs."""
    tape = record_operated(4)
    for block in tape.recorded:
        block.commands.clear()
    assert not client_case(4).replay(tape).identical


# What differs ----------------------------------------------------------------------------------------------


class Doubled(Bench):
    factor = 0.1

    def control(self) -> None:
        self.motor.write(self.encoder.read() * self.factor)
        if self.now > 0.0105:
            self.valve.write(OnOff.ON)


class Warm(Doubled, numbers={"warmth": Number("degC", shown=True)}):
    @property
    def warmth(self) -> float:
        return 600.0 * self.factor


def doubled(kind: type[Doubled] = Doubled, **settings: Any) -> Case:
    def machine() -> Any:
        made = bench(kind, motor=actuator(limits="clamp"))
        vars(made).update(settings)
        return made

    def wiring(machine: Any) -> Any:
        box = Scripted({"encoder": list(range(400))})
        return wired(machine, box)

    return Case(machine, wiring, lambda m: periods(m, 50))


def test_the_first_difference_is_told_with_its_period_object_and_both_values() -> None:
    tape = doubled().record()
    changed = doubled()
    other = changed.machine()
    program = Program(other, resolve(other, changed.wiring(other)), lambda m: late(m))

    def late(m: Any) -> None:
        for number in range(50):
            m.timer.read()
            m.sample()
            m.control()
            if number == 30:
                m.motor.write(2.0)
            m.update()

    result = replay(tape, program)
    assert result.difference is not None
    assert (result.difference.period, result.difference.path) == (30, "motor")
    assert (result.difference.recorded, result.difference.replayed) == ("1.5 V (raw 3)", "2.0 V (raw 4)")
    assert result.status == 1 and "first difference in period 30, 0.031 s: motor" in str(result)


def test_the_signals_that_differ_have_their_units_as_everywhere() -> None:
    changed = doubled(Warm, factor=0.2).replay(doubled(Warm).record())
    assert changed.difference is not None
    assert changed.difference.signals == ("warmth: recorded 60 °C, replayed 120 °C",)


def test_a_program_that_ends_earlier_or_fails_differs_and_one_that_goes_on_ends_with_the_recording() -> None:
    tape, each = doubled().record(), doubled()
    early = each.replay(tape, lambda m: periods(m, 20))
    assert early.difference is not None and early.difference.replayed == "the program has ended"
    assert early.difference.period == 20

    def failing(m: Any) -> None:
        periods(m, 20)
        raise RuntimeError("no")

    failed = each.replay(tape, failing)
    assert failed.difference is not None and failed.difference.replayed.startswith("RuntimeError: no")
    longer = each.replay(tape, lambda m: [periods(m) for _ in range(100) if m.cycle.running])
    assert longer.identical and longer.periods == 50


@pytest.mark.parametrize(
    "changed",
    [
        lambda m: m.valve.write(OnOff.ON),
        lambda m: m.encoder.reset(),
        lambda m: m.motor.reset(),
        lambda m: m.sample(),
        lambda m: m.update(),
    ],
    ids=["write", "reset of a sensor", "reset", "sample", "update"],
)
def test_any_other_call_of_a_driver_is_a_difference(changed: Any) -> None:
    tape, each = doubled().record(), doubled()

    def loop(m: Any) -> None:
        for number in range(50):
            periods(m)
            if number == 5:
                changed(m)

    result = each.replay(tape, loop)
    assert result.difference is not None and result.difference.period in (5, 6), str(result)


def test_a_program_that_updates_twice_in_a_period_is_repeated() -> None:
    def loop(m: Any) -> None:
        for number in range(50):
            periods(m)
            if number % 7 == 5:
                m.motor.write(number / 10.0)
                m.update()

    each = doubled()
    tape = Case(each.machine, each.wiring, loop).record()
    result = each.replay(tape, loop)
    assert result.identical and result.periods == len(tape.frames) == 57, str(result)


@pytest.mark.parametrize("failed", [1, 2])
@pytest.mark.parametrize("error", [OSError("dead"), ChannelsFailed({"encoder": "cut"})], ids=["whole", "channel"])
def test_of_two_transfers_of_a_block_in_a_period_the_one_fails_that_has_failed(failed: int, error: Exception) -> None:
    """A block that succeeds has no entries: those of the second one must not be taken for those of the first."""
    box = Scripted({"encoder": [n % 200 for n in range(400)]})

    def loop(m: Any) -> None:
        for number in range(20):
            m.timer.read()
            for again in (1, 2):
                box.broken = error if number == 10 and again == failed else None
                with suppress(DriverError):
                    m.sample()
                box.broken = None
                good = m.encoder.quality is Quality.GOOD
                m.motor.write(m.encoder.read() / 20.0 if good else -float(again))
            m.update()

    each = Case(lambda: bench(encoder=sensor(on_error="mark")), lambda machine: wired(machine, box), loop)
    tape = each.record()
    result = each.replay(tape)
    assert result.identical and result.periods == 20, str(result)


def test_wall_clock_random_numbers_and_the_order_of_hashes_are_noticed() -> None:
    def loop(read: Callable[[], float]) -> Any:
        def run(m: Any) -> None:
            for _ in range(200):
                m.motor.write(read() * 1000.0 % 10.0)
                periods(m)

        return run

    for read in (time.time, time.perf_counter, random.random):
        each = Case(bench, lambda machine: wired(machine, Scripted()), loop(read))
        result = each.replay(each.record())
        assert result.difference is not None and result.difference.period < 40


def test_random_numbers_of_the_machine_are_repeated_and_their_seed_is_recorded() -> None:
    def loop(m: Any) -> None:
        for _ in range(50):
            m.motor.write(m.cycle.random.uniform(-5.0, 5.0))
            periods(m)

    each = Case(bench, lambda machine: wired(machine, Scripted()), loop)
    tape = each.record()
    assert each.replay(tape).identical
    tape.layout.about["initial"]["seed"] = 1
    assert not each.replay(tape).identical


def test_ctrl_c_ends_a_replay_and_is_no_difference() -> None:
    tape, each = doubled().record(), doubled()

    def loop(m: Any) -> None:
        for number in range(50):
            if not m.cycle.running:
                break
            if number == 20:
                signal.raise_signal(signal.SIGINT)
            periods(m)

    with pytest.raises(KeyboardInterrupt):
        each.replay(tape, loop)


def test_lost_frames_and_lost_entries_end_the_replay_in_words() -> None:
    tape, each = doubled().record(), doubled()
    (block,) = tape.recorded
    first, second = (Block(block.frames[part], block.entries[:0]) for part in (slice(20), slice(25, None)))
    tape.recorded = [first, replace(second, lost=5)]
    result = each.replay(tape)
    assert result.difference is None and not result.identical and result.periods == 20
    assert "5 frames after 0.02 s were lost" in str(result)
    tape.recorded = [first, replace(second, entries_lost=2)]
    assert "2 entries of the journal after 0.02 s were lost" in str(each.replay(tape))
    tape.recorded = [first, replace(second, events_lost=3)]
    assert "3 events after 0.02 s were lost" in str(each.replay(tape))


def test_a_machine_with_other_objects_is_refused_in_one_line() -> None:
    tape = doubled().record()
    with pytest.raises(NotReplayable, match="the present machine has no object encoder"):
        Case(lambda: Lone(timer=timer()), lambda m: wired(m, Scripted()), drive).replay(tape)


class Lone(Compound):
    timer: DigitalSensor


# Machines without a timer ----------------------------------------------------------------------------------


class Timeless(Compound):
    motor: DigitalActuator
    encoder: DigitalSensor
    probe: DigitalSensor

    def control(self) -> None:
        self.motor.write(min(self.encoder.read() / 20.0 + self.dt, 10.0))


def test_a_machine_without_a_timer_is_replayed_with_the_recorded_times() -> None:
    def loop(m: Any) -> None:
        for number in range(100):
            m.sample()
            if number % 3 == 0:
                m.probe.read()
            m.control()
            m.motor.write(min(m.now * 100.0 % 10.0, 10.0))
            m.update()

    def make() -> Timeless:
        return Timeless(motor=actuator(resolution=1e-4), encoder=sensor(), probe=sensor(synchronous=False))

    def wiring(machine: Any) -> Any:
        return {"drivers": {"box": Flaky(3)}, "wire": {p: {"driver": "box"} for p in ("motor", "encoder", "probe")}}

    each = Case(make, wiring, loop)
    tape = each.record()
    result = each.replay(tape)
    assert result.identical and result.periods == 100, str(result)


@pytest.mark.parametrize("error", [ValueError("crc"), DriverError("gone")])
def test_an_absence_in_which_each_call_failed_at_once_is_repeated(error: Exception) -> None:
    """The tape has no classes of errors."""
    box, keep = Scripted(), {"max_age": "60 s"}

    def make() -> Bench:
        return bench(
            motor=actuator(on_error="retry", **keep),
            encoder=sensor(on_error="hold", **keep),
            valve=relay(on_error="retry", **keep),
            limit=switch(on_error="hold", **keep),
        )

    def run(m: Any) -> None:
        for number in range(800):
            box.broken = error if 200 <= number < 700 else None
            with suppress(DriverError):
                periods(m)

    each = Case(make, lambda machine: wired(machine, box), run)
    result = each.replay(each.record())
    assert result.identical and result.periods == 800, str(result)
