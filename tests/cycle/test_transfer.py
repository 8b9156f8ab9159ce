"""The transfer stage: some channels of a transfer fail and the others stand; what an exception of a driver means."""

from __future__ import annotations

import pickle
import random
import re
import traceback
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from helpers.machines import actuator, failed, relay, sensor, switch, timer, wired
from helpers.publishing import without_times
from umo import (
    BinaryActuator,
    BinarySensor,
    Compound,
    DigitalActuator,
    DigitalSensor,
    Quality,
    Vector,
    connect,
    published,
)
from umo.cycle.journal import ErrorKind, Kind
from umo.cycle.showing import frame_of
from umo.drivers import Channel, ChannelsFailed, DeviceTimeout, Direction, Driver, DriverError
from umo.drivers.contract import IntArray
from umo.process.frames import Reader
from umo.states import OnOff, PassFail
from umo.testing import Scripted, VirtualTimer, periods

PASSED, FAILED = PassFail.PASS, PassFail.FAIL


class Line(Compound):
    """Three sensors and three actuators, all of one circuit."""

    timer: DigitalSensor
    levels: list[DigitalSensor]
    full: BinarySensor[PassFail]
    motors: list[DigitalActuator]
    lamp: BinaryActuator[OnOff]


def line(**changes: Any) -> Line:
    levels = [sensor(**changes), sensor(**changes)]
    return Line(timer=timer(), levels=levels, full=switch(), motors=[actuator(), actuator()], lamp=relay())


class Bus(Driver):
    """A circuit of single channels (its block transfers are derived) that remembers what it was asked for, in order."""

    def __init__(self) -> None:
        self.raws: dict[str, int] = {}
        self.asked: list[str] = []
        self.causes: dict[str, Exception] = {}
        """By channel, what a call of it raises."""

    def channel(self, text: str) -> Channel:
        return Channel(text, Direction.BOTH, 16, signed=True)

    def read(self, channel: Channel) -> int:
        self._ask(channel)
        return self.raws.get(channel.text, 0)

    def write(self, channel: Channel, raw: int) -> None:
        self._ask(channel)
        self.raws[channel.text] = raw

    def _ask(self, channel: Channel) -> None:
        self.asked.append(channel.text)
        if channel.text in self.causes:
            raise self.causes[channel.text]


class Block(Scripted):
    """A circuit with block transfers of its own, some channels of which may fail; the rest is moved all the same."""

    def __init__(self) -> None:
        super().__init__()
        self.causes: dict[str, Exception | str] = {}

    def read_many(self, channels: Sequence[Channel], out: IntArray) -> None:
        super().read_many(channels, out)
        self._fail(channels, out)

    def write_many(self, channels: Sequence[Channel], raws: IntArray) -> None:
        good = [i for i, channel in enumerate(channels) if channel.text not in self.causes]
        super().write_many([channels[i] for i in good], raws[good])
        self._fail(channels)

    def _fail(self, channels: Sequence[Channel], out: IntArray | None = None) -> None:
        found = {channel.text: self.causes[channel.text] for channel in channels if channel.text in self.causes}
        if found:
            if out is not None:  # what a failed channel left in the buffer is nobody's reading
                out[[channel.text in found for channel in channels]] = 7
            raise ChannelsFailed(found)


# A whole period -----------------------------------------------------------------------------------------


@pytest.mark.usefixtures("each_way")
@pytest.mark.parametrize("kind", [Bus, Block])
def test_a_sample_keeps_the_channels_that_stand_and_one_error_names_the_failed_ones(kind: type[Any]) -> None:
    box, m = kind(), line()
    with connect(m, wired(m, box)):
        put(box, {"levels.0": 20, "levels.1": 40, "full": 1})
        box.causes = {"levels.1": OSError("broken wire")}
        m.timer.read()
        with pytest.raises(DriverError, match=r"could not be read: box: broken wire; levels\.1$") as e:
            m.sample()
        assert failed(e.value) == ["levels.1"]
        assert (m.levels[0].read(), m.levels[1].read(), m.full.read()) == (10.0, 0.0, FAILED)
        assert (m.levels[0].raw, m.levels[1].raw, m.full.raw) == (20, 0, 1)
        assert (m.levels[0].time, m.levels[1].time) == (0.001, 0.0)
        assert [s.quality for s in (*m.levels, m.full)] == [Quality.GOOD, Quality.BAD, Quality.GOOD]
        box.causes = {}
        m.timer.read()
        assert m.sample() is True
        assert (m.levels[1].read(), m.levels[1].quality) == (20.0, Quality.GOOD)


@pytest.mark.usefixtures("each_way")
@pytest.mark.parametrize("kind", [Bus, Block])
def test_an_update_keeps_the_channels_that_stand_and_one_error_names_the_failed_ones(kind: type[Any]) -> None:
    box, m = kind(), line()
    with connect(m, wired(m, box)):
        m.motors[0].write(1.0)
        m.motors[1].write(2.0)
        m.lamp.write(OnOff.ON)
        box.causes = {"motors.0": OSError("no load")}
        m.timer.read()
        with pytest.raises(DriverError, match=r"could not be written: box: no load; motors\.0$") as e:
            m.update()
        assert failed(e.value) == ["motors.0"]
        assert (m.motors[0].read(), m.motors[1].read(), m.lamp.read()) == (0.0, 2.0, OnOff.ON)
        assert (m.motors[0].raw, m.motors[1].raw, m.lamp.raw) == (0, 4, 1)
        assert (m.motors[0].time, m.motors[1].time) == (0.0, 0.001)
        assert [a.quality for a in (*m.motors, m.lamp)] == [Quality.BAD, Quality.GOOD, Quality.GOOD]
        box.causes = {}
        assert m.update() is True
        assert (m.motors[0].read(), m.motors[0].quality) == (1.0, Quality.GOOD)


class Mistaken(Bus):
    """A circuit whose driver has a mistake in its code for one of its channels."""

    def read(self, channel: Channel) -> int:
        return self.raws["no such key" if channel.text == "levels.1" else "levels.1"]


def test_a_mistake_in_the_code_of_a_driver_has_its_place_and_its_lines_in_the_traceback() -> None:
    m, box = line(), Mistaken()
    box.raws["levels.1"] = 0
    with pytest.raises(DriverError) as caught, connect(m, wired(m, box)):
        m.sample()
    place = r"\(\S*test_transfer\.py:\d+ in read\)"
    assert re.match(rf"could not be read: box: KeyError: 'no such key' {place}; levels.0", str(caught.value))
    assert isinstance(caught.value.__cause__, KeyError)
    assert caught.value.__cause__.__traceback__ is None  # nothing that the driver used is kept alive
    shown = "".join(traceback.format_exception(caught.value))
    assert shown.count('return self.raws["no such key" if') == 1
    assert re.match(r"KeyError: 'no such key'\n  File \S*test_transfer\.py", shown)
    assert type(pickle.loads(pickle.dumps(caught.value)).failures[0].cause) is str


class Halves(Bus):
    """A circuit whose driver returns a float for one of its channels."""

    def read(self, channel: Channel) -> int:
        return 12.5 if channel.text == "levels.0" else 0  # type: ignore[return-value]


@pytest.mark.parametrize("synchronous", [True, False])
def test_a_reading_that_is_no_whole_number_fails_for_its_object_alone(synchronous: bool) -> None:
    m = line(synchronous=synchronous)
    with pytest.raises(DriverError) as caught, connect(m, wired(m, Halves())):
        m.sample() if synchronous else m.levels[0].read()
    what = r"the reading of channel levels\.0 is 12\.5 \(float\): a whole number is needed"
    assert re.search(rf"{what} \(\S*test_transfer\.py:\d+ in read\); levels\.0$", str(caught.value))


def test_a_channel_that_failed_is_held_where_that_was_declared_and_the_block_does_not_fail() -> None:
    box, m = Bus(), line(on_error="hold", max_age="3 ms")
    with connect(m, wired(m, box)):
        put(box, {"levels.0": 20, "levels.1": 40})
        box.causes = {"levels.1": OSError("broken wire")}
        m.timer.read()
        assert m.sample() is False
        assert [s.quality for s in m.levels] == [Quality.GOOD, Quality.STALE]
        assert (m.levels[0].read(), m.levels[1].read()) == (10.0, 0.0)


@pytest.mark.usefixtures("each_way")
def test_what_stands_beside_a_failed_channel_is_judged_as_ever() -> None:
    box, m = Block(), line()
    with connect(m, wired(m, box)):
        put(box, {"levels.0": 999, "full": 2})
        box.causes = {"levels.1": "broken wire"}
        m.timer.read()
        with pytest.raises(DriverError) as e:
            m.sample()
        assert failed(e.value) == ["levels.1", "full"]
        assert [s.quality for s in (*m.levels, m.full)] == [Quality.OUT_OF_RANGE, Quality.BAD, Quality.BAD]


@pytest.mark.parametrize(
    "error",
    [OSError("cut"), ChannelsFailed({"nobody's": "x"}), ChannelsFailed({}), ValueError("bug")],
)
def test_an_error_that_names_no_channel_of_the_transfer_fails_all_of_them(error: Exception) -> None:
    box, m = Scripted(), line()
    with connect(m, wired(m, box)):
        box.at(len(box.calls), error)
        with pytest.raises(DriverError) as e:
            m.sample()
        assert failed(e.value) == ["levels.0", "levels.1", "full"]
        box.at(len(box.calls), error)
        with pytest.raises(DriverError) as e:
            m.update()
        assert failed(e.value) == ["motors.0", "motors.1", "lamp"]


# Some objects -------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("each_way")
@pytest.mark.parametrize("kind", [Bus, Block])
def test_a_part_or_a_vector_keeps_the_channels_that_stand_too(kind: type[Any]) -> None:
    box, m = kind(), line()
    with connect(m, wired(m, box)):
        put(box, {"levels.0": 20, "levels.1": 40})
        box.causes = {"levels.0": OSError("broken wire"), "motors.1": OSError("no load")}
        with pytest.raises(DriverError) as e:
            Vector(m.levels).sample()
        assert failed(e.value) == ["levels.0"]
        assert [s.read() for s in m.levels] == [0.0, 20.0]
        assert [s.quality for s in m.levels] == [Quality.BAD, Quality.GOOD]
        motors = Vector(m.motors)
        motors.write([1.0, 2.0])
        with pytest.raises(DriverError) as e:
            motors.update()
        assert failed(e.value) == ["motors.1"]
        assert [a.read() for a in m.motors] == [1.0, 0.0]
        assert [a.quality for a in m.motors] == [Quality.GOOD, Quality.BAD]
        box.causes = {}


# The derived block transfers ----------------------------------------------------------------------------

CHANNELS = [Bus().channel(text) for text in "abcd"]


def test_the_derived_transfers_go_on_after_a_channel_that_failed_and_name_all_that_did() -> None:
    bus, out = Bus(), np.full(4, -1, np.int64)
    bus.raws = {"a": 1, "b": 2, "c": 3, "d": 4}
    bus.causes = {"b": OSError("broken wire"), "d": DriverError("no load")}
    with pytest.raises(ChannelsFailed) as e:
        bus.read_many(CHANNELS, out)
    assert e.value.causes == {"b": "broken wire", "d": "no load"}
    assert out.tolist() == [1, -1, 3, -1]
    with pytest.raises(ChannelsFailed) as e:
        bus.write_many(CHANNELS, np.array([5, 6, 7, 8]))
    assert e.value.causes == {"b": "broken wire", "d": "no load"}
    assert bus.raws == {"a": 5, "b": 2, "c": 7, "d": 4}
    assert bus.asked == [*"abcd", *"abcd"]


@pytest.mark.parametrize("late", [TimeoutError("late"), DeviceTimeout("late")])
def test_the_derived_transfers_do_not_go_on_after_a_timeout(late: Exception) -> None:
    bus, out = Bus(), np.zeros(4, np.int64)
    bus.causes = {"a": OSError("broken wire"), "b": late}
    for call in (lambda: bus.read_many(CHANNELS, out), lambda: bus.write_many(CHANNELS, out)):
        bus.asked.clear()
        with pytest.raises(TimeoutError):
            call()
        assert bus.asked == ["a", "b"]


@pytest.mark.parametrize("bug", [ValueError("bug"), KeyError("k")])
def test_a_fault_of_the_driver_itself_comes_out_of_the_derived_transfers_at_once(bug: Exception) -> None:
    bus, out = Bus(), np.zeros(4, np.int64)
    bus.causes = {"a": bug}
    for call in (lambda: bus.read_many(CHANNELS, out), lambda: bus.write_many(CHANNELS, out)):
        bus.asked.clear()
        with pytest.raises(type(bug)):
            call()
        assert bus.asked == ["a"]


# Whether a request may still be under way ---------------------------------------------------------------


class Real(Bus):
    def devices(self) -> list[str]:
        return ["a test's bus"]


class RealClock(VirtualTimer):
    realtime = True


@pytest.mark.parametrize(
    ("kind", "channel", "error", "times"),
    [
        (Real, "motors.0", OSError("cut"), 2),
        (Real, "motors.0", TimeoutError("late"), 2),
        (Real, "motors.0", ValueError("bug"), 2),
        (Real, "levels.0", OSError("cut"), 1),  # a request to read changes nothing
        (Bus, "motors.0", OSError("cut"), 1),  # not on hardware
    ],
)
def test_after_a_write_that_failed_on_hardware_everything_is_reset_a_second_time_later(
    kind: type[Bus], channel: str, error: Exception, times: int
) -> None:
    box, m = kind(), line()
    pauses: list[float] = []
    connection = connect(m, wired(m, box, clock=RealClock()))
    connection.pause = pauses.append
    with connection:
        box.causes = {channel: error}
        with pytest.raises(DriverError):
            m.sample() and m.update()
        box.causes = {}
        box.asked.clear()
    assert box.asked == ["motors.0", "motors.1", "lamp"] * times
    assert bool(pauses) is (times == 2)


def put(box: Bus | Block, raws: dict[str, int]) -> None:
    """What the channels of a circuit read from now on."""
    if isinstance(box, Bus):
        box.raws |= raws
    else:
        for text, raw in raws.items():
            box.set(text, raw)


# The journal ----------------------------------------------------------------------------------------------


class Cell(Compound):
    """Every kind of object, for a replay."""

    timer: DigitalSensor
    sensors: list[DigitalSensor]
    motors: list[DigitalActuator]
    probe: DigitalSensor
    relays: list[BinaryActuator[OnOff]]


def cell() -> Cell:
    return Cell(
        timer=timer(),
        sensors=[sensor() for _ in range(3)],
        motors=[actuator() for _ in range(3)],
        probe=sensor(synchronous=False),
        relays=[relay(synchronous=False) for _ in range(2)],
    )


STEPS = st.lists(st.sampled_from(["sample", "part", "motor", "probe", "relay", "vector", "reset", "fail"]), max_size=10)


@pytest.mark.usefixtures("each_way")
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=150)
@given(before=STEPS, after=STEPS, seed=st.integers(0, 9))
@pytest.mark.full
def test_from_a_frame_back_over_its_journal_stands_what_the_whole_machine_sampled(
    before: list[str], after: list[str], seed: int
) -> None:
    numbers = random.Random(seed)
    script = {name: lambda: numbers.randrange(200) for name in ("sensors.0", "sensors.1", "sensors.2", "probe")}
    machine, box = cell(), Scripted(script)
    connection = connect(machine, wired(machine, box))
    with connection as m, published(connection, "cell") as ring, Reader(ring.path) as reader:
        relays = Vector(m.relays)
        work: dict[str, Callable[[], object]] = {
            "sample": m.sample,
            "part": m.sensors[1].sample,
            "motor": m.motors[0].update,
            "probe": m.probe.read,
            "relay": lambda: m.relays[0].write(numbers.choice([OnOff.ON, OnOff.OFF])),
            "vector": lambda: relays.write(numbers.choice([OnOff.ON, OnOff.OFF])),
            "reset": m.reset,
            "fail": lambda: box.at(len(box.calls), OSError("cut")),
        }
        periods(m)
        m.timer.read()

        def do(steps: list[str]) -> None:
            for step in steps:
                with suppress(DriverError):
                    work[step]()

        do([step for step in before if step != "sample"])
        count, stood = ring.journal.count, list(connection.image.raws)
        do(["sample"])
        sampled = list(connection.image.raws)
        for each in m.relays:  # a default that was not accepted is sent again after the transfer of a sample
            slot = connection.image.slot_of[id(each)]
            sampled[slot] = stood[slot]
        do(after)
        ended = ring.journal.count
        with suppress(DriverError):
            m.update()
        m.timer.read()  # a period that failed is shown before the next one
        (frame,) = reader.last(1)
        entries = reader.journal(frame)
        assert entries is not None
        assert (frame["sampled"], frame["updated"]) == (count, ended)
        assert set(entries["kind"][ended:].tolist()) <= {Kind.FAILED_WRITE}  # of the update's own
        raws = frame["raws"].tolist()
        for slot, *_, stood in reversed(without_times(entries[count:])):
            raws[slot] = stood
        outputs = {slot for block in connection.image.outputs for slot in range(block.start, block.stop)}
        unsent = [slot for slot in range(len(raws)) if slot not in outputs]  # those moved again with the update
        assert [raws[slot] for slot in unsent] == [sampled[slot] for slot in unsent]


def test_a_second_sample_of_the_whole_machine_in_one_period_is_in_the_journal() -> None:
    machine, box = cell(), Scripted({"sensors.0": [1, 2, 3, 4], "sensors.1": 7, "sensors.2": 8})
    connection = connect(machine, wired(machine, box))
    with connection as m, published(connection, "cell") as ring, Reader(ring.path) as reader:
        m.timer.read()
        m.sample()
        m.sample()
        m.update()
        (frame,) = reader.last(1)
        entries = reader.journal(frame)
        assert entries is not None
        slot = connection.image.slot_of[id(m.sensors[0])]
        assert (slot, Kind.READ, ErrorKind.NONE, 3, 2) in without_times(entries)
        assert frame["sampled"] == 0


def test_the_channels_of_a_block_that_failed_are_in_the_journal_with_what_was_commanded_and_the_kind_of_error() -> None:
    machine, box = cell(), Scripted()
    connection = connect(machine, wired(machine, box))
    with connection as m, published(connection, "cell") as ring, Reader(ring.path) as reader:
        slot_of = {path: slot for slot, path in enumerate(reader.paths)}
        for error, kind in (
            (ChannelsFailed({"motors.1": "overload"}), ErrorKind.CHANNELS),
            (TimeoutError("no answer"), ErrorKind.TIMEOUT),
            (OSError("cut"), ErrorKind.OTHER),
        ):
            m.sample()
            m.motors[1].write(2.0)
            box.broken = error
            with suppress(DriverError):
                m.update()
            box.broken = None
            m.timer.read()  # a period that failed is shown before the next one
            entries = reader.journal(reader.latest())
            assert entries is not None
            paths = ["motors.1"] if kind is ErrorKind.CHANNELS else [f"motors.{number}" for number in range(3)]
            raws = {"motors.0": 0, "motors.1": 4, "motors.2": 0}
            entries = entries[entries["kind"] != Kind.LOOKED]  # for the box, which was away
            assert without_times(entries) == [(slot_of[path], Kind.FAILED_WRITE, kind, raws[path], 0) for path in paths]
        m.timer.read()
        box.broken = OSError("cut")
        with suppress(DriverError):
            m.sample()
        box.broken = None
        m.update()
        entries = reader.journal(reader.latest())
        assert entries is not None
        found = [(slot_of[f"sensors.{number}"], Kind.FAILED_READ, ErrorKind.OTHER, 0, 0) for number in range(3)]
        assert without_times(entries[entries["kind"] != Kind.LOOKED]) == found


def test_a_block_moved_again_that_fails_as_a_whole_has_moved_nothing_in_the_journal() -> None:
    """`ChannelsFailed` that names no channel of the block means that all of them failed."""
    machine, box = cell(), Scripted()
    connection = connect(machine, wired(machine, box))
    with connection as m, published(connection, "cell") as ring, Reader(ring.path) as reader:
        m.timer.read()
        m.update()
        box.broken = ChannelsFailed({"nobody's": "x"})
        with suppress(DriverError):
            m.update()
        box.broken = None
        m.timer.read()
        entries = reader.journal(reader.latest())
        assert entries is not None
        assert {(each["kind"], each["error"]) for each in entries} == {(Kind.FAILED_WRITE, ErrorKind.OTHER)}
        assert len(entries) == 3


def test_the_journals_of_objects_that_fail_for_long_are_kept_as_long_as_their_frames() -> None:
    machine, box = cell(), Scripted()
    connection = connect(machine, wired(machine, box))
    with connection as m, published(connection, "cell") as ring, Reader(ring.path) as reader:
        m.timer.read()
        box.broken = OSError("cut")
        for _ in range(3000):  # times six objects
            for transfer in (m.sample, m.update):
                with suppress(DriverError):
                    transfer()
            ring(frame_of(connection.machine))
        box.broken = None
        oldest = reader.read()[1]
        entries = reader.journal(oldest)
        assert entries is not None
        assert len(entries) == len(machine.sensors) + len(machine.motors)
