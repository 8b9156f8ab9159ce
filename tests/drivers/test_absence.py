"""A driver that is away: no call waits for it, it is looked for at growing intervals, and initialised again."""

from __future__ import annotations

import errno
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from helpers.machines import Bench, actuator, bench, failed, relay, sensor, switch, timer, wired
from helpers.tiers import budget
from umo import BinaryActuator, Compound, DigitalActuator, DigitalSensor, Quality, connect
from umo.cycle.journal import Journal, Kind
from umo.cycle.phase_times import PhaseTimes
from umo.drivers import ChannelsFailed, DeviceTimeout, Driver, DriverError, Looks
from umo.drivers.absence import LONG_ABSENCE
from umo.errors import text_of
from umo.states import OnOff
from umo.testing import Scripted, periods

PERIOD = 0.001


class Box(Scripted, Looks):
    """A circuit whose device may be silent; it is looked for as `found` says."""

    def __init__(self) -> None:
        super().__init__()
        self.found: Callable[[], bool | None] = lambda: self.broken is None
        self.looks: list[float] = []
        self.now: Callable[[], float] = lambda: 0.0

    def look(self) -> bool | None:
        self.looks.append(self.now())
        return self.found()

    def silent(self) -> None:
        self.broken = DeviceTimeout("no answer")

    def back(self) -> None:
        self.broken = None


class WithoutBlocks(Box):
    """A circuit whose blocks are transferred channel by channel."""

    read_many, write_many = Driver.read_many, Driver.write_many  # type: ignore[assignment]


class Blind(Scripted):
    """A circuit that cannot look without waiting."""

    def silent(self) -> None:
        self.broken = DeviceTimeout("no answer")

    def back(self) -> None:
        self.broken = None


def held(**parts: Any) -> Bench:
    """A machine whose sensors and actuators outlast an absence."""
    keep = {"max_age": "60 s"}
    return bench(
        motor=actuator(on_error="retry", **keep),
        encoder=sensor(on_error="hold", **keep),
        valve=relay(on_error="retry", **keep),
        limit=switch(on_error="hold", **keep),
        **parts,
    )


@contextmanager
def running(m: Any, box: Any, **options: Any) -> Iterator[connect[Any]]:
    wiring = wired(m, box)
    if options:
        wiring["drivers"]["box"] = {"type": box, **options}
    connection = connect(m, wiring)
    with connection:
        box.now = lambda: m.now
        yield connection
        box.back()


def calls(box: Scripted, since: int = 0) -> list[str]:
    return [call.segment for call in box.calls[since:]]


def run(m: Any, seconds: float) -> None:
    for _ in range(round(seconds / PERIOD)):
        with suppress(DriverError):
            m.timer.read()
            with suppress(DriverError):
                m.sample()
            m.control()
            m.update()


def events(connection: connect[Any]) -> list[str]:
    return [f"{event.path} {event.text}" for event in connection.machine.events]


# Away -----------------------------------------------------------------------------------------------------


def test_only_the_first_call_waits_for_a_device_that_does_not_answer() -> None:
    box, m = Box(), held()
    with running(m, box):
        periods(m)
        since = len(box.calls)
        box.silent()
        run(m, 1.0)
        assert calls(box, since) == ["read_many"]


def test_single_reads_writes_and_resets_fail_at_once_while_it_is_away() -> None:
    box, m = Box(), bench(motor=actuator(synchronous=False), encoder=sensor(synchronous=False))
    with running(m, box):
        periods(m)
        since = len(box.calls)
        box.silent()
        with pytest.raises(DriverError, match="no answer") as first:
            m.encoder.read()
        assert "away" not in str(first.value)
        for call in (m.encoder.read, lambda: m.motor.write(1.0), m.motor.reset, m.limit.sample):
            with pytest.raises(DriverError, match="away: no answer"):
                call()
        assert calls(box, since) == ["read"]


def test_a_driver_is_looked_for_in_the_next_period_and_then_at_intervals_that_double_up_to_5_s() -> None:
    box, m = Box(), held()
    with running(m, box):
        box.silent()
        run(m, 14.0)
    gaps = [round(later - earlier, 3) for earlier, later in zip(box.looks, box.looks[1:], strict=False)]
    assert box.looks[0] <= 2 * PERIOD
    assert gaps == [0.05, 0.1, 0.2, 0.4, 0.8, 1.6, 3.2, 5.0]


def test_a_look_that_does_not_know_yet_is_asked_again_in_the_next_period() -> None:
    box, m = Box(), held()
    with running(m, box):
        box.silent()
        box.found = lambda: None
        run(m, 0.1)
        assert len(box.looks) == 99
        assert "read_many" in calls(box)


def test_a_look_that_does_not_decide_within_the_timeout_or_a_long_absence_has_not_found_it() -> None:
    for timeout, limit in (("20 ms", LONG_ABSENCE), ("800 ms", 0.8)):
        box, m = (
            Box(),
            bench(motor=actuator(on_error="raise"), encoder=sensor(on_error="mark"), limit=switch(on_error="mark")),
        )
        with running(m, box, timeout=timeout) as connection:
            m.motor.write(5.0)
            periods(m)
            box.silent()
            box.found = lambda: None
            run(m, limit)
            assert m.motor.quality is Quality.STALE
            with pytest.raises(DriverError, match="motor"):
                periods(m, 10)
            assert events(connection) == ["driver box is away: no answer"]


class Undecidable:
    def __bool__(self) -> bool:
        raise ValueError("neither true nor false")


@pytest.mark.parametrize(
    ("answer", "told"),
    [(OSError("no route to host"), "no route to host"), (Undecidable(), "ValueError: neither true nor false")],
)
def test_a_look_that_raises_is_one_that_does_not_find_it_and_its_cause_is_told(answer: Any, told: str) -> None:
    box, m = Box(), held()

    def look() -> Any:
        if isinstance(answer, OSError):
            raise answer
        return answer

    with running(m, box) as connection:
        box.silent()
        box.found = look
        run(m, 0.6)
        (text,) = events(connection)
        assert text.startswith(f"driver box is away: {told}")
        with pytest.raises(DriverError, match=f"away: {told}"):
            connection.image.transfer.read(connection.image.slot_of[id(m.encoder)])
        box.found = lambda: True


def test_a_driver_that_cannot_look_is_tried_at_the_same_intervals() -> None:
    box, m = Blind(), held()
    with running(m, box):
        since = len(box.calls)
        box.silent()
        run(m, 1.0)
        assert calls(box, since) == ["read_many"] * 5 + ["initialize"]  # 0, 1, 51, 151, 351 and 751 ms


def test_a_driver_whose_calls_fail_at_once_is_called_in_every_period_as_long_as_it_is_found() -> None:
    box, m = Blind(), held()
    with running(m, box):
        since = len(box.calls)
        box.broken = OSError("refused")
        run(m, 0.01)
        assert calls(box, since) == ["read_many", "write_many"] * 10


def test_a_lost_answer_costs_a_period_and_no_initialisation() -> None:
    box, m = Box(), held()
    with running(m, box) as connection:
        m.motor.write(3.0)
        periods(m)
        since = len(box.calls)
        box.silent()
        periods(m)
        assert (m.encoder.quality, m.motor.quality) == (Quality.STALE, Quality.STALE)
        box.back()
        periods(m)
        assert calls(box, since) == ["read_many", "read_many", "write_many"]
        assert (m.encoder.quality, m.motor.quality) == (Quality.GOOD, Quality.GOOD)
        assert events(connection) == []


def test_the_outputs_of_a_driver_whose_inputs_timed_out_fail_only_when_it_is_not_found() -> None:
    box, m = Box(), bench(encoder=sensor(on_error="mark"), limit=switch(on_error="mark"))
    with running(m, box):
        periods(m)
        box.silent()
        box.found = lambda: None
        periods(m, 3)
        assert (m.encoder.quality, m.motor.quality) == (Quality.BAD, Quality.STALE)
        box.found = lambda: False
        with pytest.raises(DriverError, match="away: no answer") as e:
            periods(m)
        assert failed(e.value) == ["motor", "valve"]
        assert m.motor.quality is Quality.BAD


def test_an_output_that_timed_out_fails_at_once() -> None:
    box, m = Box(), bench()
    with running(m, box):
        m.timer.read()
        m.sample()
        box.silent()
        with pytest.raises(DriverError, match="box: no answer"):
            m.update()


def test_an_output_that_times_out_after_a_reading_has_failed_fails_at_once() -> None:
    box, m = Box(), bench(encoder=sensor(on_error="mark"), limit=switch(on_error="mark"))
    with running(m, box):
        periods(m)
        box.broken = OSError("cut")
        m.timer.read()
        m.sample()
        box.silent()
        with pytest.raises(DriverError, match="box: no answer"):
            m.update()


def test_a_channel_that_fails_alone_keeps_nobody_away() -> None:
    box, m = Box(), held()
    with running(m, box):
        since = len(box.calls)
        box.set("encoder", ChannelsFailed({"encoder": "broken wire"}))
        run(m, 1.0)
        assert box.looks == []
        assert len(calls(box, since)) > 1990


def test_another_driver_goes_on_in_every_period() -> None:
    box, living = Box(), Scripted()
    m = held()
    wiring = wired(m, box, entries={"valve": {"driver": "living"}, "limit": {"driver": "living"}}, living=living)
    with connect(m, wiring):
        since = len(living.calls)
        box.silent()
        run(m, 1.0)
        assert calls(living, since) == ["read_many", "write_many"] * 1000
        box.back()


def test_the_end_of_the_run_tries_it_patiently() -> None:
    box, m = Box(), held()
    with running(m, box):
        box.silent()
        run(m, 0.3)
        since = len(box.calls)
        box.found = lambda: False
    assert calls(box, since).count("reset") == 2


def test_a_refused_machine_looks_for_nobody() -> None:
    class Ended(Exception):
        pass

    def instead(*_: object) -> Any:
        raise Ended

    box, m = Box(), held()
    connection, asked = connect(m, wired(m, box)), []
    with suppress(Ended), connection:
        box.silent()
        run(m, 0.01)
        connection.refuse(instead)
        before = len(box.looks)
        with suppress(Ended):
            asked.append("nothing was called")
            connection.machine.clock.on_tick()
            asked.append("and nothing was refused")
        asked.append(len(box.looks) - before)
    connection.stop.restore()  # a process that refuses ends
    assert asked == ["nothing was called", 0]


# Initialised again ----------------------------------------------------------------------------------------


def test_a_device_that_was_away_for_long_is_initialised_before_anything_is_sent_and_then_gets_what_is_pending() -> None:
    box, m = Box(), held()
    with running(m, box):
        m.motor.write(3.0)
        m.valve.write(OnOff.ON)
        periods(m)
        box.silent()
        run(m, LONG_ABSENCE)
        m.motor.write(4.0)
        box.back()
        since = len(box.calls)
        run(m, 1.0)
        found = box.calls[since:]
        assert [(call.segment, call.channels) for call in found[:6]] == [
            ("initialize", ("motor",)),
            ("initialize", ("valve",)),
            ("initialize", ("encoder",)),
            ("initialize", ("limit",)),
            ("read_many", ("encoder", "limit")),
            ("write_many", ("motor", "valve")),
        ]
        assert found[0].raws == (0,)
        assert found[5].raws == (8, 1)
        assert (m.motor.read(), m.motor.quality) == (4.0, Quality.GOOD)


def test_a_device_that_refused_each_channel_for_long_is_initialised_before_anything_is_sent() -> None:
    box, m = WithoutBlocks(), held()
    with running(m, box):
        m.motor.write(3.0)
        periods(m)
        box.broken = ConnectionRefusedError("connection refused")
        run(m, LONG_ABSENCE + 0.01)
        box.back()
        since = len(box.calls)
        run(m, 1.0)
        assert calls(box, since)[:8] == [*["initialize"] * 4, "read", "read", "write", "write"]
        assert (m.motor.read(), m.motor.quality) == (3.0, Quality.GOOD)


def test_the_absence_is_told_once_and_its_end_with_its_duration(caplog: pytest.LogCaptureFixture) -> None:
    box, m = Box(), held()
    with running(m, box) as connection:
        periods(m)
        box.silent()
        run(m, 2.0)
        box.back()
        run(m, 3.0)
        assert events(connection) == [
            "driver box is away: no answer",
            "driver box is back after 3.151 s, initialised again",
        ]
        assert [record.message for record in caplog.records] == events(connection)


@pytest.mark.parametrize(
    ("kind", "cause"),
    [
        *((kind, cause) for kind in (Box, Blind) for cause in (OSError("busy"), DeviceTimeout("no answer"))),
        (WithoutBlocks, ConnectionRefusedError("connection refused")),
        (WithoutBlocks, OSError(errno.ENODEV, "no such device")),
    ],
)
def test_an_absence_is_told_once_it_has_lasted(kind: type[Box], cause: OSError) -> None:
    box, m = kind(), held()
    with running(m, box) as connection:
        periods(m)
        box.broken = cause
        run(m, LONG_ABSENCE)
        assert events(connection) == []
        periods(m, 2)
        assert events(connection) == [f"driver box is away: {text_of(cause)}"]


def test_a_device_that_answers_each_channel_with_an_error_is_not_away() -> None:
    box, m = WithoutBlocks(), held()
    with running(m, box) as connection:
        periods(m)
        since = len(box.calls)
        box.broken = DriverError("local mode: refused")
        run(m, 2 * LONG_ABSENCE)
        assert (box.looks, events(connection)) == ([], [])
        assert set(calls(box, since)) == {"read", "write"}


@given(st.sampled_from([Box, Blind]), st.booleans(), st.integers(1, 120), st.integers(1, 3))
@settings(max_examples=10, deadline=None)
@example(Blind, False, 2, 1)
@pytest.mark.full
def test_a_device_that_fails_now_and_then_is_told_a_few_times_a_second_at_most(
    kind: type[Box], silent: bool, away: int, there: int
) -> None:
    box, m = kind(), held()
    with running(m, box) as connection:
        for _ in range(2_000 // (away + there)):
            box.broken = DeviceTimeout("no answer") if silent else OSError("busy")
            periods(m, away)
            box.back()
            periods(m, there)
        assert len(events(connection)) <= 8  # in 2 s


@pytest.mark.parametrize(
    ("moved", "told"),
    [
        ([], ""),
        ([2], "; valves.2 is at its default"),
        ([0, 2], "; valves.0 and valves.2 are at their defaults"),
    ],
)
def test_the_actuators_that_have_lost_their_value_are_named_when_it_is_back(moved: list[int], told: str) -> None:
    class Manifold(Compound):
        timer: DigitalSensor
        level: DigitalSensor
        motor: DigitalActuator
        valves: list[DigitalActuator]

    m = Manifold(
        timer=timer(),
        level=sensor(on_error="mark"),
        motor=actuator(synchronous=False, on_error="retry", max_age="60 s"),
        valves=[actuator(synchronous=False) for _ in range(3)],
    )
    box = Box()
    with running(m, box) as connection:
        m.motor.write(2.0)
        for number in moved:
            m.valves[number].write(5.0)
        periods(m)
        box.silent()
        run(m, 1.0)
        box.back()
        run(m, 2.0)
        assert events(connection)[-1].partition(", ")[2] == f"initialised again{told}"
        assert [valve.read() for valve in m.valves] == [0.0] * 3


def test_a_driver_that_is_found_and_not_called_is_back_in_the_next_period() -> None:
    box, m = Box(), bench(motor=actuator(synchronous=False), encoder=sensor(synchronous=False))
    wiring = wired(m, Scripted(), entries={"motor": {"driver": "far"}, "encoder": {"driver": "far"}}, far=box)
    connection = connect(m, wiring)
    with connection:
        m.motor.write(2.0)
        box.silent()
        with pytest.raises(DriverError, match="no answer"):
            m.encoder.read()
        run(m, 0.6)
        box.back()
        run(m, 0.6)
        assert [text.partition(" after")[0] for text in events(connection)] == [
            "driver far is away: no answer",
            "driver far is back",
        ]
        assert (box.get("motor"), m.motor.read()) == (0, 0.0)  # it was initialised


def test_its_watchdog_is_armed_again() -> None:
    box, m = Box(), held()
    with running(m, box, watchdog="300 ms"):
        del box.calls[:]
        box.silent()
        run(m, 0.6)
        box.back()
        run(m, 1.0)
        assert [call.raws for call in box.segments("watchdog")] == [(0.3,)]


def test_incremental_sensors_lose_their_reference() -> None:
    box = Box()
    m = bench(encoder=sensor(incremental=True, on_error="hold", max_age="60 s"), limit=switch(on_error="mark"))
    with running(m, box):
        m.encoder.referenced()
        run(m, 0.01)
        assert m.encoder.quality is Quality.GOOD
        box.silent()
        run(m, 0.1)
        box.back()
        run(m, 0.2)
        assert m.encoder.quality is Quality.GOOD  # a short absence
        box.silent()
        run(m, 0.6)
        box.back()
        run(m, 1.0)
        assert m.encoder.quality is Quality.UNREFERENCED


def test_a_device_that_cannot_be_initialised_is_away_again() -> None:
    box, m = Box(), held()
    with running(m, box) as connection:
        box.silent()
        box.found = lambda: True
        since = len(box.calls)
        run(m, 5.0)
        segments = calls(box, since)
        assert segments.count("initialize") > 0
        assert len(segments) < 20
        assert len(events(connection)) == 1


def test_a_device_that_answers_a_look_and_refuses_every_transfer_is_not_initialised_again() -> None:
    box, m = Box(), held()
    with running(m, box) as connection:
        connection.image.transfer.now = lambda: 0.0  # no call takes long, however busy the computer is
        box.found = lambda: True
        box.broken = OSError("busy")
        since = len(box.calls)
        run(m, 2.0)
        assert calls(box, since) == ["read_many", "write_many"] * 2000


@pytest.mark.parametrize(
    ("error", "tries"), [(DeviceTimeout("no answer"), 0), (DriverError("gone"), 1), (LookupError("of a library"), 1)]
)
def test_a_device_that_must_be_tried_is_initialised_once_it_was_away_for_long(error: Exception, tries: int) -> None:
    box, m = Blind(), held()
    with running(m, box):
        box.broken = error
        run(m, 0.6)
        box.back()
        since = len(box.calls)
        run(m, 1.0)
        begun = calls(box, since)
        assert begun.count("initialize") == 4
        assert tries or begun[:5] == ["initialize"] * 4 + ["read_many"]


def test_a_device_that_can_be_initialised_and_refuses_every_transfer_is_tried_at_intervals() -> None:
    class Refusing(Blind):
        def initialize(self, channel: Any, default: int | None) -> None:
            broken, self.broken = self.broken, None
            super().initialize(channel, default)
            self.broken = broken

    box, m = Refusing(), held()
    with running(m, box):
        box.broken = OSError("busy")
        run(m, 0.5)
        since = len(box.calls)
        run(m, 5.0)
        assert 4 <= calls(box, since).count("initialize") <= 4 * 8


def test_what_an_asynchronous_actuator_had_is_sent_again_if_it_retries_else_it_stays_at_its_default() -> None:
    class Two(Compound):
        timer: DigitalSensor
        motor: DigitalActuator
        other: DigitalActuator

    kept = actuator(synchronous=False, on_error="retry", max_age="60 s")
    box, m = Box(), Two(timer=timer(), motor=kept, other=actuator(synchronous=False))
    with running(m, box):
        m.motor.write(2.0)
        m.other.write(3.0)
        box.silent()
        assert m.motor.write(4.0)
        run(m, 0.6)
        assert m.motor.quality is Quality.STALE
        box.back()
        run(m, 1.0)
        assert (box.get("motor"), m.motor.read(), m.motor.quality) == (8, 4.0, Quality.GOOD)
        assert (box.get("other"), m.other.read(), m.other.pending, m.other.quality) == (0, 0.0, 0.0, Quality.GOOD)


def test_an_initialisation_is_in_the_journal() -> None:
    box, m = Box(), held()
    with running(m, box) as connection:
        transfer = connection.image.transfer
        box.silent()
        run(m, 0.6)
        box.back()
        transfer.journal = Journal(100)
        kinds: list[Kind] = []
        transfer.journal.add = lambda slot, kind, *_: kinds.append(kind)  # type: ignore[method-assign]
        run(m, 0.3)
        assert kinds.count(Kind.INITIALIZE) == 4


def test_the_phases_of_a_period_are_measured_through_an_absence() -> None:
    box, m = Box(), held()
    with running(m, box) as connection:
        phases = PhaseTimes(connection.image, connection.wired.drivers)
        box.silent()
        run(m, 0.1)
        phases.clear()
        run(m, 0.001)
        assert all(phases.ns[phases.names.index(name)] > 0 for name in ("sample box", "update box"))
        box.back()
        run(m, 0.2)
        phases.clear()
        run(m, 0.001)
        assert all(phases.ns[phases.names.index(name)] > 0 for name in ("sample box", "update box"))
        phases.remove()
        assert connection.image.inputs[0].transfer == box.read_many


def test_the_tries_of_a_driver_that_is_away_are_a_phase_of_their_own() -> None:
    box, m = Blind(), held()
    with running(m, box) as connection:
        phases = PhaseTimes(connection.image, connection.wired.drivers)
        tries = phases.names.index("try box")
        box.silent()
        run(m, 0.6)
        assert phases.ns[tries] > 0
        phases.clear()
        run(m, 0.001)
        assert phases.ns[tries] == 0
        phases.remove()


def test_a_single_call_that_tries_a_driver_counts_as_a_try() -> None:
    class Pumps(Compound):
        timer: DigitalSensor
        pump: BinaryActuator[OnOff]

    box, m = Blind(), Pumps(timer=timer(), pump=relay(synchronous=False, on_error="retry", max_age="60 s"))
    with running(m, box) as connection:
        box.silent()
        m.pump.write(OnOff.ON)
        run(m, 0.06)
        since, told = len(box.calls), list[str]()
        connection.image.transfer.callees.away.tried = lambda name, ns: told.append(name)
        run(m, 0.2)
        assert told == ["box"] * 2 * calls(box, since).count("write")  # a look, then the call itself
        box.back()


def test_the_calls_of_a_driver_that_is_there_are_its_own() -> None:
    box, m = Box(), held()
    with running(m, box) as connection:
        image = connection.image
        box.silent()
        run(m, 0.2)
        assert image.inputs[0].transfer != box.read_many
        box.back()
        run(m, 0.2)
        assert image.inputs[0].transfer == box.read_many
        assert image.outputs[0].transfer == box.write_many


# Anything -------------------------------------------------------------------------------------------------

STATES = {
    "there": (None, True),
    "silent": (DeviceTimeout("no answer"), False),
    "silent, not known": (DeviceTimeout("no answer"), None),
    "silent, found": (DeviceTimeout("no answer"), True),
    "refuses": (OSError("refused"), False),
    "refuses, found": (OSError("refused"), True),
    "away behind a gateway": (None, False),
}
"""What every call raises, and what a look says."""
WAYS = st.lists(
    st.tuples(st.sampled_from([*STATES]), st.sampled_from([1, 2, 40, 600]), st.booleans()), min_size=1, max_size=8
)


@given(WAYS, st.booleans())
@budget(5, 12)
def test_whatever_a_device_does_it_has_what_is_pending_when_it_is_back_and_few_calls_have_waited(
    ways: list[tuple[str, int, bool]], synchronous: bool
) -> None:
    box = Box()
    m = bench(
        motor=actuator(on_error="retry", max_age="60 s", synchronous=synchronous),
        encoder=sensor(on_error="hold", max_age="60 s"),
        valve=relay(on_error="retry", max_age="60 s"),
        limit=switch(on_error="mark"),
    )
    with running(m, box) as connection:
        image, on_tick = connection.image, connection.machine.clock.on_tick
        for number, (state, count, write) in enumerate(ways):
            box.broken, found = STATES[state]
            box.found = lambda found=found: found  # type: ignore[misc]
            if write:
                assert m.motor.write(float(number))
            since = len(box.calls)
            periods(m, count)
            if state.startswith("silent"):
                assert len(box.calls) - since <= 2 + 2 * len(box.looks)
        box.back()
        box.found = lambda: True
        periods(m, 5_600)  # the longest interval, and more
        assert [item.quality for item in (m.motor, m.encoder, m.valve, m.limit)] == [Quality.GOOD] * 4
        assert box.get("motor") == 2 * m.motor.pending == 2 * m.motor.read()
        assert image.inputs[0].transfer == box.read_many
        assert image.outputs[0].transfer == box.write_many
        assert connection.machine.clock.on_tick == on_tick
