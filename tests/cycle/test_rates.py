"""Parts of a machine at rates of their own: `every`."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.machines import actuator, relay, sensor, switch, timer, wired
from helpers.operator import Operator
from umo import (
    BinaryActuator,
    BinarySensor,
    Compound,
    DigitalActuator,
    DigitalSensor,
    Interlock,
    connect,
    published,
)
from umo.control import next_period, state_of, until, wait
from umo.cycle.phase_times import PhaseTimes
from umo.errors import DeclarationError, DriverError
from umo.operation.commands.client_commands import Mode
from umo.process.frames import Reader
from umo.states import OnOff, PassFail
from umo.testing import Scripted, VirtualTimer, periods
from umo.wiring import check
from umo.wiring.rates import RateMap, rates_of


class Unit(Compound):
    """A sensor, an actuator, and notes of what happens."""

    level: DigitalSensor
    valve: DigitalActuator

    def setup(self) -> None:
        self.acted: list[float] = []
        self.steps: list[float] = []
        self.seen: list[float] = []

    def control(self) -> None:
        self.acted.append(self.now)
        self.steps.append(self.dt)
        self.seen.append(self.level.read())
        self.valve.write(self.level.read() / 10.0)


class Middle(Unit, every=10):
    pass


class Slow(Unit, every="1 s"):
    pass


def unit(kind: type[Unit] = Unit, **changes: Any) -> Unit:
    return kind(level=sensor(**changes), valve=actuator())


class Plant(Compound):
    timer: DigitalSensor
    fast: Unit
    middle: Middle
    slow: Slow


def plant(kind: type[Plant] = Plant) -> Any:
    return kind(timer=timer(), fast=unit(), middle=unit(Middle), slow=unit(Slow))


def moved(box: Scripted, segment: str, channel: str) -> int:
    return sum(channel in call.channels for call in box.segments(segment))


# Each at its own -------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("each_way")
def test_each_part_is_sampled_controlled_and_updated_at_its_own_rate() -> None:
    machine, box = plant(), Scripted()
    with connect(machine, wired(machine, box)) as m:
        box.calls.clear()
        periods(m, 2000)
        for path, count in (("fast", 2000), ("middle", 200), ("slow", 2)):
            part = getattr(m, path)
            assert len(part.acted) == count
            assert moved(box, "read_many", f"{path}.level") == count
            assert moved(box, "write_many", f"{path}.valve") == count


def test_dt_is_the_exact_time_since_the_last_period_of_the_part() -> None:
    machine = plant()
    with connect(machine, wired(machine, Scripted())) as m:
        periods(m, 3000)
        assert set(m.fast.steps) == {0.001}
        assert set(m.middle.steps[1:]) == {10 * 0.001}
        assert set(m.slow.steps[1:]) == {1000 * 0.001}
        assert (m.cycle.period, m.fast.cycle.period, m.middle.cycle.period, m.slow.cycle.period) == (
            0.001, 0.001, 0.01, 1.0,
        )  # fmt: skip


@given(missed=st.lists(st.sampled_from([0, 0, 0, 1, 2, 3, 7, 12, 25]), min_size=20, max_size=80))
@settings(max_examples=60, deadline=None)
def test_after_missed_ticks_a_part_runs_late_once_and_its_grid_stays(missed: list[int]) -> None:
    machine = plant()
    with (connection := connect(machine, wired(machine, Scripted(), clock=VirtualTimer(missed=missed)))) as m:
        clock, number, due = connection.machine.clock, 0, []
        phase = next(part.phase for part in connection.machine.groups.parts if part.path == "middle")
        for _ in missed:
            periods(m)
            begun = clock.number
            if any(each % 10 == phase for each in range(number + 1, begun + 1)):
                due.append(begun)
            number = begun
        assert m.middle.acted == [each * clock.period for each in due]
        assert m.middle.steps == [(b - a) * clock.period for a, b in pairwise([0, *due])]


def test_a_part_with_several_of_its_periods_missed_counts_its_own_ticks() -> None:
    class Counting(Middle):
        def control(self) -> None:
            clock = self._machine.clock
            self.acted.append(clock.ticks)

    machine = plant()
    machine = Plant(timer=timer(), fast=unit(), middle=unit(Counting), slow=unit(Slow))
    with (connection := connect(machine, wired(machine, Scripted(), clock=VirtualTimer(missed=[0] * 10 + [35])))) as m:
        periods(m, 11)
        phase = connection.machine.groups.parts[0].phase
        assert sum(m.middle.acted) == sum(each % 10 == phase for each in range(1, 46))


def test_the_fast_outputs_are_sent_before_a_slow_part_is_sampled_and_computes() -> None:
    order: list[str] = []

    class Fast(Unit):
        def control(self) -> None:
            order.append("fast")

    class Second(Unit, every=2):
        def control(self) -> None:
            order.append("slow")

    class Pair(Compound):
        timer: DigitalSensor
        slow: Second
        fast: Fast

    class Noting(Scripted):
        def read_many(self, channels: Any, raws: Any) -> None:
            order.append(f"read {channels[0].text}")
            super().read_many(channels, raws)

        def write_many(self, channels: Any, raws: Any) -> None:
            order.append(f"write {channels[0].text}")
            super().write_many(channels, raws)

    machine = Pair(timer=timer(), slow=unit(Second), fast=unit(Fast))  # type: ignore[arg-type]
    with connect(machine, wired(machine, Noting())) as m:
        periods(m)
        order.clear()
        periods(m)
        assert order == [
            "read fast.level", "fast", "write fast.valve", "read slow.level", "slow", "write slow.valve",
        ]  # fmt: skip


def test_a_part_within_a_slow_one_may_be_faster_and_one_of_the_same_rate_belongs_to_it() -> None:
    class Inner(Unit, every=1):
        pass

    class Same(Unit, every=4):
        pass

    class Oven(Compound, every=4):
        inner: Inner
        same: Same
        plain: Unit

    class Machine(Compound):
        timer: DigitalSensor
        oven: Oven

    oven = Oven(inner=unit(Inner), same=unit(Same), plain=unit())  # type: ignore[arg-type]
    machine = Machine(timer=timer(), oven=oven)
    with connect(machine, wired(machine, Scripted())) as m:
        periods(m, 12)
        assert [len(each.acted) for each in (oven.inner, oven.same, oven.plain)] == [12, 3, 3]
        assert oven.same.acted == oven.plain.acted
        assert (oven.inner.cycle.period, oven.inner.dt) == (0.001, 0.001)


def test_on_the_machine_itself_every_has_no_effect() -> None:
    class Alone(Unit, every=10):
        timer: DigitalSensor

    machine = Alone(timer=timer(), level=sensor(), valve=actuator())
    with connect(machine, wired(machine, Scripted())) as m:
        periods(m, 5)
        assert (len(m.acted), m.dt) == (5, 0.001)


def test_a_slew_rate_of_a_slow_part_counts_the_time_of_its_own_periods() -> None:
    class Ramped(Compound, every=10):
        valve: DigitalActuator

        def control(self) -> None:
            self.valve.write(10.0)

    class Machine(Compound):
        timer: DigitalSensor
        ramped: Ramped

    machine = Machine(timer=timer(), ramped=Ramped(valve=actuator(slew_rate=100.0)))
    box = Scripted()
    with (connection := connect(machine, wired(machine, box))) as m:
        first = connection.machine.groups.parts[0].phase or 10
        periods(m, first)
        sent = [m.ramped.valve.read()]
        for _ in range(3):
            periods(m, 10)
            sent.append(m.ramped.valve.read())
        assert [b - a for a, b in pairwise(sent)] == pytest.approx([1.0, 1.0, 1.0])


def test_with_outputs_at_the_next_tick_a_slow_part_is_sent_at_once() -> None:
    machine, box = plant(), Scripted()
    wiring = wired(machine, box) | {"process": {"outputs": "at next tick"}}
    with connect(machine, wiring) as m:
        periods(m, 1000)
        assert (len(m.middle.acted), len(m.slow.acted)) == (100, 1)
        assert moved(box, "write_many", "middle.valve") == 100


def test_a_machine_without_a_timer_counts_its_samplings() -> None:
    class Quiet(Compound):
        fast: Unit
        middle: Middle

    machine = Quiet(fast=unit(), middle=unit(Middle))  # type: ignore[arg-type]
    wiring = wired(machine, Scripted())
    del wiring["drivers"]["clock"]
    with connect(machine, wiring) as m:
        for _ in range(20):
            m.sample()
            m.control()
            m.update()
        assert (len(m.fast.acted), len(m.middle.acted)) == (20, 2)
        assert m.middle.steps[1] == pytest.approx(m.middle.acted[1] - m.middle.acted[0])


def test_a_program_that_only_samples_reads_the_slow_parts_too() -> None:
    machine, box = plant(), Scripted()
    with connect(machine, wired(machine, box)) as m:
        periods(m, 2)
        box.set("slow.level", 100)
        for _ in range(2):
            m.timer.read()
            m.sample()
        assert m.slow.level.read() == 50.0


# Sequences -------------------------------------------------------------------------------------------------


def test_a_sequence_of_a_part_takes_its_steps_in_its_periods() -> None:
    machine = plant()
    found = []

    async def steps(part: Compound) -> None:
        while True:
            tick = await next_period()
            found.append((tick.ticks, tick.period, tick.dt, part.dt))

    with connect(machine, wired(machine, Scripted())) as m:
        m.middle.cycle.start(steps(m.middle))
        periods(m, 100)
        assert len(found) in (9, 10)
        assert set(found[1:]) == {(1, 0.01, 0.01, 0.01)}


def test_dt_in_a_sequence_is_the_time_of_its_own_steps_whoever_it_belongs_to() -> None:
    machine = plant()
    found: dict[str, float] = {"of the machine": 0.0, "of the part": 0.0}

    async def sum_up(key: str, part: Compound) -> None:
        while True:
            await next_period()
            found[key] += part.dt

    with connect(machine, wired(machine, Scripted())) as m:
        m.cycle.start(sum_up("of the machine", m.middle))
        m.middle.cycle.start(sum_up("of the part", m))
        periods(m, 101)
        assert found["of the machine"] == pytest.approx(0.1)
        assert found["of the part"] == pytest.approx(0.1, abs=0.0101)


@pytest.mark.parametrize("owner", ["", "middle", "slow"])
def test_a_wait_lasts_its_time_at_every_rate(owner: str) -> None:
    machine = plant()
    ended: list[float] = []

    async def waits() -> None:
        await next_period()
        begun = machine.now
        await wait("2 s")
        await until(lambda: True)
        ended.append(machine.now - begun)

    with connect(machine, wired(machine, Scripted())) as m:
        (getattr(m, owner) if owner else m).cycle.start(waits())
        periods(m, 4000)
        assert ended == [pytest.approx(2.0)]


def test_a_sequence_of_a_slow_part_that_fails_ends_the_run_from_update() -> None:
    machine = plant()

    async def fails() -> None:
        await next_period()
        raise ValueError("broken")

    with pytest.raises(ValueError, match="broken"), connect(machine, wired(machine, Scripted())) as m:
        m.slow.cycle.start(fails())
        periods(m, 3000)


# Guards, equipment, manual mode, failures --------------------------------------------------------------------


def test_an_interlock_on_a_slow_sensor_acts_in_the_period_in_which_it_was_read() -> None:
    class Door(Compound, every=10):
        door: BinarySensor[PassFail]
        lamp: BinaryActuator[OnOff]

        def interlocks(self) -> Any:
            yield Interlock(lambda: state_of(self.door) is PassFail.FAIL, [self.lamp], "the door is open")

        def control(self) -> None:
            self.lamp.write(OnOff.ON)

    class Machine(Compound):
        timer: DigitalSensor
        cell: Door

    machine, box = Machine(timer=timer(), cell=Door(door=switch(), lamp=relay())), Scripted()
    with connect(machine, wired(machine, box)) as m:
        periods(m, 20)
        assert m.cell.lamp.read() is OnOff.ON
        box.set("cell.door", 1)
        for _ in range(10):
            periods(m)
            assert (m.cell.door.read() is PassFail.FAIL) == (m.cell.lamp.read() is OnOff.OFF)
        assert m.cell.lamp.read() is OnOff.OFF


def test_equipment_of_a_slow_part_fails_alone_and_is_cleared() -> None:
    class Fragile(Unit, every=10, equipment=True):
        broken = False

        def control(self) -> None:
            super().control()
            if self.broken:
                raise ValueError("broken")

    class Machine(Compound):
        timer: DigitalSensor
        fast: Unit
        fragile: Fragile

    machine, box = Machine(timer=timer(), fast=unit(), fragile=unit(Fragile)), Scripted()  # type: ignore[arg-type]
    box.set("fragile.level", 100)
    with connect(machine, wired(machine, box)) as m:
        periods(m, 20)
        assert m.fragile.valve.read() == 5.0
        m.fragile.broken = True
        periods(m, 20)
        assert m.fragile.cycle.fault is not None
        assert m.fragile.valve.read() == 0.0
        acted, m.fragile.broken = len(m.fragile.acted), False
        periods(m, 20)
        assert (len(m.fragile.acted), len(m.fast.acted)) == (acted, 60)
        m.fragile.cycle.clear()
        periods(m, 20)
        assert len(m.fragile.acted) == acted + 2
        assert m.fragile.valve.read() == 5.0


def test_a_sensor_of_a_slow_part_that_fails_is_told_in_its_period() -> None:
    class Gone(Scripted):
        gone = False

        def read_many(self, channels: Any, raws: Any) -> None:
            if self.gone and any("slow" in channel.text for channel in channels):
                raise DriverError("gone")
            super().read_many(channels, raws)

    machine, box = plant(), Gone()
    with pytest.raises(DriverError, match=r"slow\.level"), connect(machine, wired(machine, box)) as m:
        periods(m, 500)
        box.gone = True
        periods(m, 499)
        assert len(m.fast.acted) == 999
        periods(m, 1000)


def test_in_the_change_to_manual_mode_what_a_slow_law_writes_stays() -> None:
    class Machine(Plant):
        def control(self) -> None:
            pass

    machine, box = plant(Machine), Scripted()
    box.set("slow.level", 100)
    with connect(machine, wired(machine, box)) as m:
        ann = Operator(m)
        ann.do("lease", seconds=60.0)
        ann.run(1500)
        assert m.slow.valve.read() == 5.0
        acted = len(m.slow.acted)
        ann.do("mode", value="manual")
        ann.run(10)
        assert m.slow.valve.read() == 5.0
        assert len(m.slow.acted) == acted + 1  # the laws act once more
        assert sum(m.slow.steps) == pytest.approx(m.slow.acted[-1])
        assert ann.clients.mode is Mode.MANUAL


# Declared, checked, shown ------------------------------------------------------------------------------------


@pytest.mark.parametrize("value", [0, -1, 1.5, True, "fast", "0 s"])
def test_every_is_a_number_of_periods_or_a_duration(value: Any) -> None:
    with pytest.raises(DeclarationError, match="every is a number of periods"):
        type("Wrong", (Compound,), {}, every=value)


def mistakes(machine: Compound, period: str) -> list[str]:
    wiring = wired(machine, Scripted(), entries={"timer": {"period": period}})
    return [str(each) for each in check(machine, wiring)]


def test_a_duration_that_is_no_multiple_of_the_period_is_a_mistake_that_names_the_nearest() -> None:
    assert mistakes(plant(), "1 ms") == []
    (found,) = mistakes(plant(), "300 ms")
    assert "`every` of slow, 1 s, is not a multiple of 300 ms; the nearest: 900 ms and 1.2 s" in found


def test_what_must_outlast_a_period_must_outlast_that_of_its_part() -> None:
    machine = Plant(
        timer=timer(),
        fast=unit(),
        middle=Middle(level=sensor(on_error="hold", max_age="5 ms"), valve=actuator(expires="8 ms")),
        slow=unit(Slow),
    )
    found = mistakes(machine, "1 ms")
    assert any("10 ms, 10 times the period, is longer than `max_age` of middle.level (5 ms)" in each for each in found)
    assert any("is not shorter than `expires` of middle.valve (8 ms)" in each for each in found)


def test_a_watchdog_must_be_longer_than_the_period_of_the_fastest_outputs_that_feed_it() -> None:
    class Watched(Scripted):
        def watchdog(self, seconds: float) -> None:
            pass

    machine = plant()
    wire = {"middle.valve": {"driver": "slow"}, "slow.valve": {"driver": "slow"}, "fast.level": {"driver": "slow"}}
    for limit, wrong in (("10 ms", True), ("11 ms", False)):
        wiring = wired(machine, Scripted(), entries=wire, slow={"type": Watched(), "watchdog": limit})
        found = [str(each) for each in check(machine, wiring)]
        assert bool(found) is wrong, found
        assert not wrong or "10 ms is not longer than the period, 10 ms" in found[0]


def test_phases_are_spread_so_that_parts_do_not_meet() -> None:
    class Rack(Compound):
        timer: DigitalSensor
        tens: list[Middle]
        slow: list[Slow]

    machine = Rack(timer=timer(), tens=[unit(Middle) for _ in range(6)], slow=[unit(Slow) for _ in range(40)])
    rates = rates_of(machine, 0.001, pytest.fail)
    load = [sum((number - rate.phase) % rate.every == 0 for rate in rates) for number in range(1000)]
    assert max(load) == 1
    assert RateMap(rates).every(machine.slow[3].valve) == 1000
    assert rates == rates_of(machine, 0.001, pytest.fail)


def test_a_slow_part_has_phases_of_its_own_in_the_periods_in_which_it_acts() -> None:
    machine, box, clock = plant(), Scripted(), VirtualTimer()
    with (connection := connect(machine, wired(machine, box, clock=clock))) as m:
        whole = connection.machine
        phases = PhaseTimes(whole.image, {"box": box, "clock": clock}, whole.groups.parts)
        mine = ["sample box for middle", "update box for middle", "control middle"]
        taken: list[list[bool]] = []
        for _ in range(100):
            periods(m)
            taken.append([phases.ns[phases.names.index(name)] > 0 for name in mine])
            phases.clear()
        phases.remove()
        periods(m, 10)
        assert [number for number, each in enumerate(taken, 1) if all(each)] == [
            round(t * 1000) for t in m.middle.acted
        ][:-1]
        assert sum(any(each) for each in taken) == len(m.middle.acted) - 1
        assert not any(phases.ns)


def test_the_frames_of_a_run_say_which_parts_have_rates() -> None:
    machine = plant()
    connection = connect(machine, wired(machine, Scripted()))
    with connection as m, published(connection, "rates") as ring, Reader(ring.path) as reader:
        periods(m, 5)
        assert {"control middle", "control slow"} < set(reader.layout.phases)
        assert reader.layout.about["rates"] == [
            {"path": "middle", "every": 10, "phase": 0},
            {"path": "slow", "every": 1000, "phase": 1},
        ]


# What does not wait for a slow part -----------------------------------------------------------------------


class Still(Compound):
    level: DigitalSensor
    valve: DigitalActuator


class SlowStill(Still, every="1 s"):
    pass


class Works(Compound):
    timer: DigitalSensor
    fast: Still
    slow: SlowStill
    trips: bool = False

    def interlocks(self) -> Any:
        yield Interlock(lambda: self.trips, [self.slow.valve], "tripped")


def works(**changes: Any) -> Any:
    fast = Still(level=sensor(), valve=actuator())
    return Works(timer=timer(), fast=fast, slow=SlowStill(level=sensor(), valve=actuator(**changes)))


def driven(m: Any, box: Scripted) -> None:
    m.fast.valve.write(5.0)
    m.slow.valve.write(5.0)
    periods(m, 1001)
    assert (box.get("fast.valve"), box.get("slow.valve")) == (10, 10)


@pytest.mark.parametrize("outputs", ["at once", "at next tick"])
def test_in_manual_mode_a_slow_output_with_nobody_in_charge_goes_to_its_default_at_once(outputs: str) -> None:
    machine, box = works(), Scripted()
    wiring = wired(machine, box) | {"process": {"outputs": outputs}}
    with connect(machine, wiring) as m:
        ann = Operator(m)
        ann.do("lease", seconds=60.0)
        driven_by = [m.fast.valve.write(5.0), m.slow.valve.write(5.0)]
        assert driven_by == [True, True]
        ann.run(1001)
        assert box.get("slow.valve") == 10
        ann.mode("manual")
        ann.run(1)
        assert (box.get("fast.valve"), box.get("slow.valve")) == (0, 0)


def test_what_a_client_lets_go_of_goes_to_its_default_at_once_also_in_a_slow_part() -> None:
    machine, box = works(), Scripted()
    with connect(machine, wired(machine, box)) as m:
        ann = Operator(m)
        ann.do("lease", seconds=60.0)
        ann.mode("manual")
        ann.do("write", "slow.valve", 5.0)
        ann.run(1000)
        assert box.get("slow.valve") == 10
        ann.alive = False
        ann.run(501)  # the dead-man time
        assert box.get("slow.valve") == 0


def test_an_expired_command_of_a_slow_part_is_replaced_when_it_expires() -> None:
    machine, box = works(expires="1.5 s"), Scripted()
    with connect(machine, wired(machine, box)) as m:
        driven(m, box)
        periods(m, 498)
        assert box.get("slow.valve") == 10
        periods(m, 2)
        assert box.get("slow.valve") == 0


class LateStill(Still, every=1500):
    pass


class WithLate(Works):
    late: LateStill


def test_what_does_not_wait_is_sent_also_where_the_outputs_of_another_part_fail() -> None:
    class Deaf(Scripted):
        deaf = False

        def write_many(self, channels: Any, raws: Any) -> None:
            if self.deaf and any("late" in channel.text for channel in channels):
                raise DriverError("deaf")
            super().write_many(channels, raws)

    fast, late = (kind(level=sensor(), valve=actuator()) for kind in (Still, LateStill))
    slow = SlowStill(level=sensor(), valve=actuator(expires="1.501 s"))
    machine, box = WithLate(timer=timer(), fast=fast, slow=slow, late=late), Deaf()
    connection = connect(machine, wired(machine, box))
    with pytest.raises(DriverError, match=r"late\.valve"), connection as m:
        driven(m, box)
        periods(m, 499)
        box.deaf = True
        try:
            periods(m, 1)
        finally:
            assert (connection.machine.clock.number, box.get("slow.valve")) == (1501, 0)


def test_a_reset_that_a_slow_part_has_lost_is_tried_again_in_the_next_period() -> None:
    class Flaky(Scripted):
        fails = False

        def reset(self, channel: Any, default: Any) -> None:
            if self.fails and channel.text == "slow.valve":
                self.fails = False
                raise DriverError("lost")
            super().reset(channel, default)

    machine, box = works(on_error="retry", max_age="2 s"), Flaky()
    with connect(machine, wired(machine, box)) as m:
        driven(m, box)
        m.trips = box.fails = True
        periods(m, 2)
        assert box.get("slow.valve") == 0


def test_what_the_application_had_is_back_before_it_goes_on_also_in_a_slow_part() -> None:
    machine, box = works(), Scripted()
    seen: list[float] = []

    async def application() -> None:
        m.slow.valve.write(5.0)
        while True:
            await next_period()
            seen.append(m.slow.valve.read())

    with connect(machine, wired(machine, box)) as m:
        m.cycle.start(application())
        ann = Operator(m)
        ann.do("lease", seconds=60.0)
        ann.run(1500)
        ann.mode("manual")
        ann.run(300)
        assert m.slow.valve.read() == 0.0
        before = len(seen)
        ann.mode("automatic")
        ann.run(5)
    assert set(seen[before:]) == {5.0}


def test_the_time_of_a_slow_part_does_not_stand_still_between_its_periods() -> None:
    machine = works()
    with connect(machine, wired(machine, Scripted())) as m:
        for _ in range(1500):
            periods(m)
            assert m.slow.now == m.now


def test_a_law_out_of_turn_is_no_step_of_its_parts_sequences() -> None:
    class Waits(Slow):
        async def work(self) -> None:
            await wait("3 s")
            self.done = self.now

    machine = Plant(timer=timer(), fast=unit(), middle=unit(Middle), slow=unit(Waits))
    with connect(machine, wired(machine, Scripted())) as m:
        m.slow.cycle.start(m.slow.work())
        ann = Operator(m)
        ann.do("lease", seconds=60.0)
        ann.run(1200)
        begun = m.slow.acted[0]
        ann.mode("manual")
        ann.run(1)
        ann.mode("automatic")
        ann.run(4000)
        assert m.slow.done == pytest.approx(begun + 3.0, abs=0.002)


def test_a_slow_part_does_not_lengthen_the_timeout_of_a_driver() -> None:
    machine = works()
    wiring = wired(machine, Scripted())
    wiring["drivers"]["box"] = Scripted()
    with (connection := connect(machine, wiring)) as m:
        timeouts = {wire.driver.timeout for wire in connection.image.wires if wire.item is not m.timer}
    assert max(timeouts) <= 0.01


def test_equipment_of_a_slow_part_is_cleared_when_its_sensors_can_be_read_again_and_not_a_period_later() -> None:
    class Vessel(Still, every="1 s", equipment=True):
        pass

    class Site(Compound):
        timer: DigitalSensor
        vessel: Vessel

    machine, box = Site(timer=timer(), vessel=Vessel(level=sensor(), valve=actuator())), Scripted()
    with connect(machine, wired(machine, box)) as m:
        periods(m, 1000)
        box.broken = OSError("gone")
        periods(m, 1000)
        assert m.vessel.cycle.fault is not None
        box.broken = None
        assert m.vessel.cycle.clear() == ["vessel"]
