"""Replays of machines with drivers off the cycle: what arrives is that of the recording, and no worker is needed."""

from __future__ import annotations

from contextlib import suppress
from random import Random
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.flaky import Flaky, loop
from helpers.machines import actuator, bench, relay, sensor, switch, timer, wired
from helpers.tapes import Case
from umo import (
    BinaryActuator,
    BinarySensor,
    Compound,
    DigitalActuator,
    DigitalSensor,
    Quality,
    UmoError,
)
from umo.cycle.journal import Kind
from umo.drivers import DeviceTimeout, DriverError
from umo.errors import ChannelsFailed
from umo.states import OnOff, PassFail
from umo.testing import Scripted, VirtualTimer, periods


class Dozing(Flaky):
    """A circuit that does not answer for a while, now and then."""

    silent = 0

    def _call(self, segment: str, channels: Any = (), raws: Any = ()) -> Any:
        if not self.quiet and self.silent == 0 and self.random.random() < self.share / 4:
            self.silent = self.random.choice([2, 20, 60])
        if self.silent and not self.quiet:
            self.silent -= 1
            raise DeviceTimeout("asleep")
        return super()._call(segment, channels, raws)


class Part(Compound, equipment=True):
    level: DigitalSensor
    drive: DigitalActuator

    def control(self) -> None:
        if not self.cycle.fault:
            self.drive.write(self.level.read() / 10.0)


class Oven(Compound):
    """Objects of every kind on a slow driver, beside a fast one."""

    timer: DigitalSensor
    motor: DigitalActuator
    encoder: DigitalSensor
    heater: DigitalActuator
    temperature: DigitalSensor
    filtered: DigitalSensor
    probe: DigitalSensor
    valve: BinaryActuator[OnOff]
    pump: DigitalActuator
    door: BinarySensor[PassFail]
    part: Part

    def control(self) -> None:
        random = Random(round(self.now * 1000))
        with suppress(UmoError):
            self.act(random)
        with suppress(UmoError):
            self.heater.write(self.temperature.read() / 20.0 + min(self.now - self.temperature.time, 1.0))
        with suppress(UmoError):
            self.motor.write(self.encoder.read() / 20.0 - self.heater.read())

    def act(self, random: Random) -> None:
        what = random.randrange(12)
        if what == 0:
            self.valve.write(random.choice(list(OnOff)))
        elif what == 1:
            self.pump.write(self.probe.read() / 10.0)
        elif what == 2:
            self.part.sample()
        elif what == 3:
            self.part.update()
        elif what == 4:
            self.heater.reset()
        elif what == 5:
            self.pump.reset()
        elif what == 6 and self.part.cycle.fault:
            self.part.cycle.clear()
        elif what == 7:
            self.motor.write(self.filtered.read() / 20.0)


def oven() -> Oven:
    return Oven(
        timer=timer(),
        motor=actuator(limits="clamp"),
        encoder=sensor(on_error="hold", max_age="20 ms"),
        heater=actuator(on_error="retry", max_age="200 ms", slew_rate=50.0, limits="clamp"),
        temperature=sensor(on_error="mark"),
        filtered=sensor(on_error="mark", filter="20 ms"),
        probe=sensor(synchronous=False, on_error="hold", max_age="200 ms"),
        valve=relay(synchronous=False, expires="300 ms"),
        pump=actuator(synchronous=False, on_error="retry", max_age="100 ms"),
        door=switch(on_error="hold", max_age="200 ms"),
        part=Part(level=sensor(), drive=actuator(on_error="retry", max_age="1 s")),
    )


FAST = ("motor", "encoder")


def case(seed: int, share: float, count: int = 900) -> Case:
    def wiring(machine: Any) -> Any:
        random = Random(seed)
        missed = [random.choice([0, 0, 0, 0, 1, 3]) for _ in range(count)]
        box, fast = Dozing(seed, share), Flaky(seed + 1, share)

        def begin(number: int) -> None:
            box.quiet = fast.quiet = number < 3

        entries = {path: {"driver": "fast"} for path in FAST}
        made = wired(machine, Scripted(), clock=VirtualTimer(missed, on_period=begin), entries=entries, fast=fast)
        made["drivers"]["box"] = {"type": box, "off_cycle": True, "period": random.choice(["3 ms", "10 ms", "25 ms"])}
        return made

    return Case(oven, wiring, loop(count))


def check(seed: int, share: float) -> set[int]:
    """The kinds of the journal's entries."""
    each = case(seed, share)
    tape = each.record()
    result = each.replay(tape)
    assert result.identical, str(result)
    assert result.periods == sum(len(block.frames) for block in tape.recorded) > 100
    return {kind for block in tape.recorded for kind in block.entries["kind"].tolist()}


@pytest.mark.full
@settings(max_examples=3)
@given(st.integers(0, 10_000), st.sampled_from([0.0, 0.02, 0.1, 0.4]))
def test_a_replay_repeats_what_a_driver_off_the_cycle_brought(seed: int, share: float) -> None:
    check(seed, share)


@pytest.mark.full
def test_a_replay_repeats_what_other_drivers_off_the_cycle_brought() -> None:
    kinds = set[int]().union(*(check(seed, [0.0, 0.02, 0.1, 0.4][seed % 4]) for seed in range(100)))
    assert {Kind.ARRIVED, Kind.CONFIRMED, Kind.RENEWED, Kind.READ, Kind.WRITE, Kind.FAILED_READ} <= kinds


@pytest.mark.full
def test_another_time_of_a_value_is_noticed() -> None:
    """A test of the test: the control code acts on the age of what has arrived."""
    each = case(1, 0.0)
    tape = each.record()
    for block in tape.recorded:
        arrived = block.entries["kind"] == Kind.ARRIVED
        block.entries["time"][arrived] -= 0.05
    assert not each.replay(tape).identical


# The first sample ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "error",
    [DriverError("dead"), DeviceTimeout("slow"), ChannelsFailed({"encoder": "cut"}), OSError("gone")],
    ids=["driver", "timeout", "channel", "other"],
)
@pytest.mark.parametrize("off_cycle", [False, True])
def test_a_first_sample_that_failed_is_repeated(error: Exception, off_cycle: bool) -> None:
    """The driver is away from the beginning, and a filter begins with what was read first."""

    class First(Scripted):
        left = 3

        def read_many(self, channels: Any, out: Any) -> None:
            if self.left:
                self.left -= 1
                raise error
            super().read_many(channels, out)

    def machine() -> Any:
        return bench(
            encoder=sensor(on_error="mark", filter="5 ms"),
            limit=switch(on_error="mark"),
            motor=actuator(on_error="retry", max_age="1 s"),
            valve=relay(on_error="retry", max_age="1 s"),
        )

    def wiring(machine: Any) -> Any:
        box = First({"encoder": [10, 190, 20, 60] * 500})
        made = wired(machine, box)
        if off_cycle:
            made["drivers"]["box"] = {"type": box, "off_cycle": True, "period": "5 ms"}
        return made

    def run(m: Any) -> None:
        for _ in range(300):
            m.motor.write(m.encoder.read() / 20.0 if m.encoder.quality is Quality.GOOD else -1.0)
            periods(m)

    each = Case(machine, wiring, run)
    tape = each.record()
    result = each.replay(tape)
    assert result.identical and result.periods == 300, str(result)
