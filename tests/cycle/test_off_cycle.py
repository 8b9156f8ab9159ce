"""A driver off the cycle in virtual time: its own period, the age of what it gives, and what the device confirmed."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.machines import Bench, Board, actuator, bench, failed, relay, sensor, switch, timer, wired
from helpers.tiers import first
from umo import BinaryActuator, Compound, DigitalActuator, DigitalSensor, Quality, connect
from umo.cycle.events import LIMIT_COUNT, EventLimit, limited
from umo.cycle.image import Image
from umo.cycle.journal import ENTRY, Journal, Kind
from umo.drivers import DeviceTimeout, Driver, DriverError, Looks
from umo.drivers.off_cycle import NO_TIME, DeviceServer, Exchange, OffCycle
from umo.drivers.off_cycle.shared_memory import Cell, Row
from umo.errors import ChannelsFailed, WiringError
from umo.objects import Atomic
from umo.states import OnOff, PassFail
from umo.testing import Scripted, periods
from umo.wiring.resolve import check

OWN, MAX_AGE = 0.05, 0.15
"""The driver's period and, by default, the age from which its values are STALE, s."""


def slow(machine: Bench, box: Any, **keys: Any) -> dict[str, Any]:
    """Everything but the timer on a driver of 50 ms."""
    wiring = wired(machine, Scripted())
    wiring["drivers"]["box"] = {"type": box, "off_cycle": True, "period": "50 ms"} | keys
    return wiring


@contextmanager
def running(box: Any, machine: Any = None, **keys: Any) -> Iterator[tuple[Any, connect[Any]]]:
    machine = machine or bench()
    connection = connect(machine, slow(machine, box, **keys))
    connection.pause = lambda seconds: None
    with connection as m:
        yield m, connection


def period(m: Any, number: int = 1) -> None:
    for _ in range(number):
        m.timer.read()
        m.sample()
        m.update()


def moved(box: Scripted, segment: str) -> int:
    return sum(call.segment == segment for call in box.calls)


class Deaf(Scripted):
    """A circuit that can lose its device."""

    def silent(self) -> None:
        self.broken = DeviceTimeout("no answer")

    def back(self) -> None:
        self.broken = None


class OneByOne(Scripted):
    """A circuit whose channels are read one by one: each fails alone."""

    read_many = Driver.read_many


# Values and their age ---------------------------------------------------------------------------------


def test_its_transfers_are_made_at_its_own_period() -> None:
    box = Scripted()
    with running(box) as (m, _):
        before = moved(box, "read_many"), moved(box, "write_many")
        period(m, 501)  # what is due in one period is transferred before the tick of the next
        assert (moved(box, "read_many") - before[0], moved(box, "write_many") - before[1]) == (10, 10)


def test_a_value_has_the_time_of_the_transfer_that_brought_it() -> None:
    box = Scripted({"encoder": range(1, 100)})
    with running(box) as (m, _):
        seen = set()
        for _ in range(300):
            period(m)
            seen.add((m.encoder.raw, round(m.encoder.time, 6)))
            assert 0 <= m.now - m.encoder.time <= OWN + 0.001
            assert m.encoder.quality is Quality.GOOD
    assert sorted(seen) == [(1 + n, round(OWN * n, 6)) for n in range(6)]


def test_one_failed_transfer_is_no_failure() -> None:
    box = Deaf({"encoder": 4})
    with running(box) as (m, _):
        period(m, 60)
        box.silent()
        period(m, 40)  # the transfer at 0.1 s fails
        box.back()
        for _ in range(200):
            period(m)
            assert m.encoder.quality is Quality.GOOD
        assert m.now - m.encoder.time <= OWN


def test_an_old_value_is_stale_then_the_reading_has_failed() -> None:
    box = Deaf({"encoder": 4})
    with running(box) as (m, _):
        period(m, 60)
        box.silent()
        last = m.encoder.time
        with pytest.raises(DriverError, match="its device is away: no answer") as caught:
            for _ in range(1000):
                period(m)
                expected = Quality.GOOD if m.now - last <= MAX_AGE + 1e-9 else Quality.STALE
                assert m.encoder.quality is expected
        assert m.now - last == pytest.approx(2 * MAX_AGE + 0.001)
        assert {"encoder", "limit"} <= set(failed(caught.value))
        box.back()


@pytest.mark.parametrize(("on_error", "quality"), [("mark", Quality.BAD), ("hold", Quality.STALE)])
def test_then_the_sensor_does_as_it_declares(on_error: str, quality: Quality) -> None:
    keep = {"max_age": "60 s"} if on_error == "hold" else {}
    machine = bench(
        encoder=sensor(on_error=on_error, **keep),
        limit=switch(on_error=on_error, **keep),
        motor=actuator(on_error="retry", max_age="60 s"),
        valve=relay(on_error="retry", max_age="60 s"),
    )
    box = Deaf({"encoder": 4})
    with running(box, machine) as (m, _):
        period(m, 60)
        box.silent()
        period(m, 400)
        assert m.encoder.quality is quality
        assert m.motor.quality is Quality.STALE
        box.back()
        period(m, 1100)
        assert m.encoder.quality is Quality.GOOD
        assert m.motor.quality is Quality.GOOD


def test_one_failed_channel_ages_alone() -> None:
    box = OneByOne({"encoder": 4, "limit": [0, 0, OSError("broken wire")]})
    with running(box, bench(limit=switch(on_error="mark"))) as (m, _):
        period(m, 1000)
        assert m.limit.quality is Quality.BAD
        assert m.encoder.quality is Quality.GOOD
        assert m.now - m.encoder.time <= OWN


def test_a_reading_that_is_invalid_fails_as_on_the_cycle() -> None:
    with running(Scripted({"limit": [0, 0, 2]})) as (m, _), pytest.raises(DriverError, match="a binary channel reads"):
        period(m, 1000)


def test_an_out_of_range_value_stays_out_of_range_between_arrivals() -> None:
    with running(Scripted({"encoder": 999})) as (m, _):
        for _ in range(120):
            period(m)
            assert m.encoder.quality is Quality.OUT_OF_RANGE
            assert m.encoder.read() == 499.5


def test_a_value_that_never_came_is_no_value() -> None:
    machine = bench(encoder=sensor(on_error="mark"))
    with running(OneByOne({"encoder": OSError("no sensor")}), machine) as (m, _):
        period(m, 10)
        assert m.encoder.quality is Quality.BAD
        assert np.isnan(m.encoder.read())


def test_max_age_can_be_given() -> None:
    box = Deaf({"encoder": 4})
    with running(box, max_age="400 ms") as (m, _):
        period(m, 60)
        box.silent()
        last = m.encoder.time
        while m.now - last < 0.4 - 1e-9:
            period(m)
            assert m.encoder.quality is Quality.GOOD
        period(m, 2)
        assert m.encoder.quality is Quality.STALE
        box.back()


# Outputs ------------------------------------------------------------------------------------------------


def test_the_last_value_wins_and_read_gives_what_was_confirmed() -> None:
    box = Scripted()
    with running(box) as (m, _):
        period(m, 10)
        for value in (1.0, 2.0, 3.0):
            m.motor.write(value)
            period(m)
        assert (m.motor.pending, m.motor.read()) == (3.0, 0.0)
        period(m, 100)
        assert m.motor.read() == 3.0
        assert m.now - m.motor.time <= OWN
    written = [call.raws[0] for call in box.calls if call.segment == "write_many"]
    assert 6 in written
    assert not {2, 4} & set(written)


def test_a_rate_is_kept_over_its_transfers() -> None:
    machine = bench(motor=actuator(resolution=0.001, slew_rate=2.0))
    with running(Scripted(), machine) as (m, _):
        period(m, 100)
        began, values = m.now, []
        m.motor.write(10.0)
        for _ in range(1000):
            period(m)
            values.append((m.now - began, m.motor.read()))
        for elapsed, value in values:
            assert value <= 2.0 * (elapsed + OWN) + 0.001  # the first step counts from what was confirmed last
        assert values[-1][1] == pytest.approx(2.0, abs=2.0 * 2 * OWN)


def test_an_asynchronous_write_is_carried_out_once_and_confirmed() -> None:
    box = Scripted()
    with running(box, bench(valve=relay(synchronous=False))) as (m, _):
        period(m, 10)
        assert m.valve.write(OnOff.ON)
        assert m.valve.read() is OnOff.OFF
        period(m, 2)
        assert m.valve.read() is OnOff.ON
        period(m, 200)
    assert [call.raws for call in box.calls if call.segment == "write"] == [(1,)]


def test_of_several_asynchronous_writes_in_a_period_the_last_is_made() -> None:
    box = Scripted()
    with running(box, bench(motor=actuator(synchronous=False))) as (m, _):
        period(m, 10)
        for value in (1.0, 2.0, 3.0):
            m.motor.write(value)
        period(m, 3)
        assert m.motor.read() == 3.0
    assert [call.raws for call in box.calls if call.segment == "write"] == [(6,)]


def test_a_failed_asynchronous_write_fails() -> None:
    box = Scripted()
    with running(box, bench(valve=relay(synchronous=False))) as (m, _):
        period(m, 10)
        box.at(len(box.calls), OSError("contact welded"))
        m.valve.write(OnOff.ON)
        with pytest.raises(DriverError, match="contact welded") as caught:
            period(m, 3)
        assert failed(caught.value) == ["valve"]


def test_a_failed_asynchronous_write_is_made_again_where_it_may_be() -> None:
    box = Scripted()
    machine = bench(valve=relay(synchronous=False, on_error="retry", max_age="1 s"))
    with running(box, machine) as (m, _):
        period(m, 10)
        box.at(len(box.calls), OSError("busy"))
        m.valve.write(OnOff.ON)
        period(m, 10)
        assert m.valve.read() is OnOff.ON
        assert m.valve.quality is Quality.GOOD
    assert [call.raws for call in box.calls if call.segment == "write"] == [(1,), (1,)]


def test_an_output_that_is_not_confirmed_fails_after_two_maximum_ages() -> None:
    box = Deaf()
    machine = bench(encoder=sensor(on_error="mark"), limit=switch(on_error="mark"))
    with running(box, machine) as (m, _):
        period(m, 60)
        box.silent()
        with pytest.raises(DriverError) as caught:
            period(m, 1000)
        assert set(failed(caught.value)) == {"motor", "valve"}
        assert 0.3 < m.now < 0.42
        box.back()


def test_a_reset_part_goes_to_its_default_and_no_older_value_follows() -> None:
    box = Scripted()
    with running(box) as (m, _):
        m.motor.write(5.0)
        period(m, 120)
        assert m.motor.read() == 5.0
        before = len(box.calls)
        m.motor.reset()
        period(m, 100)
        assert m.motor.read() == 0.0
    raws = [
        call.raws for call in box.calls[before:] if call.segment in ("reset", "write_many") and "motor" in call.channels
    ]
    assert raws[0] == (0,)
    assert all(raw[0] == 0 for raw in raws)


# A device that was away -----------------------------------------------------------------------------------


def test_a_device_that_was_away_for_long_is_initialised_before_anything_is_written() -> None:
    box = Deaf({"encoder": 4})
    keep = {"on_error": "retry", "max_age": "60 s"}
    machine = bench(
        encoder=sensor(on_error="hold", max_age="60 s", incremental=True),
        limit=switch(on_error="mark"),
        motor=actuator(slew_rate=20.0, **keep),
        valve=relay(synchronous=False, **keep),
    )
    with running(box, machine) as (m, connection):
        m.encoder.referenced()
        m.motor.write(5.0)
        m.valve.write(OnOff.ON)
        period(m, 200)
        box.silent()
        period(m, 800)
        before = len(box.calls)
        box.back()
        period(m, 1500)
        after = [call for call in box.calls[before:] if call.segment != "read_many"]
        assert [call.segment for call in after[:4]] == ["initialize"] * 4
        assert after[4].segment == "write"  # the valve retries
        first = next(call for call in after if call.segment == "write_many")
        assert first.raws[first.channels.index("motor")] < 10  # it goes on from its default, at its rate
        assert m.motor.read() == 5.0
        assert m.valve.read() is OnOff.ON
        assert m.encoder.quality is Quality.UNREFERENCED
        texts = [event.text for event in connection.machine.events if event.path == "driver box"]
        assert texts[0].startswith("is away")
        assert any("initialised again" in text for text in texts)
        assert texts[-1] == "is back"


def test_what_was_written_before_the_absence_is_not_written_after_it() -> None:
    box = Deaf()
    machine = bench(
        encoder=sensor(on_error="mark"),
        limit=switch(on_error="mark"),
        motor=actuator(on_error="retry", max_age="60 s"),
        valve=relay(synchronous=False, on_error="raise"),
    )
    with running(box, machine, max_age="10 s") as (m, _):
        period(m, 100)
        box.silent()
        period(m, 60)
        m.valve.write(OnOff.ON)  # cannot be carried out
        period(m, 1000)
        box.back()
        period(m, 1500)
        assert m.valve.read() is OnOff.OFF
        assert m.valve.pending is OnOff.OFF
    assert moved(box, "write") == 0


class HalfDead(Deaf):
    """A circuit that can be connected and initialised, and then fails each reading, in one of three ways."""

    how = "works"

    def read_many(self, channels: Any, out: Any) -> None:
        if self.how == "channels":
            raise ChannelsFailed({channel.text: "no reading" for channel in channels})
        if self.how == "whole":
            raise OSError("no reading")
        if self.how == "late":
            raise DeviceTimeout("no reading")
        super().read_many(channels, out)


@pytest.mark.parametrize("how", first(1, ["late", "channels", "whole"]))
@pytest.mark.parametrize("outputs", [True, False])
def test_a_driver_is_back_when_a_value_has_come_and_is_told_of_a_few_times_a_minute(how: str, outputs: bool) -> None:
    """It connects and fails each reading."""
    box = HalfDead({"encoder": 4})
    keep = {"on_error": "retry", "max_age": "600 s"}
    machine = bench(
        encoder=sensor(on_error="mark"), limit=switch(on_error="mark"), motor=actuator(**keep), valve=relay(**keep)
    )
    wiring = slow(machine, box)
    if not outputs:
        wiring["wire"] |= {path: {"driver": "simulated"} for path in ("motor", "valve")}
    connection = connect(machine, wiring)
    with connection as m:
        period(m, 200)
        box.how = how
        period(m, 5000)
        texts = [event.text for event in connection.machine.events if event.path == "driver box"]
        assert not any(text.startswith("is back") for text in texts)
        assert len(texts) <= 2
        if not (outputs and how == "channels"):  # what it confirms of its outputs has come
            assert texts[0].startswith("is away")
        box.how = "works"
        period(m, 2000)
        texts = [event.text for event in connection.machine.events if event.path == "driver box"]
        assert not texts or texts[-1].startswith("is back")
        assert m.encoder.quality is Quality.GOOD


def test_what_flickers_is_told_of_a_few_times_a_minute_and_counted() -> None:
    limit = EventLimit()
    counts = [limit.admit(0.1 * number) for number in range(1200)]
    assert [count for count in counts[:600] if count is not None] == [0] * LIMIT_COUNT
    assert [count for count in counts[600:] if count is not None] == [600 - LIMIT_COUNT, *[0] * (LIMIT_COUNT - 1)]
    assert limited(1.0, "driver box", "is away", 597).text == (
        "is away (597 earlier events of this kind were not stored)"
    )
    assert limited(1.0, "driver box", "is away", 0).text == "is away"


# Stopping, faults, the journal ------------------------------------------------------------------------------


def test_every_output_is_reset_in_stop_order_at_the_end() -> None:
    box = Scripted()
    with running(box) as (m, _):
        m.motor.write(5.0)
        period(m, 100)
        before = len(box.calls)
    resets = [call.channels[0] for call in box.calls[before:] if call.segment == "reset"]
    assert resets == ["motor", "valve"]
    assert box.calls[-1].segment == "close"


def test_injected_faults_act_on_it() -> None:
    machine = bench(encoder=sensor(on_error="mark"))
    connection = connect(machine, slow(machine, Scripted({"encoder": 4})), fault="encoder disconnect at 0.2 s for 1 s")
    with connection as m:
        period(m, 190)
        assert m.encoder.quality is Quality.GOOD
        period(m, 600)
        assert m.encoder.quality is Quality.BAD
        period(m, 500)
        assert m.encoder.quality is Quality.GOOD


def noted(connection: connect[Any], item: Atomic, kind: Kind, step: Callable[[], object]) -> list[tuple[Any, ...]]:
    """The entries of one object in the journal of a step: raw, before, time."""
    image = connection.image
    image.transfer.journal = journal = Journal(100)
    step()
    entries = [ENTRY.unpack_from(journal.buffer, i * ENTRY.size) for i in range(journal.count)]
    slot = image.slot_of[id(item)]
    return [(raw, before, time) for at, what, _, raw, before, time in entries if (at, what) == (slot, kind)]


def test_arrivals_are_entries_of_the_journal_with_the_times_of_their_readings() -> None:
    with running(Scripted({"encoder": range(10, 100)})) as (m, connection):
        found = {n: noted(connection, m.encoder, Kind.ARRIVED, lambda: period(m)) for n in range(120)}
        assert {n: each for n, each in found.items() if each} == {
            50: [(11, 10, pytest.approx(0.050, abs=0.0011))],
            100: [(12, 11, pytest.approx(0.100, abs=0.0011))],
        }
        assert found[100][0][2] == m.encoder.time


def test_what_the_device_has_confirmed_is_an_entry_of_the_journal_with_its_time() -> None:
    with running(Scripted()) as (m, connection):
        before = m.motor.raw
        m.motor.write(5.0)
        found = [each for _ in range(120) for each in noted(connection, m.motor, Kind.CONFIRMED, lambda: period(m))]
        times = [time for _, _, time in found]
        assert found[0][:2] == (m.motor.raw, before)
        assert m.motor.raw != before
        assert times == sorted(times)
        assert times[-1] == m.motor.time


def test_a_machine_without_such_drivers_has_the_plain_image() -> None:
    machine = bench()
    with (connection := connect(machine, wired(machine, Scripted()))) as m:
        period(m)
        assert type(connection.image) is Image


def test_a_sensor_that_is_read_alone_has_its_own_time_too() -> None:
    machine = bench(encoder=sensor(synchronous=False))
    with running(Scripted({"encoder": range(1, 50)}), machine) as (m, _):
        period(m, 75)
        assert m.encoder.read() == 1.0
        assert m.encoder.time == pytest.approx(0.05)
        assert m.limit.sample()
        assert m.limit.time == pytest.approx(0.05)


# The wiring ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("keys", "where", "text"),
    [
        ({"period": None}, "drivers.box.period", "is missing: the time from one transfer to the next"),
        ({"off_cycle": "yes"}, "drivers.box.off_cycle", "must be true or false"),
        (
            {"off_cycle": False},
            "drivers.box.period",
            "can only be used with a driver off the cycle: add off_cycle = true",
        ),
        ({"max_age": "20 ms"}, "drivers.box.max_age", "20 ms is less than the driver's period, 50 ms"),
        ({"period": "fast"}, "drivers.box.period", "fast"),
    ],
)
def test_check_names_what_is_wrong(keys: dict[str, Any], where: str, text: str) -> None:
    machine = bench()
    wiring = slow(machine, Scripted())
    wiring["drivers"]["box"] = {k: v for k, v in (wiring["drivers"]["box"] | keys).items() if v is not None}
    found = {mistake.key: mistake.message for mistake in check(machine, wiring)}
    assert text in found[where]


def test_a_watchdog_is_longer_than_the_drivers_own_period() -> None:
    class Watched(Scripted):
        def watchdog(self, seconds: float) -> None: ...
        def check_watchdog(self, seconds: float) -> None: ...

    machine = bench()
    found = check(machine, slow(machine, Watched(), watchdog="20 ms"))
    assert [mistake.message for mistake in found] == ["20 ms is not longer than the period, 50 ms"]


def test_the_timer_is_on_the_cycle() -> None:
    machine = bench()
    wiring = slow(machine, Scripted())
    wiring["drivers"]["clock"] = {"type": wiring["drivers"]["clock"], "off_cycle": True, "period": "1 s"}
    assert "so the driver cannot be off the cycle" in str([mistake.message for mistake in check(machine, wiring)])


def test_drivers_that_share_a_device_are_off_the_cycle_together() -> None:
    machine = bench()
    wiring = slow(machine, Board("bus 1"))
    wiring["drivers"]["other"] = Board("bus 1")
    wiring["drivers"]["clock"] = Board()
    wiring["wire"]["limit"] = {"driver": "other"}
    with pytest.raises(WiringError, match="other shares bus 1 with this driver, and must be off the cycle too"):
        connect(machine, wiring).__enter__()


# The shared memory ----------------------------------------------------------------------------------------------


def exchange(*texts: str) -> Exchange:
    box = Scripted()
    return Exchange([box.channel(text) for text in texts])


@settings(deadline=None, max_examples=50)
@given(st.lists(st.integers(-(2**62), 2**62), min_size=1, max_size=20))
def test_a_bank_is_read_as_it_was_posted(values: list[int]) -> None:
    shared = exchange("a", "b")
    for count, value in enumerate(values, 1):
        rows = np.full((len(Row), 2), value)
        shared.arrivals.post(rows)
        assert shared.arrivals.count == count
        found = shared.arrivals.read()
        assert found[0] == count
        assert (found[1] == value).all()


def test_an_answer_belongs_to_its_request() -> None:
    shared = exchange("a")
    assert shared.asked() is None
    number = shared.ask({"call": "open"})
    assert shared.asked() == (number, {"call": "open"})
    assert shared.answered(number) is None
    shared.answer(number, {"value": 3})
    assert shared.answered(number) == {"value": 3}
    assert shared.asked() is None


def test_a_request_that_is_too_large_is_refused() -> None:
    with pytest.raises(ValueError, match="do not fit"):
        exchange("a").ask({"call": "x" * 20_000})


def test_errors_come_over_as_what_they_are() -> None:
    proxy = OffCycle(Scripted(), OWN, MAX_AGE)
    box: Any = proxy.driver
    channel = proxy.channel("a")
    for raised in (DeviceTimeout("late"), OSError("cut"), ChannelsFailed({"a": "wire"}), ValueError("mistake")):
        box.broken = raised
        with pytest.raises(type(raised) if isinstance(raised, DriverError) else DriverError, match=str(raised)[:4]):
            proxy.write_many((channel,), np.array([1]))


def test_the_place_of_a_worker_that_died_is_taken_with_the_outputs_at_their_defaults() -> None:
    box = Scripted()
    shared = exchange("motor", "encoder")
    server = DeviceServer(box, shared, OWN)
    server.assign([1], [0])
    shared.cells[Cell.GENERATION] = 3
    server.begin_anew({"motor": 7, "encoder": None}, None)
    assert [call.segment for call in box.calls] == ["open", "initialize", "initialize"]
    assert shared.cells[Cell.GENERATION] == 4
    assert shared.cells[Cell.AWAY_SINCE] == NO_TIME
    server.work()
    assert moved(box, "write_many") == 0  # nothing is wanted of this generation yet
    assert shared.arrivals.read()[1][Row.RAW, 0] == 7


def test_a_worker_that_keeps_its_outputs_at_their_defaults_confirms_them_in_each_transfer() -> None:
    """Whatever is wanted; and goes on with it afterwards."""
    time = [0]
    box, proxy, channels = served(time)
    server = proxy.server
    server.begin_anew({"in": None, "sync": 7, "a": 0, "b": 0}, None, hold=1.0)
    proxy.accept_generation(proxy.exchange.arrivals.read()[1])
    proxy.write_many([channels["sync"]], np.array([40]))
    proxy.write(channels["a"], 1)
    for time[0] in range(0, 1_000_000_000, 10_000_000):
        server.work()
        raw, stamp = arrived(proxy, "sync")
        assert (raw, box.has["sync"], box.has["a"]) == (7, 7, 0)
        assert time[0] - stamp <= 100_000_000
    for time[0] in range(1_000_000_000, 1_500_000_000, 10_000_000):
        server.work()
    assert (box.has["sync"], box.has["a"]) == (40, 1)


def test_the_place_of_a_worker_is_taken_also_while_the_device_is_away() -> None:
    box = Deaf()
    shared, time = exchange("motor"), [0]
    server = DeviceServer(box, shared, OWN, lambda: time[0])
    server.assign([], [0])
    box.silent()
    server.begin_anew({"motor": 7}, None)
    assert shared.cells[Cell.AWAY_SINCE] != NO_TIME
    for _ in range(100):
        time[0] += 10**7
        server.work()
    box.back()
    before = len(box.calls)
    for _ in range(200):
        time[0] += 10**7
        server.work()
    assert [call.segment for call in box.calls[before:]] == ["open", "initialize"]
    assert shared.cells[Cell.AWAY_SINCE] == NO_TIME


def test_between_two_initialisations_that_time_out_the_worker_waits_at_intervals_that_grow() -> None:
    """Each lasts longer than the interval."""
    time = [0]
    box, proxy, _ = served(time)
    begun: list[tuple[int, int]] = []

    def times_out(*args: Any) -> None:
        began, time[0] = time[0], time[0] + 10**9
        begun.append((began, time[0]))
        raise DeviceTimeout("no answer")

    box.read_many = box.initialize = times_out  # type: ignore[method-assign]
    while time[0] < 15 * 10**9:
        time[0] += 10**7
        proxy.server.work()
    gaps = [round((later - ended) * 1e-9, 2) for (_, ended), (later, _) in pairwise(begun)]
    assert gaps[1:7] == pytest.approx([0.05, 0.1, 0.2, 0.4, 0.8, 1.0], abs=0.1)


@given(
    connecting=st.permutations(["a", "b", "c", "d"]),
    stopping=st.permutations(["a", "b", "c", "d"]),
    count=st.integers(0, 4),
)
def test_a_worker_left_alone_touches_what_it_has_driven_alone_and_in_the_order_of_stopping(
    connecting: list[str], stopping: list[str], count: int
) -> None:
    driven, order = connecting[:count], [text for text in stopping if text != "d"]  # d is an input
    box = Scripted()
    server = DeviceServer(box, exchange(*connecting), OWN)
    if driven:
        server.perform({"call": "open"})
    for text in driven:
        server.perform({"call": "initialize", "channel": text, "raw": None if text == "d" else 0})
    box.broken = OSError("away")
    assert set(server.reset_all(order)) == {text for text in driven if text != "d"}
    box.broken = None
    box.calls.clear()
    assert server.reset_all(order) == {}
    again = [text for text in order if text in driven]
    made = [(call.segment, channel) for call in box.calls for channel in call.channels or ("",)]
    if not again:
        assert made == []
        return
    rest = ["d"] if "d" in driven else []
    initialized = [("initialize", text) for text in [*again, *rest]]
    assert made == [("open", ""), *initialized, *(("reset", text) for text in again)]


def test_a_binary_sensor_works_as_well(request: pytest.FixtureRequest) -> None:
    with running(Scripted({"limit": [0, 1]})) as (m, _):
        assert m.limit.read() is PassFail.PASS
        period(m, 60)
        assert m.limit.read() is PassFail.FAIL
        assert isinstance(m.encoder, DigitalSensor)


# Orders -----------------------------------------------------------------------------------------------------------


class Level(Scripted):
    """Outputs, and an input whose value is given."""

    def __init__(self) -> None:
        super().__init__()
        self.value, self.has = 100, {"sync": 0, "a": 0, "b": 0}
        self.late = False

    def read_many(self, channels: Any, out: Any) -> None:
        out[:] = self.value

    def write(self, channel: Any, raw: int) -> None:
        if self.late:
            self.late = False
            raise DeviceTimeout("no answer")
        self.has[channel.text] = raw

    def write_many(self, channels: Any, raws: Any) -> None:
        self.has |= {channel.text: int(raw) for channel, raw in zip(channels, raws, strict=True)}

    def initialize(self, channel: Any, default: int | None) -> None:
        if default is not None:
            self.has[channel.text] = default

    reset = initialize


def served(time: list[int]) -> tuple[Level, OffCycle, dict[str, Any]]:
    """A driver whose server runs by a clock in ns, at 100 ms."""
    box = Level()
    proxy = OffCycle(box, 0.1, 0.3)
    channels = {text: box.channel(text) for text in ("in", "sync", "a", "b")}
    proxy.meet(list(channels.values()), [channels["in"]], [channels["sync"]])
    proxy.server.ns = lambda: time[0]
    proxy.open()
    for text, channel in channels.items():
        proxy.initialize(channel, None if text == "in" else 0)
    proxy.begin()
    return box, proxy, channels


def arrived(proxy: OffCycle, text: str) -> tuple[int, int]:
    """Raw integer and stamp."""
    rows = proxy.exchange.arrivals.read()[1]
    return tuple(rows[[Row.RAW, Row.STAMP], proxy.exchange.place[text]].tolist())


def test_a_sensor_that_is_initialised_keeps_its_reading_and_its_time() -> None:
    time = [0]
    box, proxy, channels = served(time)
    box.value, time[0] = 200, 10**8
    proxy.server.work()
    time[0] += 10**7
    proxy.initialize(channels["in"], None)
    proxy.server.work()
    assert arrived(proxy, "in") == (200, 10**8)


def test_a_reset_confirms_the_default_and_not_what_was_posted_meanwhile() -> None:
    time = [0]
    box, proxy, channels = served(time)
    proxy.write_many((channels["sync"],), np.array([500]))
    time[0] += 10**8
    proxy.server.work()
    assert (box.has["sync"], arrived(proxy, "sync")[0]) == (500, 500)
    time[0] += 10**7
    proxy.reset(channels["sync"], 0)
    proxy.write_many((channels["sync"],), np.array([700]))
    proxy.server.work()
    assert (box.has["sync"], arrived(proxy, "sync")[0]) == (0, 0)
    time[0] += 10**8
    proxy.server.work()
    assert (box.has["sync"], arrived(proxy, "sync")[0]) == (700, 700)


def test_an_order_after_one_that_timed_out_is_carried_out_when_the_device_is_back() -> None:
    time = [0]
    box, proxy, channels = served(time)
    time[0] += 10**7
    box.late = True
    proxy.write(channels["a"], 1)
    proxy.write(channels["b"], 2)
    for _ in range(30):
        time[0] += 10**7
        proxy.server.work()
    assert box.has["b"] == 2
    assert arrived(proxy, "a")[1] == NO_TIME


def test_values_carry_the_generation_that_they_are_of() -> None:
    time = [0]
    _, proxy, channels = served(time)
    before = proxy.exchange.arrivals.read()[1]
    proxy.exchange.cells[Cell.GENERATION] += 1  # the worker begins to initialise; nothing of it was posted yet
    proxy.accept_generation(before)
    proxy.write_many((channels["sync"],), np.array([500]))
    time[0] += 10**8
    proxy.server.work()
    assert arrived(proxy, "sync")[0] == 0
    assert proxy.generation == 1


def test_after_clear_a_sensor_that_fails_again_shows_no_old_reading_as_fresh() -> None:
    class Part(Compound, equipment=True):
        motor: DigitalActuator
        encoder: DigitalSensor

    class Machine(Compound):
        timer: DigitalSensor
        part: Part

    class Broken(Scripted):
        value, broken_wire = 10, False

        def read_many(self, channels: Any, out: Any) -> None:
            if self.broken_wire:
                raise ChannelsFailed({channel.text: "sensor broken" for channel in channels})
            out[:] = self.value

    machine, box = Machine(timer=timer(), part=Part(motor=actuator(), encoder=sensor())), Broken()
    wiring = wired(machine, box)
    wiring["drivers"]["box"] = {"type": box, "off_cycle": True, "period": "50 ms"}
    with connect(machine, wiring) as m:
        periods(m, 200)
        box.value = 80
        periods(m, 200)
        box.broken_wire = True
        periods(m, 400)
        assert m.part.cycle.fault is not None
        box.broken_wire = False
        periods(m, 60)
        box.broken_wire = True
        m.part.cycle.clear()
        periods(m, 3)
        assert m.part.encoder.raw == 80


# What a device refuses, and what a stop overtakes ----------------------------------------------------------


@pytest.mark.parametrize("inputs", [True, False])
@pytest.mark.parametrize("error", [ValueError("crc"), DriverError("refused")])
def test_a_write_that_a_device_refuses_fails_with_its_cause_and_is_no_absence(inputs: bool, error: Exception) -> None:
    class Refusing(Scripted):
        def write_many(self, channels: Any, raws: Any) -> None:
            if any(raws):
                raise error
            super().write_many(channels, raws)

    class Out(Compound):
        timer: DigitalSensor
        motor: DigitalActuator

    box = Refusing()
    machine: Any = bench() if inputs else Out(timer=timer(), motor=actuator())
    wiring = slow(machine, box) if inputs else wired(machine, Scripted())
    wiring["drivers"]["box"] = {"type": box, "off_cycle": True, "period": "50 ms"}
    with (connection := connect(machine, wiring)) as m:
        begun = moved(box, "initialize")
        period(m, 60)
        m.motor.write(5.0)
        written = m.now
        with pytest.raises(DriverError, match=str(error)):
            period(m, 3000)
        assert m.now - written < 3 * MAX_AGE + 1.0
        assert moved(box, "initialize") - begun <= len(connection.image.items)  # once at most


RETRIED = {"on_error": "retry", "max_age": "60 s"}


class TakesNoPeriod(Scripted):
    """It reads well and carries orders out, but takes no outputs of a period while `error` is set."""

    error: Exception | None = None

    def write_many(self, channels: Any, raws: Any) -> None:
        if self.error is not None:
            raise self.error
        super().write_many(channels, raws)


class LooksAndTakesNoPeriod(TakesNoPeriod, Looks):
    def look(self) -> bool:
        return True


@pytest.mark.parametrize("inputs", [True, False], ids=["with inputs", "outputs alone"])
@pytest.mark.parametrize("box_class", [TakesNoPeriod, LooksAndTakesNoPeriod])
@pytest.mark.parametrize("error", first(1, [DriverError("refused"), ValueError("crc"), DeviceTimeout("no answer")]))
def test_an_asynchronous_output_is_reset_though_the_device_takes_no_other_output(
    box_class: type[TakesNoPeriod], error: Exception, inputs: bool
) -> None:
    class Out(Compound):
        timer: DigitalSensor
        motor: DigitalActuator
        valve: BinaryActuator

    box, outputs = box_class(), {"motor": actuator(**RETRIED), "valve": relay(synchronous=False)}
    machine: Any = bench(**outputs) if inputs else Out(timer=timer(), **outputs)
    wiring = slow(bench(), box)
    if not inputs:
        del wiring["wire"]["encoder"], wiring["wire"]["limit"]
    connection = connect(machine, wiring)
    with connection as m:
        period(m, 60)
        m.motor.write(3.0)
        m.valve.write(OnOff.ON)
        period(m, 100)
        assert (box.get("motor"), box.get("valve")) != (0, 0)
        box.error = error
        period(m, 200)
        m.valve.reset()
        read = moved(box, "read_many")
        for _ in range(3000):
            with suppress(DriverError):  # a device without inputs is away until it is initialised again
                period(m)
        assert box.get("valve") == 0
        if inputs:
            assert moved(box, "read_many") - read >= 59  # in each of its periods
            assert m.encoder.quality is Quality.GOOD


@pytest.mark.parametrize("error", [DriverError("refused"), DeviceTimeout("no answer")])
def test_a_device_that_reads_and_takes_no_output_says_so_and_its_outputs_have_the_cause(error: Exception) -> None:
    box = LooksAndTakesNoPeriod()
    connection = connect(bench(motor=actuator()), slow(bench(), box))
    with connection as m:
        period(m, 60)
        m.motor.write(3.0)
        period(m, 100)
        box.error = error
        with pytest.raises(DriverError, match=f"box: {error} "):
            period(m, 3000)


def test_a_device_that_reads_and_takes_no_output_is_told_and_so_is_its_return() -> None:
    box = LooksAndTakesNoPeriod()
    connection = connect(bench(motor=actuator(**RETRIED), valve=relay(**RETRIED)), slow(bench(), box))
    with connection as m:
        period(m, 100)
        begun, box.error = moved(box, "initialize"), DriverError("refused")
        period(m, 5000)
        texts = [event.text for event in connection.machine.events]
        assert texts == ["accepts no output: refused"]
        box.error = None
        period(m, 1500)
        assert [event.text for event in connection.machine.events] == [*texts, "is back"]
        assert moved(box, "initialize") == begun


def test_until_a_device_is_initialised_again_its_outputs_are_reset_and_not_written() -> None:
    time = [0]
    box, proxy, channels = served(time)
    box.has["a"] = 1

    def times_out(*args: Any) -> None:
        raise DeviceTimeout("no answer")

    box.initialize = box.write_many = times_out  # type: ignore[method-assign]
    proxy.write_many((channels["sync"],), np.array([500]))

    def go_on() -> None:
        for _ in range(200):
            time[0] += 10**7
            proxy.server.work()

    go_on()
    proxy.accept_generation(proxy.exchange.arrivals.read()[1])
    assert proxy.generation > 1
    proxy.write(channels["b"], 2)
    proxy.reset(channels["a"], 0)
    time[0] += 10**7
    proxy.server.work()
    assert (box.has["a"], box.has["b"]) == (0, 0)
    assert "not initialised again" in proxy.cause(proxy.exchange.place["b"])


def test_a_device_whose_writing_times_out_for_long_is_initialised_again() -> None:
    box = TakesNoPeriod()
    with running(box, bench(motor=actuator(**RETRIED), valve=relay(**RETRIED))) as (m, _):
        period(m, 100)
        begun, box.error = moved(box, "initialize"), DeviceTimeout("no answer")
        period(m, 400)
        assert moved(box, "initialize") == begun
        period(m, 600)
        assert moved(box, "initialize") == begun + 4


def test_a_retried_output_that_the_device_does_not_take_is_not_good_before_it_does_though_it_is_initialised() -> None:
    box = TakesNoPeriod()
    with running(box, bench(motor=actuator(**RETRIED), valve=relay(**RETRIED))) as (m, _):
        period(m, 100)
        m.motor.write(3.0)
        begun, box.error = moved(box, "initialize"), DeviceTimeout("no answer")
        period(m, 400)
        seen = set()
        for _ in range(3000):
            period(m)
            seen.add(m.motor.quality)
        assert moved(box, "initialize") > begun + 4
        assert seen == {Quality.STALE}
        box.error = None
        period(m, 1500)
        assert (m.motor.quality, m.motor.read()) == (Quality.GOOD, 3.0)


def test_what_was_wanted_is_not_sent_when_the_machine_has_ended_during_the_reading() -> None:
    time = [0]
    box, proxy, channels = served(time)
    proxy.write_many((channels["sync"],), np.array([500]))
    time[0] += 10**8
    runs = [True]
    proxy.server.in_charge = lambda: runs[0]
    read = box.read_many

    def slowly(channels: Any, out: Any) -> None:
        read(channels, out)
        runs[0] = False  # meanwhile

    box.read_many = slowly  # type: ignore[method-assign]
    box.value = 7
    proxy.server.work()
    assert (box.has["sync"], arrived(proxy, "in")[0]) == (0, 7)


def test_the_second_transfer_is_due_a_period_after_the_beginning_of_the_first() -> None:
    time = [0]
    box, proxy, _ = served(time)
    read = box.read_many
    begun: list[int] = []

    def slowly(channels: Any, out: Any) -> None:
        begun.append(time[0])
        read(channels, out)
        time[0] += 6 * 10**7

    box.read_many = slowly  # type: ignore[method-assign]
    proxy.end()
    proxy.begin()
    for _ in range(40):
        proxy.server.work()
        time[0] += 10**7
    assert np.diff(begun).tolist() == [10**8] * (len(begun) - 1)


@given(st.integers(0, 12), st.lists(st.tuples(*[st.integers(-(2**40), 2**40)] * 2, st.floats()), max_size=9))
def test_entries_of_many_objects_are_those_of_each(capacity: int, moved: list[tuple[int, int, float]]) -> None:
    one, many = Journal(capacity), Journal(capacity)
    rows = np.array(moved, [("raw", "i8"), ("before", "i8"), ("time", "f8")])
    for journal in (one, many):
        journal.add(0, Kind.RESET, 1, 2)
    for slot, (raw, old, time) in enumerate(moved):
        one.add(slot, Kind.ARRIVED, raw, old, time=time)
    many.add_rows(range(len(moved)), Kind.ARRIVED, rows["raw"], rows["before"], times=rows["time"])
    assert (one.entries, one.count, one.lost) == (many.entries, many.count, many.lost)
