"""Every value has its time and a quality; failing devices."""

from __future__ import annotations

import math
from collections.abc import Sequence

import pytest

from helpers.machines import actuator, failed, relay, sensor, switch, timer, wired
from umo import (
    BinaryActuator,
    BinarySensor,
    Compound,
    DigitalActuator,
    DigitalSensor,
    Interlock,
    Quality,
    Vector,
    connect,
    published,
)
from umo.control import HOMING, state_of, value_of
from umo.errors import BadInput, ChannelsFailed, DeclarationError, DriverError, RangeError
from umo.process.frames import Reader
from umo.states import OnOff, PassFail
from umo.testing import Scripted, VirtualTimer, put

GOOD, OUT_OF_RANGE, STALE, BAD = Quality.GOOD, Quality.OUT_OF_RANGE, Quality.STALE, Quality.BAD
UNREF = Quality.UNREFERENCED
DEAD_MAN_TIME = {"on_error": "hold", "max_age": "3 ms"}


pytestmark = pytest.mark.usefixtures("each_way")


class Motors(Compound):
    timer: DigitalSensor
    motors: Sequence[DigitalActuator]


class Inputs(Compound):
    timer: DigitalSensor
    one: DigitalSensor
    two: BinarySensor[PassFail]


@pytest.fixture
def box():
    return Scripted()


def inputs(one=None, two=None):
    return Inputs(timer=timer(), one=one or sensor(), two=two or switch())


def period(m):
    m.timer.read()
    return m.sample()


# Range -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("raw", "quality"), [(0, GOOD), (-1, OUT_OF_RANGE), (199, GOOD), (200, OUT_OF_RANGE)])
@pytest.mark.parametrize("synchronous", [True, False])
def test_half_a_resolution_beyond_a_bound_is_good_and_more_is_out_of_range(box, raw, quality, synchronous):
    machine = inputs(sensor(minimum=0.25, maximum=99.25, resolution=0.5, synchronous=synchronous))
    box.set("one", raw)
    with connect(machine, wired(machine, box)) as m:
        assert m.one.read() == raw * 0.5  # the value is shown all the same
        assert m.one.quality is quality
        assert m.sample() is (quality is GOOD or not synchronous)


def test_half_a_resolution_is_that_of_the_size_when_the_resolution_is_negative(box):
    machine = inputs(sensor(minimum=0.25, maximum=99.25, resolution=-0.5))
    box.set("one", [0, 1, -198, -199, -200])
    with connect(machine, wired(machine, box)) as m:
        seen = [m.one.quality]
        for _ in range(4):
            m.sample()
            seen.append(m.one.quality)
        assert seen == [GOOD, OUT_OF_RANGE, GOOD, GOOD, OUT_OF_RANGE]


def test_a_narrowed_range_is_the_one_that_counts(box):
    machine = inputs()
    box.set("one", 100)
    with connect(machine, wired(machine, box, entries={"one": {"maximum": 40.0}})) as m:
        assert (m.one.read(), m.one.quality) == (50.0, OUT_OF_RANGE)


def test_sample_returns_whether_all_are_good_and_recovers(box):
    machine = inputs()
    with connect(machine, wired(machine, box)) as m:
        put(m.one, 101.0)
        assert m.sample() is False
        assert m.one.sample() is False
        assert m.two.sample() is True
        put(m.one, 99.0)
        assert m.sample() is True
        assert m.one.quality is GOOD


# References ------------------------------------------------------------------------------------------


def test_an_incremental_sensor_is_unreferenced_until_homing_says_so(box):
    machine = inputs(sensor(incremental=True))
    box.set("one", 20)
    with connect(machine, wired(machine, box)) as m:
        assert (m.one.read(), m.one.quality) == (10.0, UNREF)
        assert m.sample() is False
        m.one.referenced()
        assert m.one.quality is GOOD
        assert m.sample() is True
        m.one.referenced(False)
        assert m.one.quality is UNREF
        assert m.sample() is False


@pytest.mark.parametrize("synchronous", [True, False])
def test_a_reference_without_a_preset_of_the_circuit_moves_the_zero_of_the_sensor(box, synchronous):
    """The raw integer stays what it is; everything that shows the value agrees with the reference."""
    machine = inputs(sensor(resolution=0.5, minimum=0.0, maximum=99.0, incremental=True, synchronous=synchronous))
    declared = machine.one.zero_offset
    connection = connect(machine, wired(machine, box))
    with connection as m:
        box.set("one", 1000)
        period(m)
        m.one.read()
        assert m.one.quality is UNREF
        m.one.referenced(at=20.0)
        slot = connection.image.slot_of[id(m.one)]
        assert (m.one.raw, m.one.quality, connection.image.values[slot]) == (1000, GOOD, 20.0)
        box.set("one", 1010)
        period(m)
        assert (m.one.read(), m.one.zero_offset, m.one.quality) == (25.0, -480.0, GOOD)
        put(m.one, 99.5)
        period(m)
        assert (m.one.read(), m.one.quality) == (99.5, OUT_OF_RANGE)
    assert machine.one.zero_offset == declared


def test_a_reference_of_one_sensor_leaves_its_neighbours(box):
    machine = inputs(sensor(incremental=True))
    with connect(machine, wired(machine, box, entries={"two": {"inverted": True}})) as m:
        box.set("two", 1)
        period(m)
        m.one.referenced(at=7.0)
        period(m)
        assert (m.one.read(), m.two.read()) == (7.0, PassFail.PASS)


@pytest.mark.parametrize("place", [1e308, -1e300])
def test_a_reference_beyond_all_raw_integers_is_refused(box, place):
    machine = inputs(sensor(incremental=True))
    with connect(machine, wired(machine, box)) as m:
        period(m)
        with pytest.raises(RangeError, match="one"):
            m.one.referenced(at=place)
        m.one.referenced(at=7.0)
        assert m.one.read() == 7.0


def test_what_was_not_read_cannot_be_referenced_to_a_value(box):
    machine = inputs(sensor(incremental=True, synchronous=False))
    with connect(machine, wired(machine, box)) as m:
        with pytest.raises(BadInput, match="one is BAD"):
            m.one.referenced(at=7.0)
        m.one.read()
        for wrong, error in ((math.nan, RangeError), ("7", RangeError)):
            with pytest.raises(error):
                m.one.referenced(at=wrong)
        with pytest.raises(DeclarationError, match="takes no value"):
            m.one.referenced(False, at=7.0)
        assert m.one.quality is UNREF


def test_every_connect_starts_unreferenced(box):
    machine = inputs(sensor(incremental=True))
    for _ in range(2):
        with connect(machine, wired(machine, box)) as m:
            assert m.one.quality is UNREF
            m.one.referenced()


def test_unreferenced_outranks_the_range_which_referenced_brings_to_light(box):
    machine = inputs(sensor(incremental=True))
    box.set("one", -20)
    with connect(machine, wired(machine, box)) as m:
        assert m.one.quality is UNREF
        m.one.referenced()
        assert m.one.quality is OUT_OF_RANGE
        assert m.sample() is False
        box.set("one", 20)
        assert m.sample() is True


def test_referenced_while_held_is_stale_until_the_device_is_back(box):
    machine = inputs(sensor(incremental=True, **DEAD_MAN_TIME))
    with connect(machine, wired(machine, box)) as m:
        box.broken = OSError("cut")
        with pytest.raises(DriverError):  # the switch does not hold
            period(m)
        assert m.one.quality is UNREF
        m.one.referenced()
        assert m.one.quality is STALE
        m.one.referenced(False)
        assert m.one.quality is UNREF
        m.one.referenced()
        box.broken = None
        assert period(m) is True
        assert m.one.quality is GOOD


# Time ------------------------------------------------------------------------------------------------


def test_every_value_has_the_time_of_its_transfer_on_the_cycles_clock(box):
    machine = inputs()
    clock = VirtualTimer(missed=[0, 4, 0])
    with connect(machine, wired(machine, box, clock=clock)) as m:
        assert (m.one.time, m.two.time, m.now) == (0.0, 0.0, 0.0)
        seen = []
        for _ in range(3):
            period(m)
            seen.append((m.one.time, m.two.time, m.timer.time, m.dt))
        assert seen == [pytest.approx([t, t, t, dt]) for t, dt in [(0.001, 0.001), (0.005, 0.004), (0.006, 0.001)]]


def test_an_asynchronous_sensor_has_no_time_before_it_was_read(box):
    machine = inputs(sensor(synchronous=False))
    with connect(machine, wired(machine, box)) as m:
        assert math.isnan(m.one.time)
        m.timer.read()
        m.one.read()
        assert m.one.time == m.now == 0.001


def test_an_actuator_has_the_time_at_which_it_was_accepted(box):
    class Output(Compound):
        timer: DigitalSensor
        motor: DigitalActuator
        quick: BinaryActuator[OnOff]

    machine = Output(timer=timer(), motor=actuator(), quick=relay(synchronous=False))
    with connect(machine, wired(machine, box)) as m:
        assert (m.motor.time, m.quick.time) == (0.0, 0.0)
        m.timer.read()
        m.motor.write(1.0)
        m.quick.write(OnOff.ON)
        assert (m.motor.time, m.quick.time) == (0.0, 0.001)
        m.update()
        assert m.motor.time == 0.001
        m.timer.read()
        box.broken = OSError("cut")
        with pytest.raises(DriverError):
            m.update()
        assert m.motor.time == 0.001
        box.broken = None


# Failing devices -------------------------------------------------------------------------------------


def test_a_failed_block_marks_its_own_objects_the_others_still_run_then_one_error_lists_all():
    left, right, middle = Scripted(), Scripted(), Scripted()

    class Many(Compound):
        a: DigitalSensor
        b: DigitalSensor
        c: DigitalSensor
        d: DigitalSensor

    machine = Many(a=sensor(), b=sensor(), c=sensor(), d=sensor())
    entries = {"b": {"driver": "right", "channel": "x"}, "c": {"driver": "middle"}, "d": {"driver": "right"}}
    with connect(machine, wired(machine, left, right=right, middle=middle, entries=entries)) as m:
        for item, driver in ((m.a, left), (m.b, right), (m.c, middle), (m.d, right)):
            put(item, 10.0)
            driver.broken = OSError("cut") if driver is not middle else None
        with pytest.raises(DriverError) as caught:
            m.sample()
        assert [(f.path, f.channel, f.cause) for f in caught.value.failures] == [
            ("a", "a", "cut"),
            ("b", "x", "cut"),
            ("d", "d", "cut"),
        ]
        assert [m.a.quality, m.b.quality, m.c.quality, m.d.quality] == [BAD, BAD, GOOD, BAD]
        assert [m.a.read(), m.b.read(), m.c.read(), m.d.read()] == [0.0, 0.0, 10.0, 0.0]
        left.broken = right.broken = None
        assert m.sample() is True
        assert [m.a.quality, m.b.quality, m.c.quality, m.d.quality] == [GOOD] * 4


def test_a_failed_output_block_does_not_keep_the_others_from_being_written():
    left, right = Scripted(), Scripted()

    class Two(Compound):
        a: DigitalActuator
        b: DigitalActuator

    machine = Two(a=actuator(), b=actuator())
    with connect(machine, wired(machine, left, right=right, entries={"b": {"driver": "right"}})) as m:
        m.a.write(1.0)
        m.b.write(2.0)
        left.at(len(left.calls), OSError("cut"))
        with pytest.raises(DriverError) as caught:
            m.update()
        assert failed(caught.value) == ["a"]
        assert (m.a.read(), m.b.read(), right.get("b")) == (0.0, 2.0, 4)


def test_a_holding_sensor_is_stale_until_its_age_is_exceeded_then_raises_and_recovers(box):
    machine = inputs(sensor(**DEAD_MAN_TIME), switch(**DEAD_MAN_TIME))
    box.set("one", 20)
    with connect(machine, wired(machine, box)) as m:
        box.broken = OSError("cut")
        for _ in range(3):  # 1, 2 and 3 ms old: not older than max_age
            assert period(m) is False
            assert (m.one.read(), m.one.quality, m.one.time) == (10.0, STALE, 0.0)
        with pytest.raises(DriverError) as caught:
            period(m)
        assert failed(caught.value) == ["one", "two"]
        assert m.one.quality is BAD
        box.broken = None
        box.set("one", 40)
        assert period(m) is True
        assert (m.one.read(), m.one.quality) == (20.0, GOOD)
        box.broken = OSError("again")
        assert period(m) is False  # a new age begins
        box.broken = None


def test_missed_periods_count_in_the_age(box):
    machine = inputs(sensor(**DEAD_MAN_TIME), switch(**DEAD_MAN_TIME))
    with connect(machine, wired(machine, box, clock=VirtualTimer(missed=[0, 3]))) as m:
        box.broken = OSError("cut")
        assert period(m) is False
        with pytest.raises(DriverError):
            period(m)
        box.broken = None


def test_an_asynchronous_holding_sensor_gives_its_last_value_then_raises(box):
    machine = inputs(sensor(synchronous=False, **DEAD_MAN_TIME))
    box.set("one", 20)
    with connect(machine, wired(machine, box)) as m:
        assert m.one.read() == 10.0
        box.set("one", OSError("cut"))
        for _ in range(3):
            m.timer.read()
            assert (m.one.read(), m.one.quality) == (10.0, STALE)
        m.timer.read()
        with pytest.raises(DriverError, match="one"):
            m.one.read()
        assert m.one.quality is BAD
        box.set("one", 30)
        assert (m.one.read(), m.one.quality) == (15.0, GOOD)


@pytest.mark.parametrize("raw", [2, -1, 255, 2**40])
@pytest.mark.parametrize("synchronous", [True, False])
@pytest.mark.parametrize("inverted", [True, False])
@pytest.mark.parametrize("before", [0, 1])
def test_a_binary_channel_that_reads_neither_0_nor_1_is_a_driver_error(box, raw, synchronous, inverted, before):
    machine = inputs(two=switch(synchronous=synchronous))
    box.set("two", before)
    with connect(machine, wired(machine, box, entries={"two": {"inverted": inverted}})) as m:
        state = m.two.read()
        box.set("two", raw)
        box.set("one", 40)
        m.timer.read()
        with pytest.raises(DriverError, match=f"box: read {raw}, but a binary channel reads 0 or 1; two") as caught:
            m.sample() if synchronous else m.two.read()
        assert failed(caught.value) == ["two"]
        assert m.two.quality is BAD
        assert m.two.time == 0.0
        if synchronous:  # its neighbour in the block is as good as ever
            assert m.two.read() is state
            assert (m.one.read(), m.one.quality, m.one.time) == (20.0, GOOD, 0.001)
        box.set("two", before)
        m.sample()
        assert m.two.read() is state
        assert m.two.quality is GOOD


def test_a_garbled_binary_sensor_may_hold(box):
    machine = inputs(two=switch(**DEAD_MAN_TIME))
    box.set("two", 1)
    with connect(machine, wired(machine, box)) as m:
        box.set("two", 7)
        for _ in range(3):
            assert period(m) is False
            assert (m.two.read(), m.two.quality, m.two.time) == (PassFail.FAIL, STALE, 0.0)
        with pytest.raises(DriverError):
            period(m)
        box.set("two", 0)
        assert period(m) is True
        assert m.two.read() is PassFail.PASS


def test_a_failed_reset_of_a_compound_resets_the_rest_and_lists_what_failed(box):
    class Mixed(Compound):
        a: DigitalActuator
        s: DigitalSensor
        b: BinaryActuator[OnOff]

    machine = Mixed(a=actuator(), s=sensor(), b=relay())
    with connect(machine, wired(machine, box)) as m:
        m.a.write(1.0)
        m.b.write(OnOff.ON)
        m.update()
        number = len(box.calls)
        box.at(number, OSError("cut"))
        box.at(number + 2, OSError("cut too"))  # the actuators come first
        with pytest.raises(DriverError) as caught:
            m.reset()
        assert failed(caught.value) == ["a", "s"]
        assert (m.a.read(), m.a.pending, m.a.quality) == (1.0, 0.0, BAD)
        assert (m.b.read(), m.b.quality) == (OnOff.OFF, GOOD)
        m.update()  # sends the default that reset could not
        assert (m.a.read(), m.a.quality) == (0.0, GOOD)
        assert m.s.quality is BAD
        m.sample()
        assert m.s.quality is GOOD


# What control does with it ---------------------------------------------------------------------------


def test_a_control_law_refuses_what_is_not_good_unless_told_what_to_accept(box):
    machine = inputs(sensor(incremental=True))
    with connect(machine, wired(machine, box)) as m:
        with pytest.raises(BadInput, match="one is UNREFERENCED") as caught:
            value_of(m.one)
        assert (caught.value.path, caught.value.quality) == ("one", UNREF)
        assert value_of(m.one, HOMING) == 0.0
        assert state_of(m.two) is PassFail.PASS
        m.one.referenced()
        assert value_of(m.one) == 0.0


# Failures that are only marked -----------------------------------------------------------------------

MARK = {"on_error": "mark"}


OPEN = ChannelsFailed({"one": "open circuit"})


def test_a_failure_that_is_marked_makes_the_value_bad_and_the_others_go_on(box, caplog):
    machine = inputs(sensor(**MARK))
    with connect(machine, wired(machine, box)) as m:
        box.set("one", [20, OPEN, OPEN, 40])
        seen = []
        for _ in range(4):
            good = period(m)
            seen.append((good, m.one.read(), m.one.quality, m.two.quality))
            if not good:
                with pytest.raises(BadInput, match="one is BAD"):
                    value_of(m.one)
    assert seen == [(True, 10.0, GOOD, GOOD), *[(False, 10.0, BAD, GOOD)] * 2, (True, 20.0, GOOD, GOOD)]
    assert [record.message for record in caplog.records] == ["marked BAD: box: open circuit; one"]  # said once


def test_many_marked_failures_are_one_line_of_the_log_and_not_again_at_each_flap(caplog):
    box = Scripted({f"many.{i}": 20 for i in range(100)})

    class Many(Compound):
        many: Sequence[DigitalSensor]
        timer: DigitalSensor

    m = Many(many=[sensor(**MARK) for _ in range(100)], timer=timer())
    with connect(m, wired(m, box)):
        for failure in (OSError("cut"), None, OSError("cut"), None):
            box.broken = failure
            m.timer.read()
            m.sample()
    (record,) = caplog.records
    assert record.message == "marked BAD: box: cut; many.0, many.1 and 98 others"


def test_a_software_reference_during_a_held_failure_takes_the_held_value(box):
    machine = inputs(sensor(incremental=True, invalid_raws=[0x7FFF], **DEAD_MAN_TIME))
    with connect(machine, wired(machine, box)) as m:
        box.set("one", [100, 100, 0x7FFF, 200])
        period(m)
        period(m)
        period(m)
        assert m.one.quality is UNREF
        m.one.referenced(at=5000.0)
        assert m.one.read() == 5000.0
        period(m)
        assert m.one.read() == 5050.0  # 100 counts of 0.5


def test_an_asynchronous_sensor_marks_a_failure_too(box):
    machine = inputs(sensor(synchronous=False, **MARK))
    box.set("one", [20, OSError("open circuit")])
    with connect(machine, wired(machine, box)) as m:
        assert (m.one.read(), m.one.quality) == (10.0, GOOD)
        assert (m.one.read(), m.one.quality) == (10.0, BAD)
        with pytest.raises(BadInput, match="one is BAD"):
            value_of(m.one)


def test_a_marked_failure_is_held_first_if_it_has_a_max_age(box):
    machine = inputs(sensor(**MARK, max_age="3 ms"))
    box.set("one", 20)
    with connect(machine, wired(machine, box)) as m:
        box.set("one", OPEN)
        seen = []
        for _ in range(5):
            assert period(m) is False
            seen.append(m.one.quality)
        assert seen == [STALE, STALE, STALE, BAD, BAD]
        assert m.one.read() == 10.0
        box.set("one", 30)
        assert period(m) is True
        assert (m.one.read(), m.one.quality) == (15.0, GOOD)


def test_an_invalid_raw_is_held_and_then_marked(box):
    machine = inputs(sensor(**MARK, max_age="2 ms", invalid_raws=[32767], incremental=True))
    box.set("one", 20)
    with connect(machine, wired(machine, box)) as m:
        m.one.referenced()
        seen = []
        for raw in (32767, 32767, 32767, 400, 32767, 20):
            box.set("one", raw)
            period(m)
            seen.append((m.one.raw, m.one.read(), m.one.quality))
    assert seen == [
        (32767, 10.0, STALE),
        (32767, 10.0, STALE),
        (32767, 10.0, BAD),
        (400, 200.0, OUT_OF_RANGE),
        (32767, 200.0, OUT_OF_RANGE),  # what was out of range is no better for being held
        (20, 10.0, GOOD),
    ]


def test_when_the_device_is_gone_the_others_of_its_block_still_raise(box):
    machine = inputs(sensor(**MARK), switch())
    with connect(machine, wired(machine, box)) as m:
        box.broken = OSError("cut")
        with pytest.raises(DriverError) as caught:
            period(m)
        assert failed(caught.value) == ["two"]
        assert (m.one.quality, m.two.quality) == (BAD, BAD)
        box.broken = None
        assert period(m) is True


def test_when_a_device_of_marked_sensors_alone_is_gone_nothing_is_raised(box):
    machine = inputs(sensor(**MARK), switch(**MARK))
    with connect(machine, wired(machine, box)) as m:
        box.broken = OSError("cut")
        assert period(m) is False
        assert (m.one.quality, m.two.quality) == (BAD, BAD)
        with pytest.raises(BadInput, match="two is BAD"):
            state_of(m.two)
        box.broken = None


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"on_error": "ignore"}, "on_error='ignore' is none of 'raise', 'hold', 'mark'"),
        ({"on_error": "hold"}, 'on_error="hold" needs a max_age'),
        ({"max_age": 1.0}, 'max_age is for on_error="hold" and on_error="mark"'),
        ({"on_error": "mark", "max_age": -1.0}, "finite and not negative"),
    ],
)
def test_on_error_and_max_age_must_fit(given, message):
    for make in (sensor, switch):
        with pytest.raises(DeclarationError, match=message):
            make(**given)


@pytest.mark.parametrize("synchronous", [True, False])
def test_what_was_never_read_has_no_value(box, synchronous):
    """A guard that was never read is neither open nor closed."""
    machine = inputs(
        sensor(minimum=2.0, synchronous=synchronous, **MARK), switch(synchronous=synchronous, **MARK, max_age="1 s")
    )
    box.set("one", OPEN)
    box.set("two", OSError("unplugged"))
    with connect(machine, wired(machine, box)) as m:
        for _ in range(2):
            assert math.isnan(m.one.read())
            with pytest.raises(BadInput, match="two is BAD: it was never read"):
                m.two.read()
            for law_reads in (lambda: value_of(m.one), lambda: state_of(m.two), lambda: state_of(m.two, Quality.BAD)):
                with pytest.raises(BadInput):
                    law_reads()
            period(m)
        assert (m.one.quality, m.two.quality) == (BAD, BAD)
        assert repr(m.two).startswith("<BinarySensor two = - ✕ bad")
        assert '<td class="number">0</td>' not in m.two._repr_html_()
        assert all(map(math.isnan, (*Vector([m.one]).read(), *Vector([m.two]).read())))
        box.set("one", 20)
        box.set("two", 1)
        period(m)
        assert (m.one.read(), m.two.read(), m.two.quality) == (10.0, PassFail.FAIL, GOOD)
        box.set("two", OSError("unplugged"))
        period(m)
        assert m.two.read() is PassFail.FAIL  # once read, the last state stands; its quality tells


def test_what_was_never_read_inhibits_and_has_no_value_in_frames(box, caplog):
    class Guarded(Inputs):
        motor: DigitalActuator

        def interlocks(self):
            yield Interlock(lambda: self.two.read() is PassFail.FAIL, [self.motor], "the door is open")

    machine = Guarded(one=sensor(**MARK), two=switch(**MARK), motor=actuator(), timer=timer())
    for name in ("one", "two"):
        box.set(name, OSError("unplugged"))
    connection = connect(machine, wired(machine, box))
    with connection as m, published(connection, "guarded") as ring:
        period(m)
        m.update()
        assert "two is BAD: it was never read" in m.motor.inhibited
        with Reader(ring.path) as reader:
            frame = reader.latest()
            values = reader.values(frame)
            assert math.isnan(values["one"])
            assert math.isnan(values["two"])


def test_a_default_that_a_vector_could_not_send_is_sent_again(box):
    """As that of a single asynchronous actuator."""
    machine = Motors(motors=[actuator(synchronous=False), actuator(synchronous=False)], timer=timer())
    with connect(machine, wired(machine, box)) as m:
        motors = Vector(m.motors)
        motors.write(4.0)
        box.broken = OSError("cut")
        with pytest.raises(DriverError):
            motors.write(0.0)
        box.broken = None
        period(m)
        assert [box.get("motors.0"), box.get("motors.1")] == [0, 0]
        assert list(motors.read()) == [0.0, 0.0]
