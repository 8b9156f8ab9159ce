"""Actuators with on_error="retry": what is pending is sent again in every period until it is confirmed."""

from __future__ import annotations

from typing import Any

import pytest

from helpers.machines import Bench, actuator, bench, failed, relay, sensor, wired
from umo import Compound, DigitalActuator, LookupTable, Quality, Vector, check, connect
from umo.drivers import Channel, ChannelsFailed, Direction, DriverError, WiringError
from umo.drivers.counter import Counter
from umo.drivers.text import Text
from umo.errors import DeclarationError
from umo.states import OnOff
from umo.testing import Scripted, periods

RETRY: dict[str, Any] = {"on_error": "retry", "max_age": "10 ms"}


class Box(Scripted):
    """A circuit some of whose outputs do not confirm."""

    def __init__(self) -> None:
        super().__init__()
        self.bad: set[str] = set()
        self.cause = "not confirmed"

    def write(self, channel: Channel, raw: int) -> None:
        super().write(channel, raw)
        if channel.text in self.bad:
            raise DriverError(self.cause)

    def reset(self, channel: Channel, default: int | None) -> None:
        super().reset(channel, default)
        if channel.text in self.bad:
            raise DriverError(self.cause)

    def write_many(self, channels: Any, raws: Any) -> None:
        super().write_many(channels, raws)
        if bad := [channel.text for channel in channels if channel.text in self.bad]:
            raise ChannelsFailed(dict.fromkeys(bad, self.cause))


def machine(**changes: Any) -> Bench:
    return bench(motor=actuator(**RETRY, **changes), valve=relay(**RETRY, **changes))


def sent(box: Box, since: int = 0) -> list[tuple[Any, ...]]:
    return [call.raws for call in box.calls[since:] if call.segment.startswith("write")]


# Synchronous ----------------------------------------------------------------------------------------------


def test_a_value_that_was_not_confirmed_is_stale_and_sent_again_until_it_is_confirmed() -> None:
    box, m = Box(), machine()
    with connect(m, wired(m, box)):
        periods(m)
        m.motor.write(1.0)
        box.bad = {"motor"}
        periods(m, 10)
        assert (m.motor.read(), m.motor.pending, m.motor.quality) == (0.0, 1.0, Quality.STALE)
        assert m.valve.quality is Quality.GOOD
        box.bad = set()
        periods(m)
        assert (m.motor.read(), m.motor.quality) == (1.0, Quality.GOOD)


def test_a_value_older_than_max_age_fails_as_without_a_retry_and_is_good_when_it_is_confirmed() -> None:
    box, m = Box(), machine()
    with connect(m, wired(m, box)):
        periods(m)
        box.bad = {"motor"}
        periods(m, 10)
        for _ in range(3):
            with pytest.raises(DriverError, match="not confirmed") as caught:
                periods(m)
            assert failed(caught.value) == ["motor"]
            assert m.motor.quality is Quality.BAD
        box.bad = set()
        periods(m)
        assert m.motor.quality is Quality.GOOD


def test_the_latest_value_is_sent_not_the_one_that_was_lost() -> None:
    box, m = Box(), machine()
    with connect(m, wired(m, box)):
        box.bad = {"motor"}
        m.motor.write(1.0)
        periods(m)
        m.motor.write(2.0)
        box.bad = set()
        periods(m)
        assert box.get("motor") == 4


def test_a_vector_and_a_part_retry_too() -> None:
    class Row(Compound):
        motors: list[DigitalActuator]

    box, m = Box(), Row(motors=[actuator(**RETRY), actuator(**RETRY)])
    with connect(m, wired(m, box)):
        box.bad = {"motors.1"}
        assert Vector(m.motors).update()
        assert [motor.quality for motor in m.motors] == [Quality.GOOD, Quality.STALE]
        assert m.motors[1].update()
        box.bad = set()


class Raising(LookupTable):
    broken = False

    def to_input(self, value: float) -> float:
        if Raising.broken:
            raise ValueError("off the table")
        return super().to_input(value)


def test_a_linearization_that_raises_is_no_lost_answer() -> None:
    table = Raising([-10.0, 10.0], [-10.0, 10.0])
    box, m = Box(), bench(motor=actuator(**RETRY, linearization=table))
    with connect(m, wired(m, box)):
        m.motor.write(3.0)
        Raising.broken = True
        with pytest.raises(DriverError, match="its linearization failed"):
            periods(m)
        Raising.broken = False


# Asynchronous ---------------------------------------------------------------------------------------------


def test_an_asynchronous_write_that_was_not_confirmed_returns_true_and_is_sent_again_in_every_period() -> None:
    box, m = Box(), machine(synchronous=False)
    with connect(m, wired(m, box)):
        periods(m, 1000)  # the last confirmation is long ago
        since = len(box.calls)
        box.bad = {"motor"}
        assert m.motor.write(3.0)
        assert (m.motor.read(), m.motor.pending, m.motor.quality) == (0.0, 3.0, Quality.STALE)
        periods(m, 9)
        assert sent(box, since) == [(6,)] * 10
        box.bad = set()
        periods(m, 5)
        assert sent(box, since) == [(6,)] * 11
        assert (m.motor.read(), m.motor.quality) == (3.0, Quality.GOOD)


def test_an_asynchronous_value_older_than_max_age_fails_once_in_the_period() -> None:
    box, m = Box(), machine(synchronous=False)
    with connect(m, wired(m, box)):
        box.bad = {"motor"}
        assert m.motor.write(3.0)
        periods(m, 10)
        since = len(box.calls)
        with pytest.raises(DriverError, match="not confirmed") as caught:
            periods(m)
        assert failed(caught.value) == ["motor"]
        assert m.motor.quality is Quality.BAD
        periods(m, 3)
        assert len(sent(box, since)) == 1
        with pytest.raises(DriverError):
            m.motor.write(4.0)
        box.bad = set()
        assert m.motor.write(4.0)
        assert m.motor.quality is Quality.GOOD
        box.bad = {"motor"}
        assert m.motor.write(5.0)  # a new time begins
        box.bad = set()


def test_another_value_takes_the_place_of_the_one_that_is_sent_again() -> None:
    box, m = Box(), machine(synchronous=False)
    with connect(m, wired(m, box)):
        box.bad = {"valve"}
        m.valve.write(OnOff.ON)
        periods(m)
        m.valve.write(OnOff.OFF)
        since = len(box.calls)
        periods(m)
        assert sent(box, since) == [(0,)]
        box.bad = set()
        periods(m)
        assert (m.valve.read(), m.valve.quality) == (OnOff.OFF, Quality.GOOD)


@pytest.mark.parametrize("synchronous", [True, False])
def test_a_reset_in_the_run_that_was_not_confirmed_is_sent_again_and_then_fails(synchronous: bool) -> None:
    box, m = Box(), machine(synchronous=synchronous)
    with connect(m, wired(m, box)):
        m.motor.write(3.0)
        periods(m)
        box.bad = {"motor"}
        m.motor.reset()
        assert (m.motor.read(), m.motor.pending, m.motor.quality) == (3.0, 0.0, Quality.STALE)
        since = len(box.calls)
        periods(m, 9)
        assert len(sent(box, since)) == 9
        assert box.segments("reset")[-1].number < since
        with pytest.raises(DriverError, match="not confirmed"):
            periods(m, 2)
        box.bad = set()
        periods(m)
        assert (box.get("motor"), m.motor.read(), m.motor.quality) == (0, 0.0, Quality.GOOD)


# Declaration and wiring -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"on_error": "retry"}, 'on_error="retry" needs a max_age'),
        ({"max_age": 1.0}, 'max_age is for on_error="retry"'),
        ({"on_error": "hold", "max_age": 1.0}, "on_error='hold' is none of 'raise', 'retry'"),
    ],
)
def test_options_that_do_not_fit_are_refused(options: Any, words: str) -> None:
    for make in (actuator, relay):
        with pytest.raises(DeclarationError, match=words):
            make(**options)


def test_the_time_is_in_the_description() -> None:
    assert actuator(on_error="retry", max_age="2 s").describe().endswith(", sent again for 2 s")
    assert relay(on_error="retry", max_age="2 s").describe().endswith(", sent again for 2 s")


@pytest.mark.parametrize(
    "parts",
    [
        {"motor": actuator(on_error="retry", max_age="0.5 ms")},
        {"motor": actuator(on_error="retry", max_age="0.5 ms", synchronous=False)},
        {"encoder": sensor(on_error="hold", max_age="0.5 ms")},
        {"encoder": sensor(on_error="mark", max_age="0.5 ms")},
    ],
)
def test_a_time_shorter_than_the_period_can_never_hold_and_is_refused(parts: dict[str, Any]) -> None:
    [path], m = parts, bench(**parts)
    assert [str(mistake) for mistake in check(m, wired(m, Scripted()))] == [
        f'wiring: wire."timer".period: 1 ms is longer than `max_age` of {path} (500 µs)'
    ]


def test_a_time_of_one_period_is_accepted_and_one_of_an_asynchronous_sensor_is_its_own() -> None:
    for parts in (
        {"motor": actuator(on_error="retry", max_age="1 ms")},
        {"encoder": sensor(on_error="hold", max_age="0.5 ms", synchronous=False)},
    ):
        m = bench(**parts)
        assert check(m, wired(m, Scripted())) == []


def test_a_channel_whose_writes_are_events_is_refused_for_an_actuator_that_retries() -> None:
    class Step(Channel):
        """A step of a motor."""

        @property
        def event(self) -> bool:
            return True

    box = Scripted(channels=[Step("step", Direction.BOTH, 16, True)])

    class One(Compound):
        motor: DigitalActuator

    def wiring(motor: DigitalActuator) -> tuple[One, dict[str, Any]]:
        entry = {"driver": "box", "channel": "step"}
        return One(motor=motor), {"drivers": {"box": box}, "wire": {"motor": entry}}

    assert check(*wiring(actuator())) == []
    assert [str(mistake) for mistake in check(*wiring(actuator(**RETRY)))] == [
        'wiring: wire."motor".channel: on_error="retry" sends a value again, but a write to channel \'step\' is an '
        'event, which must not happen twice; declare on_error="raise" (a text channel that sets a level: '
        "sets_level = true)"
    ]


def test_a_text_command_is_an_event_unless_its_table_says_that_it_sets_a_level() -> None:
    def channel(**table: Any) -> Channel:
        return Text(channels={"out": table}, host="127.0.0.1").channel("out")

    assert channel(set="OUT {}").event
    assert not channel(set="OUT {}", sets_level=True).event
    assert not channel(ask="OUT?").event
    with pytest.raises(WiringError, match="sets_level needs set"):
        channel(ask="OUT?", sets_level=True)
    with pytest.raises(WiringError, match="sets_level must be true or false, not 1"):
        channel(set="OUT {}", sets_level=1)


def test_a_count_that_is_set_is_an_event_and_the_other_files_of_a_counter_hold_levels() -> None:
    assert [Counter().channel(f"{name}:0").event for name in ("count", "preset", "enable")] == [True, False, False]
