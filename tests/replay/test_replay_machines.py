"""Replays of small machines: whatever a program and its devices do, a replay repeats it to the bit."""

from __future__ import annotations

from contextlib import suppress
from random import Random
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.machines import actuator, bench, relay, sensor, switch, timer, wired
from helpers.operator import Operator
from helpers.tapes import Case, listen, taped
from umo import BinaryActuator, BinarySensor, Compound, DigitalActuator, DigitalSensor, UmoError, action, connect
from umo.cycle.client_commands import Mode
from umo.errors import ChannelsFailed, DeviceTimeout, DriverError
from umo.replay.tape import NotReplayable
from umo.states import OnOff, PassFail
from umo.testing import Scripted, VirtualTimer, periods


class Flaky(Scripted):
    """A circuit whose readings are random, and whose calls fail at random."""

    def __init__(self, seed: int, share: float = 0.1) -> None:
        super().__init__()
        self.random, self.share, self.quiet = Random(seed), share, True

    def _call(self, segment: str, channels: Any = (), raws: Any = ()) -> Any:
        random = self.random
        if not self.quiet and random.random() < self.share:
            failed = random.sample([channel.text for channel in channels], min(len(channels), 1))
            raise random.choice(
                [DriverError("dead"), DeviceTimeout("slow"), ChannelsFailed(dict.fromkeys(failed, "cut")), OSError("off")]
            )
        return super()._call(segment, channels, raws)

    def _reading(self, channel: Any, replaced: Any) -> Any:
        return self.random.randrange(2 if channel.text.endswith(("limit", "door")) else 250)

    def look(self) -> bool | None:
        return self.random.choice([True, False, None])


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
            with suppress(DriverError):
                self.act(random)
        self.motor.write(self.encoder.value_or(0.0) / 20.0 if hasattr(self.encoder, "value_or") else 0.0)

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


def loop(count: int) -> Any:
    def run(m: Any) -> None:
        for number in range(count):
            if number == 3:
                for driver in m._machine_drivers if hasattr(m, "_machine_drivers") else ():
                    driver.quiet = False
            periods(m)

    return run


def case(seed: int, share: float, count: int = 300, **process: Any) -> Case:
    def wiring(machine: Any) -> Any:
        random = Random(seed)
        missed = [random.choice([0, 0, 0, 0, 1, 3]) for _ in range(count)]
        box, other = Flaky(seed, share), Flaky(seed + 1, share)

        def begin(number: int) -> None:
            box.quiet = other.quiet = number < 3

        entries = {path: {"driver": "other"} for path in ("unit.level", "unit.valve", "held", "heater")}
        clock = VirtualTimer(missed, on_period=begin)
        return wired(machine, box, clock=clock, entries=entries, other=other) | ({"process": process} if process else {})

    return Case(restless, wiring, loop(count))


@settings(max_examples=int(__import__("os").environ.get("N","15")))
@given(st.integers(0, 10_000), st.sampled_from([0.0, 0.01, 0.1, 0.4]), st.booleans())
def test_a_replay_repeats_a_machine_whose_devices_fail_at_random(seed: int, share: float, later: bool) -> None:
    each = case(seed, share, **({"outputs": "at next tick"} if later else {}))
    tape = each.record()
    result = each.replay(tape)
    assert result.identical, str(result)
    assert result.periods == sum(len(block.frames) for block in tape.recorded)
