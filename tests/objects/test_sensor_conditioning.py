"""Conditioning of sensors: rollover, filter, velocity, debounce."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from itertools import accumulate
from math import exp
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from helpers.machines import actuator, bench, sensor, switch, timer, wired
from helpers.tiers import budget
from umo import Compound, DigitalActuator, DigitalSensor, Quality, connect, published
from umo.cycle.image import Image
from umo.drivers import Channel
from umo.errors import BadInput, ChannelsFailed, DeclarationError, DriverError
from umo.process.frames import Reader
from umo.states import PassFail
from umo.testing import Scripted, VirtualTimer, periods
from umo.wiring import check, resolve


def counter(**changes: Any) -> DigitalSensor:
    whole = {"minimum": -1e9, "maximum": 1e9, "resolution": 0.5, "rollover": 16}
    return DigitalSensor("mm", **whole | changes)


def follow(machine: Any, box: Scripted, raws: list[int], clock: VirtualTimer | None = None) -> list[float]:
    """The values of the encoder for these raw integers, one in each period."""
    found = []
    with connect(machine, wired(machine, box, clock=clock)) as m:
        for raw in raws:
            box.set("encoder", raw)
            periods(m)
            found.append(m.encoder.read())
            assert m.encoder.raw == raw
    return found


# Rollover --------------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("each_way")
@pytest.mark.parametrize("synchronous", [True, False])
@given(steps=st.lists(st.integers(-(2**15) + 1, 2**15 - 1), max_size=30), first=st.integers(0, 2**15))
@budget(12, 30)
def test_a_counter_counts_on_for_every_way_of_steps_below_half_its_numbers(
    synchronous: bool, steps: list[int], first: int
) -> None:
    counts = list(accumulate([first, *steps]))
    box = Scripted()
    box.set("encoder", first)
    found = follow(bench(encoder=counter(synchronous=synchronous)), box, [count % 2**16 for count in counts])
    assert found == [0.5 * count for count in counts]


def test_the_wiring_may_say_that_a_counter_rolls_over_and_with_how_many_bits() -> None:
    machine, box = bench(encoder=counter(rollover=False, minimum=-1000.0, maximum=1000.0)), Scripted()
    wiring = wired(machine, box, entries={"encoder": {"rollover": 8}})
    box.set("encoder", 250)
    with connect(machine, wiring) as m:
        box.set("encoder", 4)
        periods(m)
        assert m.encoder.read() == 130.0  # 260 counts


@pytest.mark.parametrize(("bits", "rolls_over"), [(16, 16), (32, 32), (64, 0)])
def test_true_stands_for_the_bits_of_the_channel(bits: int, rolls_over: int) -> None:
    class Narrow(Scripted):
        def channel(self, text: str) -> Channel:
            return replace(super().channel(text), bits=bits)

    machine = bench(encoder=counter(rollover=True))
    (wire,) = [wire for wire in resolve(machine, wired(machine, Narrow())).wires if wire.item is machine.encoder]
    assert wire.rollover_bits == rolls_over


@pytest.mark.parametrize(
    ("path", "rollover", "text"),
    [
        ("encoder", 80, "80 is not the number of a counter's bits, 2 to 62"),
        ("motor", 16, "is for sensors; this is an actuator"),
        ("limit", 16, "is for digital objects; this one is binary"),
    ],
)
def test_a_rollover_that_cannot_be_is_a_mistake(path: str, rollover: int, text: str) -> None:
    machine = bench()
    (found,) = check(machine, wired(machine, Scripted(), entries={path: {"rollover": rollover}}))
    assert (found.key, found.message) == (f'wire."{path}".rollover', text)


def test_a_reading_that_failed_counts_no_turn() -> None:
    machine, box = bench(encoder=counter(invalid_raws=[0x7FFF], on_error="mark")), Scripted()
    box.set("encoder", 65000)
    assert follow(machine, box, [65000, 0x7FFF, 65100, 0x7FFF, 100]) == [32500.0, 32500.0, 32550.0, 32550.0, 32818.0]


def test_homing_gives_a_counter_its_place_and_it_counts_on_from_there() -> None:
    machine, box = bench(encoder=counter(incremental=True, filter="5 ms", velocity=0.0)), Scripted()
    box.set("encoder", 65535)
    with connect(machine, wired(machine, box)) as m:
        periods(m)
        m.encoder.referenced(at=10.0)
        assert m.encoder.read() == 10.0
        periods(m)
        assert (m.encoder.read(), m.encoder.velocity) == (10.0, 0.0)
        box.set("encoder", 1)
        periods(m, 200)
        assert m.encoder.read() == pytest.approx(11.0)


# Filter and velocity ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("synchronous", [True, False])
@given(missed=st.lists(st.sampled_from([0, 0, 1, 2, 5]), min_size=10, max_size=40))
@budget(12, 30)
def test_a_filter_answers_a_step_as_its_time_constant_says_whatever_ticks_are_missed(
    synchronous: bool, missed: list[int]
) -> None:
    machine, box = bench(encoder=sensor(filter="20 ms", synchronous=synchronous)), Scripted()
    with connect(machine, wired(machine, box, clock=VirtualTimer(missed=[0, *missed]))) as m:
        periods(m)
        begun = m.encoder.read() * 0.0 + m.now
        box.set("encoder", 100)
        for _ in missed:
            periods(m)
            assert m.encoder.read() == pytest.approx(50.0 * (1 - exp(-(m.now - begun) / 0.02)))


def test_the_velocity_of_a_ramp_is_its_slope_and_is_recorded() -> None:
    box = Scripted()
    machine = bench(encoder=sensor(velocity="5 ms", filter="50 ms"))
    connection = connect(machine, wired(machine, box, clock=VirtualTimer(missed=[0] * 40 + [3, 0, 7, 2])))
    with connection as m, published(connection, "ramp") as ring, Reader(ring.path) as reader:
        for _ in range(80):
            m.timer.read()
            box.set("encoder", round(m.now * 1000))
            m.sample()
            m.control()
            m.update()
        assert m.encoder.velocity == pytest.approx(500.0, rel=1e-3)
        (signal,) = [each for each in reader.layout.signals if each["path"] == "encoder.velocity"]
        assert signal["unit"] == "mm/s"
        at = reader.layout.signals.index(signal)
        assert reader.read()["signals"][-1][at] == m.encoder.velocity


def test_a_velocity_goes_on_over_a_rollover() -> None:
    machine, box = bench(encoder=counter(velocity=0.0)), Scripted()
    box.set("encoder", 65534)
    with connect(machine, wired(machine, box)) as m:
        for raw in (65535, 0, 1):
            box.set("encoder", raw)
            periods(m)
            assert m.encoder.velocity == pytest.approx(500.0)


def test_a_failed_reading_does_not_reach_the_filter() -> None:
    class Gone(Scripted):
        gone = False

        def read_many(self, channels: Any, raws: Any) -> None:
            if self.gone:
                raise DriverError("gone")
            super().read_many(channels, raws)

    machine, box = (
        bench(encoder=sensor(filter="20 ms", on_error="hold", max_age="1 s"), limit=switch(on_error="mark")),
        Gone(),
    )
    with connect(machine, wired(machine, box)) as m:
        periods(m)
        box.set("encoder", 100)
        box.gone = True
        periods(m, 10)
        assert m.encoder.read() == 0.0
        box.gone = False
        periods(m)
        assert m.encoder.read() == pytest.approx(50.0 * (1 - exp(-0.011 / 0.02)))


def test_a_reading_out_of_range_is_shown_as_it_is_and_the_filter_begins_anew() -> None:
    machine, box = bench(encoder=sensor(filter="1 s")), Scripted()
    assert follow(machine, box, [0, 100, 400, 100])[2:] == [200.0, 50.0]


def test_a_filter_of_a_slow_part_uses_the_time_between_its_own_readings() -> None:
    class Slow(Compound, every=10):
        level: DigitalSensor
        valve: DigitalActuator

    class Machine(Compound):
        timer: DigitalSensor
        slow: Slow

    machine = Machine(timer=timer(), slow=Slow(level=sensor(filter="20 ms"), valve=actuator()))
    box = Scripted()
    with connect(machine, wired(machine, box)) as m:
        periods(m, 20)
        box.set("slow.level", 100)
        periods(m, 20)
        assert m.slow.level.read() == pytest.approx(50.0 * (1 - exp(-1.0)))


def test_off_the_cycle_the_time_between_two_readings_is_that_of_their_transfers() -> None:
    machine, box = bench(encoder=sensor(velocity=0.0, filter="20 ms", on_error="mark")), Scripted()
    slow = {"type": box, "off_cycle": True, "period": "10 ms"}
    with connect(machine, wired(machine, Scripted(), entries={"encoder": {"driver": "slow"}}, slow=slow)) as m:
        found = set()
        for number in range(100):
            box.set("encoder", number)
            periods(m)
            if number > 30:
                found.add(round(m.encoder.velocity, 6))
        assert found == {500.0}  # half a millimetre in each millisecond


def test_a_sensor_without_velocity_says_so() -> None:
    machine = bench()
    with connect(machine, wired(machine, Scripted())) as m, pytest.raises(DeclarationError, match="without `velocity`"):
        m.encoder.velocity  # noqa: B018


@pytest.mark.parametrize("name", ["filter", "velocity"])
@pytest.mark.parametrize("value", ["-1 ms", -1.0, "soon", float("nan"), float("inf")])
def test_a_time_that_is_none_is_refused(name: str, value: Any) -> None:
    with pytest.raises(DeclarationError):
        sensor(**{name: value})


@pytest.mark.parametrize("bits", [0, 1, 63, -16, "16"])
def test_a_counter_has_2_to_62_bits(bits: Any) -> None:
    with pytest.raises(DeclarationError, match="not the number of a counter's bits, 2 to 62"):
        sensor(rollover=bits)


# Debounce --------------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("each_way")
@pytest.mark.parametrize("synchronous", [True, False])
@given(levels=st.lists(st.integers(0, 1), max_size=60))
@budget(15, 40)
def test_a_state_changes_when_the_input_has_differed_for_the_time(synchronous: bool, levels: list[int]) -> None:
    machine, box = bench(limit=switch(debounce="3 ms", synchronous=synchronous)), Scripted()
    with connect(machine, wired(machine, box)) as m:
        state, since = 0, None
        m.limit.read()
        for number, level in enumerate(levels, 1):
            box.set("limit", level)
            periods(m)
            since = (since or number) if level != state else None
            if since is not None and number - since >= 3:
                state, since = level, None
            assert m.limit.read() is (PassFail.FAIL if state else PassFail.PASS)
            assert m.limit.raw == level


def test_a_machine_without_conditioning_has_the_plain_conversion() -> None:
    machine = bench()
    connection = connect(machine, wired(machine, Scripted()))
    with connection:
        image: Image = connection.image
        assert not image.conditioners
        assert all(block.conditioned is None for block in image.inputs)


# The same by every way of reading ------------------------------------------------------------------------


class Partly(Scripted):
    """One channel of its block cannot be read."""

    def read_many(self, channels: Any, out: Any) -> None:
        super().read_many(channels, out)
        raise ChannelsFailed({"limit": "broken"})


@pytest.mark.parametrize("way", ["block", "alone", "beside one that failed"])
def test_a_value_out_of_range_is_not_hidden_by_the_filter_however_it_is_read(way: str) -> None:
    encoder = sensor(minimum=0.0, maximum=100.0, filter="1 s", synchronous=way != "alone")
    machine = bench(encoder=encoder, limit=switch(on_error="mark"))
    box = Partly() if way.startswith("beside") else Scripted()
    with connect(machine, wired(machine, box)) as m:
        periods(m, 3)
        box.set("encoder", 1000)
        periods(m)
        assert m.encoder.read() == 500.0
        assert m.encoder.quality is Quality.OUT_OF_RANGE
        box.set("encoder", 100)
        periods(m)
        assert (m.encoder.read(), m.encoder.quality) == (50.0, Quality.GOOD)  # the filter begins anew


def test_a_counter_without_a_filter_is_never_older_than_its_reading() -> None:
    machine, box = bench(encoder=counter(synchronous=False)), Scripted()
    with connect(machine, wired(machine, box)) as m:
        periods(m)
        found = []
        for raw in (10, 20, 30):
            box.set("encoder", raw)
            found.append((m.encoder.read(), m.encoder.raw))
    assert found == [(5.0, 10), (10.0, 20), (15.0, 30)]


def test_without_a_timer_an_asynchronous_sensor_is_conditioned_by_the_time_that_passes() -> None:
    class Hand(Compound):
        encoder: DigitalSensor

    machine, box = Hand(encoder=sensor(filter="1 s", synchronous=False)), Scripted()
    times = iter(range(100))
    connection = connect(machine, wired(machine, box))
    with connection as m:
        connection.machine.clock._source = lambda: float(next(times))  # type: ignore[attr-defined]
        m.encoder.read()
        box.set("encoder", 100)
        found = [m.encoder.read() for _ in range(5)]
    assert found == sorted(found)
    assert found[0] < found[-1]


def test_a_reference_at_speed_does_not_take_the_lag_of_the_filter_for_the_place() -> None:
    encoder = DigitalSensor("mm", minimum=-1e6, maximum=1e6, resolution=0.01, filter="20 ms", incremental=True)
    machine, box = bench(encoder=encoder), Scripted()
    with connect(machine, wired(machine, box)) as m:
        for raw in range(0, 10_001, 10):  # 0.1 mm in 1 ms
            box.set("encoder", raw)
            periods(m)
        m.encoder.referenced(at=0.0)
        periods(m, 400)  # it stands where it was referenced
        assert m.encoder.read() == pytest.approx(0.0, abs=0.01)


def test_a_reference_at_standstill_gives_no_velocity() -> None:
    encoder = DigitalSensor("mm", minimum=-1e6, maximum=1e6, resolution=0.66, velocity="0 s", incremental=True)
    machine, box = bench(encoder=encoder), Scripted()
    box.set("encoder", 1000)
    with connect(machine, wired(machine, box)) as m:
        periods(m, 5)
        m.encoder.referenced(at=0.33)
        periods(m)
        assert m.encoder.velocity == pytest.approx(0.0, abs=1e-6)


def test_equipment_that_is_cleared_counts_anew() -> None:
    class Line(Compound, equipment=True):
        encoder: DigitalSensor

    class Site(Compound):
        timer: DigitalSensor
        line: Line

    machine, box = Site(timer=timer(), line=Line(encoder=counter())), Scripted()
    box.set("line.encoder", 65_000)
    with connect(machine, wired(machine, box)) as m:
        periods(m, 2)
        box.broken = OSError("gone")
        periods(m, 2)
        box.broken = None
        box.set("line.encoder", 0)
        periods(m)
        m.line.cycle.clear()
        periods(m)
        assert m.line.encoder.read() == 0.0


def test_a_velocity_does_not_outlive_its_sensor() -> None:
    machine, box = bench(encoder=counter(velocity="0 s", on_error="mark")), Scripted()
    with connect(machine, wired(machine, box)) as m:
        for raw in (0, 10, 20):
            box.set("encoder", raw)
            periods(m)
        assert m.encoder.velocity == pytest.approx(5000.0)
        box.broken = OSError("gone")
        with suppress(DriverError):
            periods(m)
        with pytest.raises(BadInput):
            _ = m.encoder.velocity
        box.broken = None
