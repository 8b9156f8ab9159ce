"""Two writers of one actuator, neither of which has handed it over, are told once; who writes alone is not accused."""

from __future__ import annotations

import re
from collections.abc import Callable, Coroutine, Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import Result

from helpers.conversions import BUILT, choose
from helpers.machines import actuator, relay, sensor, timer, wired
from helpers.operator import Operator
from umo import BinaryActuator, Compound, DigitalActuator, DigitalSensor, Interlock, Vector, action, connect
from umo.control import Lock, Servo, first, next_period, together, unless, wait
from umo.cycle import two_writers
from umo.cycle.columns import TOLD
from umo.cycle.events import MISTAKE, CommandState
from umo.cycle.sampled_writes import FIRST, LOOKED_AT, OF
from umo.cycle.two_writers import TwoWriters
from umo.states import OnOff
from umo.testing import Scripted, VirtualTimer, periods

pytestmark = BUILT
HERE = Path(__file__)
Umo = Callable[..., Result]
Law = Callable[[Any], object]


class Part(Compound):
    """A part whose law a test chooses."""

    pump: DigitalActuator

    def setup(self) -> None:
        self.law: Law | None = None

    def control(self) -> None:
        if self.law is not None:
            self.law(self)


class Slow(Part, every=5):
    pass


class Plant(Compound):
    timer: DigitalSensor
    heater: DigitalActuator
    valve: BinaryActuator[OnOff]
    dose: DigitalActuator
    temperature: DigitalSensor
    left: Part
    right: Part
    slow: Part

    def setup(self) -> None:
        self.law: Law | None = None
        self.lock = Lock()
        self.hot = False

    def interlocks(self) -> Iterator[Interlock]:
        yield Interlock(lambda: self.hot, [self.heater], "too hot")

    def control(self) -> None:
        if self.law is not None:
            self.law(self)

    @action(harmless=True)
    def heat(self) -> None:
        """By hand."""
        self.heater.write(9.0)

    @action(harmless=True)
    async def heat_slowly(self) -> None:
        """By hand."""
        for value in (1.0, 2.0, 3.0):
            self.heater.write(value)
            await next_period()


def plant(rated: bool = False) -> Plant:
    parts = {name: Part(pump=actuator()) for name in ("left", "right")}
    slow = (Slow if rated else Part)(pump=actuator())
    return Plant(
        timer=timer(),
        heater=actuator(),
        valve=relay(),
        dose=actuator(synchronous=False),
        temperature=sensor(),
        **parts,
        slow=slow,
    )


class Rig:
    """A plant that runs."""

    def __init__(self, m: Plant, connection: Any) -> None:
        self.m, self.connection = m, connection

    def start(self, *sequences: Coroutine[Any, Any, Any]) -> None:
        for each in sequences:
            self.m.cycle.start(each)

    @property
    def told(self) -> dict[str, str]:
        """What was told of each actuator, once."""
        found = [each for each in self.connection.machine.events if each.asked == MISTAKE]
        assert len({each.path for each in found}) == len(found)
        return {each.path: each.text for each in found}


@contextmanager
def running(rated: bool = False) -> Iterator[Rig]:
    m = plant(rated)
    connection = connect(m, wired(m, Scripted(), clock=VirtualTimer()))
    with connection:
        yield Rig(m, connection)


def line(words: str) -> str:
    """The place of the line of this file that ends with the comment."""
    number = next(n for n, text in enumerate(HERE.read_text().splitlines(), 1) if text.endswith(f"# {words}"))
    return f"{HERE.name}:{number} in "


async def warm(m: Plant, value: float, every: int = 1) -> None:
    """Write for long."""
    for _ in range(20):
        m.heater.write(value)  # warm
        for _ in range(every):
            await next_period()


async def late(m: Plant, value: float, every: int = 1) -> None:
    await next_period()
    for _ in range(20):
        m.heater.write(value)  # late
        for _ in range(every):
            await next_period()


# Told ------------------------------------------------------------------------------------------------------


def test_two_sequences_in_one_period_are_told_with_both_places_once() -> None:
    with running() as rig:
        rig.start(warm(rig.m, 3.0), late(rig.m, 4.0))
        periods(rig.m, 15)
        text = rig.told["heater"]
        assert text.startswith("written by two: sequence warm (")
        assert line("warm") + "warm) and sequence late (" in text
        assert line("late") + "late); the last value counts. " in text
        assert text.endswith("Let one await the other, or both share a Lock")


def test_two_sequences_that_write_in_turns_are_told() -> None:
    with running() as rig:
        rig.start(warm(rig.m, 3.0, every=4), late(rig.m, 4.0, every=4))
        periods(rig.m, 4)
        assert not rig.told
        periods(rig.m, 10)
        assert "sequence late" in rig.told["heater"]
        assert "sequence warm" in rig.told["heater"]


def test_one_that_switches_off_what_another_one_switches_on_again_is_told() -> None:
    with running() as rig:
        rig.start(warm(rig.m, 3.0, every=4), late(rig.m, 0.0, every=4))
        periods(rig.m, 10)
        assert "heater" in rig.told


def heat(m: Any) -> None:
    m.heater.write(2.0)  # the law


def test_a_sequence_and_a_law_are_told() -> None:
    with running() as rig:
        rig.m.law = heat
        rig.start(warm(rig.m, 3.0, every=7))
        periods(rig.m, 3)
        text = rig.told["heater"]
        assert f"{line('the law')}heat)" in text
        assert "sequence warm (" in text
        assert "control of Plant (" in text
        assert text.endswith("the other one can set an attribute with the value to write")


def test_a_sequence_that_writes_once_and_ends_before_a_law_that_always_writes_is_told() -> None:
    async def once(m: Plant) -> None:
        await wait("5 ms")
        m.heater.write(3.0)

    with running() as rig:
        rig.m.law = heat
        rig.start(once(rig.m))
        periods(rig.m, 10)
        assert "heater" in rig.told


def test_one_that_begins_with_what_is_there_already_is_told_when_it_writes_another_value() -> None:
    async def follow(m: Plant) -> None:
        for value in (3.0, 3.0, 4.0, 4.0, 4.0):
            m.heater.write(value)
            await next_period()

    with running() as rig:
        rig.start(warm(rig.m, 3.0), follow(rig.m))
        periods(rig.m, 2)
        assert rig.told == {}
        periods(rig.m, 3)
        assert "heater" in rig.told


def test_the_laws_of_two_parts_are_told() -> None:
    with running() as rig:
        rig.m.left.law = rig.m.right.law = lambda part: rig.m.heater.write(1.0 if part is rig.m.left else 2.0)
        periods(rig.m, 2)
        assert "control of left (" in rig.told["heater"]
        assert "control of right (" in rig.told["heater"]


def test_the_loop_of_the_program_and_a_law_are_told() -> None:
    with running() as rig:
        rig.m.law = heat
        for _ in range(3):
            rig.m.timer.read()
            rig.m.sample()
            rig.m.heater.write(3.0)  # the loop
            rig.m.control()
            rig.m.update()
        assert f"/{line('the loop')}test_the_loop_of_the_program" in rig.told["heater"]
        assert "the program's loop (" in rig.told["heater"]


@pytest.mark.parametrize("around", [together, first])
def test_two_sequences_in_parallel_are_told(around: Any) -> None:
    async def both(m: Plant) -> None:
        await around(warm(m, 1.0), warm(m, 2.0))

    with running() as rig:
        rig.start(both(rig.m))
        periods(rig.m, 3)
        assert "sequence warm (value=1.0, every=1, started as no. 1, part 1)" in rig.told["heater"]


def test_a_vector_and_a_single_write_are_told_for_each_actuator_together() -> None:
    async def all_of_them(m: Plant) -> None:
        pumps = Vector(each.pump for each in (m.left, m.right))
        while True:
            pumps.write(np.array([1.0, 2.0]))
            await next_period()

    async def each_by_itself(m: Plant) -> None:
        while True:
            for part in (m.left, m.right):
                part.pump.write(3.0)
            await next_period()

    with running() as rig:
        rig.start(all_of_them(rig.m), each_by_itself(rig.m))
        periods(rig.m, 5)
        (text,) = rig.told.values()
        assert text.startswith("left.pump and right.pump are written by two: sequence ")


def test_a_vector_over_a_vector_is_told() -> None:
    async def every(m: Plant, value: float, step: int) -> None:
        pumps = Vector([part.pump for part in (m.left, m.right, m.slow)][::step])
        while True:
            pumps.write(np.full(2 * len(pumps), value)[::2])
            await next_period()

    with running() as rig:
        rig.start(every(rig.m, 1.0, 2), every(rig.m, 2.0, -1))
        periods(rig.m, 3)
        (text,) = rig.told.values()
        assert text.startswith("left.pump and slow.pump are written by two: sequence ")
        assert (rig.m.left.pump.read(), rig.m.right.pump.read(), rig.m.slow.pump.read()) == (2.0, 2.0, 2.0)


def test_an_asynchronous_actuator_has_two_writers_too() -> None:
    async def dose(m: Plant, value: float) -> None:
        while True:
            m.dose.write(value)
            await next_period()

    with running() as rig:
        rig.start(dose(rig.m, 1.0), dose(rig.m, 2.0))
        periods(rig.m, 3)
        assert "dose" in rig.told


def test_a_sequence_and_the_law_of_a_slow_part_are_told_though_they_act_in_other_periods() -> None:
    async def pump(m: Plant) -> None:
        for value in range(1, 6):
            m.slow.pump.write(float(value))
            await wait("7 ms")

    with running(rated=True) as rig:
        rig.m.slow.law = lambda part: part.pump.write(9.0)
        rig.start(pump(rig.m))
        periods(rig.m, 20)
        assert "slow.pump" in rig.told


def test_what_was_told_is_looked_at_no_longer(monkeypatch: pytest.MonkeyPatch) -> None:
    with running() as rig:
        rig.start(warm(rig.m, 3.0), late(rig.m, 4.0))
        periods(rig.m, 5)
        assert rig.connection.image.columns.written[rig.connection.image.slot_of[id(rig.m.heater)]] >= TOLD
        monkeypatch.setattr(TwoWriters, "_writer", lambda self: pytest.fail("it is looked at"))
        periods(rig.m, 3)


class Row(Compound):
    timer: DigitalSensor
    pumps: list[DigitalActuator]


def test_of_many_changes_in_a_period_some_are_looked_at_and_all_are_told_in_the_end(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(two_writers, "LOOKED_AT", 10)
    m = Row(timer=timer(), pumps=[actuator() for _ in range(45)])

    async def each(value: float) -> None:
        while True:
            for pump in m.pumps:
                pump.write(value)
            await next_period()

    connection = connect(m, wired(m, Scripted(), clock=VirtualTimer()))
    with connection:
        m.cycle.start(each(1.0))
        periods(m)
        m.cycle.start(each(2.0))
        told = [sum(connection.image.columns.written >= TOLD)]
        for _ in range(30):
            periods(m)
            told.append(sum(connection.image.columns.written >= TOLD))
        assert max(after - before for before, after in pairwise(told)) <= 10
        assert told[-1] == 45


# Not accused -----------------------------------------------------------------------------------------------


async def _twice(m: Plant) -> None:
    """The default first, then another value."""
    while True:
        m.heater.write(0.0)
        m.heater.write(3.0)
        await next_period()


async def _through_others(m: Plant) -> None:
    """It awaits others that write."""
    while True:
        m.heater.write(1.0)
        await warm(m, 2.0)
        await m.cycle.start(warm(m, 3.0))
        m.heater.write(3.5)
        await together(warm(m, 4.0), wait("3 ms"))
        await unless(lambda: False, warm(m, 5.0))


async def _one_after_the_other(m: Plant) -> None:
    """They write when those before have ended."""
    for value in range(1, 5):
        task = m.cycle.start(warm(m, float(value)))
        while not task.done:
            await next_period()


async def _with_a_lock(m: Plant) -> None:
    """They leave what they like, and share a lock."""

    async def work(value: float) -> None:
        while True:
            async with m.lock:
                m.heater.write(value)
                await wait("3 ms")
                m.heater.write(value + 1.0)
            await next_period()

    await together(work(1.0), work(5.0))


async def _with_a_lock_in_one_period(m: Plant) -> None:
    """The lock is handed over in the period in which both write."""

    async def work(value: float) -> None:
        if value == 1.0:
            m.heater.write(0.0)
        while True:
            async with m.lock:
                m.heater.write(value)
                await wait("3 ms")
                m.heater.write(value + 1.0)

    await together(work(1.0), work(5.0))


async def _bring_to_the_default(m: Plant) -> None:
    """Each leaves it at its default."""

    async def work(offset: int) -> None:
        while True:
            if round(m.now * 1000) % 10 == offset:
                m.heater.write(3.0)
                await wait("3 ms")
                m.heater.write(0.0)
            await next_period()

    await together(work(1), work(6))


async def _phases(m: Plant) -> None:
    """A law regulates in a phase of the sequence."""
    while True:
        m.heater.write(3.0)
        await wait("3 ms")
        m.law = heat
        await wait("3 ms")
        m.law = None
        m.heater.write(4.0)
        await wait("2 ms")


async def _at_the_same_value(m: Plant) -> None:
    """What is there already is written once more."""
    m.law = lambda m: m.heater.write(3.0)
    while True:
        m.heater.write(3.0)
        await next_period()


async def _cancelled(m: Plant) -> None:
    """A watch cancels the work, and switches off what it has left on."""
    while True:
        work = m.cycle.start(warm(m, 3.0))
        await wait("3 ms")
        work.cancel()
        m.heater.write(0.0)


async def _laws_in_turns(m: Plant) -> None:
    """Two laws, each in a mode of its own."""
    while True:
        for part in (m.left, m.right):
            part.law = lambda part: m.heater.write(1.0 if part is m.left else 2.0)
            await wait("3 ms")
            part.law = None


async def _reset(m: Plant) -> None:
    """Somebody resets it, then another one writes."""

    async def once(value: float) -> None:
        m.heater.write(value)
        await wait("2 ms")
        m.heater.reset()
        await wait("50 ms")

    m.cycle.start(once(1.0))
    await wait("5 ms")
    m.cycle.start(once(2.0))
    await wait("5 ms")
    m.cycle.start(once(3.0))


async def _interlocked(m: Plant) -> None:
    """An interlock has taken it from the one before."""
    m.cycle.start(_once_and_wait(m, 1.0))
    await wait("3 ms")
    m.hot = True
    await wait("3 ms")
    m.hot = False
    m.heater.write(2.0)
    await wait("3 ms")


async def _once_and_wait(m: Plant, value: float) -> None:
    m.heater.write(value)
    await wait("1 s")


async def _held(m: Plant) -> None:
    """One that is paused does not write; another one does meanwhile."""
    work = m.cycle.start(warm(m, 3.0))
    await wait("3 ms")
    work.paused = True
    m.heater.write(5.0)
    await wait("2 ms")
    work.paused = False
    await wait("5 ms")


@pytest.mark.parametrize(
    "sequence",
    [
        _twice,
        _through_others,
        _one_after_the_other,
        _with_a_lock,
        _with_a_lock_in_one_period,
        _bring_to_the_default,
        _phases,
        _at_the_same_value,
        _cancelled,
        _laws_in_turns,
        _reset,
        _interlocked,
        _held,
    ],
)
def test_who_hands_it_over_is_not_accused(sequence: Any) -> None:
    with running() as rig:
        rig.start(sequence(rig.m))
        periods(rig.m, 60)
        assert rig.told == {}


def test_a_law_that_writes_twice_in_a_period_is_not_accused() -> None:
    def law(m: Plant) -> None:
        m.heater.write(0.0)
        if m.temperature.read() < 50.0:
            m.heater.write(5.0)
        m.heater.write(min(m.heater.pending, 3.0))

    with running() as rig:
        rig.m.law = law
        periods(rig.m, 5)
        assert rig.told == {}


def test_a_servo_and_the_law_that_calls_it_are_one_writer() -> None:
    with running() as rig:
        servo = Servo(rig.m.temperature, rig.m.heater, gain=0.01)

        def law(m: Plant) -> None:
            servo.control(50.0, dt=m.dt)
            if m.now > 0.003:
                m.heater.write(0.0)

        rig.m.law = law
        periods(rig.m, 6)
        assert rig.told == {}


@pytest.mark.parametrize("mode", ["automatic", "manual"])
@pytest.mark.parametrize("call", ["heat", "heat_slowly"])
def test_an_action_of_a_client_and_a_law_are_told(call: str, mode: str) -> None:
    with running() as rig:
        rig.m.law = lambda m: m.heater.write(1.0)
        ann = Operator(rig.m)
        ann.do("lease", seconds=60.0)
        ann.mode(mode)
        ann.run(3)
        assert rig.told == {}
        assert ann.call(call).state in (CommandState.BEGUN, CommandState.DONE)
        ann.run(4)
        both = rf"written by two: action {call} \(\S*{HERE.name}:\d+ in {call}\) and control of Plant \(.*\)"
        assert re.match(rf"{both}; the last value counts\. Let only one of them write it", rig.told["heater"])
        assert rig.m.heater.read() == 1.0


def test_an_action_of_a_client_and_a_sequence_that_writes_in_the_same_period_are_told() -> None:
    with running() as rig:
        ann = Operator(rig.m)
        ann.do("lease", seconds=60.0)
        rig.start(warm(rig.m, 1.0), idle(rig.m))
        ann.run(3)
        ann.call("heat")
        ann.run(3)
        assert "action heat (" in rig.told["heater"]
        assert "sequence warm (" in rig.told["heater"]


async def warm_once(m: Plant) -> None:
    m.heater.write(1.0)
    await wait("1 s")


@pytest.mark.parametrize("by", ["sequence", "law"])
def test_an_action_is_not_accused_if_nothing_else_writes_in_its_period(by: str) -> None:
    with running() as rig:
        ann = Operator(rig.m)
        ann.do("lease", seconds=60.0)
        if by == "sequence":
            rig.start(warm_once(rig.m))
        else:
            rig.m.law = lambda m: m.heater.write(2.0) if m.now < 0.004 else None
        ann.run(8)
        for call in ("heat", "heat_slowly", "heat"):
            ann.call(call)
            ann.run(1)
        ann.run(4)
        if by == "law":
            rig.m.law = lambda m: m.heater.write(3.0)
        ann.run(3)
        assert rig.told == {}


def test_clients_are_not_accused() -> None:
    with running() as rig:
        ann = Operator(rig.m)
        ann.do("lease", seconds=60.0)
        rig.start(warm(rig.m, 1.0), idle(rig.m))
        ann.run(3)
        ann.do("write", "heater", 5.0)
        ann.run(3)
        ann.do("let go", "heater")
        ann.run(3)
        assert rig.told == {}


async def idle(m: Plant) -> None:
    """The machine waits for its end."""
    await wait("1 s")


def test_manual_mode_and_the_way_back_are_not_accused() -> None:
    with running() as rig:
        ann = Operator(rig.m)
        ann.do("lease", seconds=60.0)
        rig.start(warm(rig.m, 1.0), idle(rig.m))
        ann.run(3)
        ann.mode("manual")
        ann.call("heat")
        ann.run(3)
        ann.mode("automatic")
        ann.run(5)
        assert rig.m.heater.read() == 1.0
        assert rig.told == {}


@pytest.fixture
def without_extension(monkeypatch: pytest.MonkeyPatch) -> Iterator[Rig]:
    choose(monkeypatch, "numpy")
    with running() as rig:
        yield rig


async def warm_on(m: Plant, value: float) -> None:
    while True:
        m.heater.write(value)  # warm on
        await next_period()


def test_without_the_extension_two_writers_are_told_in_a_period_that_is_looked_at(without_extension: Rig) -> None:
    rig, asked = without_extension, without_extension.connection.image.restrictions
    rig.m.law = heat
    rig.start(warm_on(rig.m, 3.0))
    periods(rig.m, FIRST - 1)
    assert (rig.told, any(asked)) == ({}, True)  # the asynchronous one is asked for in any case
    periods(rig.m, LOOKED_AT)
    text = rig.told["heater"]
    assert f"{line('warm on')}warm_on) and control of Plant (" in text
    assert f"{line('the law')}heat)" in text
    assert list(rig.told) == ["heater"]
    slot = rig.connection.image.slot_of[id(rig.m.heater)]
    periods(rig.m, 2)
    assert asked[slot] == 0  # its writes go straight into the image again
    periods(rig.m, 2 * OF)
    assert list(rig.told) == ["heater"]


def test_without_the_extension_they_are_found_later_too(without_extension: Rig) -> None:
    rig = without_extension
    rig.m.law = heat
    periods(rig.m, OF - 20)
    rig.start(warm_on(rig.m, 3.0))
    assert rig.told == {}
    periods(rig.m, 20 + FIRST + LOOKED_AT)
    assert list(rig.told) == ["heater"]


def test_without_the_extension_who_writes_alone_or_was_handed_it_over_is_not_accused(without_extension: Rig) -> None:
    async def one_after_the_other(m: Plant) -> None:
        while True:
            await warm(m, 3.0)
            m.heater.write(0.0)
            await m.cycle.start(late(m, 4.0))

    rig = without_extension
    rig.start(one_after_the_other(rig.m))
    pumps = Vector(each.pump for each in (rig.m.left, rig.m.right))
    for number in range(OF + 100):
        assert pumps.write([number % 7.0, 2.0])
        rig.m.valve.write(OnOff.ON if number % 2 else OnOff.OFF)
        periods(rig.m, 1)
    assert pumps.read().tolist() == [(OF + 99) % 7.0, 2.0]
    rig.m.hot = True
    periods(rig.m, 2)
    assert not rig.m.heater.write(1.0)
    assert rig.told == {}
