"""The two atomic sensors: the paper's section 4.5."""

from __future__ import annotations

import math

import numpy as np
import pytest

from helpers.machines import failed, sensor, switch, timer, wired
from umo import BinarySensor, Compound, DigitalSensor, Quality, connect
from umo.errors import DeclarationError, DriverError, NotConnected, StateError
from umo.states import OnOff, PassFail
from umo.testing import Scripted, periods, put

pytestmark = pytest.mark.usefixtures("each_way")


class Inputs(Compound):
    encoder: DigitalSensor
    limit: BinarySensor[PassFail]


def inputs(**changes):
    return Inputs(**({"encoder": sensor(), "limit": switch()} | changes))


@pytest.fixture
def box():
    return Scripted()


def reads(box):
    return [call.channels for call in box.segments("read", "read_many")]


def test_read_returns_what_the_last_sample_kept(box):
    machine = inputs()
    with connect(machine, wired(machine, box)) as m:
        box.set("encoder", 40)
        box.set("limit", 1)
        assert (m.encoder.read(), m.limit.read()) == (0.0, PassFail.PASS)
        assert m.sample() is True
        assert (m.encoder.read(), m.encoder.raw) == (20.0, 40)
        assert (m.limit.read(), m.limit.raw) == (PassFail.FAIL, 1)
        assert reads(box) == [("encoder", "limit")] * 2  # one transfer a sample, the first by connect


def test_reading_a_synchronous_sensor_never_touches_the_hardware(box):
    machine = inputs()
    with connect(machine, wired(machine, box)) as m:
        count = len(box.calls)
        for _ in range(5):
            m.encoder.read(), m.limit.read(), m.encoder.raw, m.encoder.quality, m.encoder.time
        assert len(box.calls) == count


def test_reading_an_asynchronous_sensor_reads_the_hardware_now(box):
    machine = inputs(encoder=sensor(synchronous=False), limit=switch(synchronous=False))
    with connect(machine, wired(machine, box)) as m:
        box.set("encoder", [2, 4])
        box.set("limit", [1, 0])
        assert (m.encoder.read(), m.encoder.read()) == (1.0, 2.0)
        assert (m.limit.read(), m.limit.read()) == (PassFail.FAIL, PassFail.PASS)
        assert reads(box) == [("encoder",), ("encoder",), ("limit",), ("limit",)]


def test_sample_of_an_asynchronous_sensor_does_nothing_and_is_true(box):
    machine = inputs(encoder=sensor(synchronous=False), limit=switch(synchronous=False))
    with connect(machine, wired(machine, box)) as m:
        assert m.encoder.sample() is True
        assert m.limit.sample() is True
        assert m.sample() is True
        assert reads(box) == []


def test_sample_of_one_sensor_moves_that_one_only(box):
    machine = inputs()
    with connect(machine, wired(machine, box)) as m:
        box.set("encoder", 10)
        box.set("limit", 1)
        assert m.encoder.sample() is True
        assert (m.encoder.read(), m.limit.read()) == (5.0, PassFail.PASS)
        assert reads(box)[1:] == [("encoder",)]


def test_reset_of_a_sensor_clears_the_circuits_faults_and_nothing_else(box):
    machine = inputs()
    with connect(machine, wired(machine, box)) as m:
        box.set("encoder", 10)
        m.sample()
        before = m.encoder.read(), m.encoder.raw, m.encoder.time, m.encoder.quality
        m.encoder.reset()
        assert box.calls[-1].segment == "reset"
        assert box.calls[-1].raws == (None,)
        assert (m.encoder.read(), m.encoder.raw, m.encoder.time, m.encoder.quality) == before


def test_reset_never_changes_what_a_count_means(box):
    machine = inputs(encoder=sensor(incremental=True))
    with connect(machine, wired(machine, box)) as m:
        m.encoder.referenced()
        m.reset()
        m.sample()
        assert m.encoder.quality is Quality.GOOD


@pytest.mark.parametrize(("one", "inverted", "state"), [(PassFail.FAIL, False, PassFail.FAIL),
                                                       (PassFail.PASS, False, PassFail.PASS),
                                                       (PassFail.FAIL, True, PassFail.PASS),
                                                       (PassFail.PASS, True, PassFail.FAIL)])  # fmt: skip
def test_the_declaration_says_which_state_is_one_and_the_wiring_may_invert(box, one, inverted, state):
    machine = inputs(limit=switch(one=one))
    box.set("limit", 1)
    with connect(machine, wired(machine, box, entries={"limit": {"inverted": inverted}})) as m:
        assert (m.limit.read(), m.limit.raw) == (state, 1)


def test_a_negative_resolution_counts_the_other_way(box):
    machine = inputs(encoder=sensor(resolution=-0.5, zero_offset=50.0))
    box.set("encoder", 20)
    with connect(machine, wired(machine, box)) as m:
        assert m.encoder.read() == 40.0


def test_put_goes_through_the_wired_scaling(box):
    machine = inputs()
    entries = {"encoder": {"resolution": -0.25, "zero_offset": 7.0}, "limit": {"inverted": True}}
    with connect(machine, wired(machine, box, entries=entries)) as m:
        put(m.encoder, 40.0)
        put(m.limit, PassFail.FAIL)
        periods(m)
        assert (m.encoder.read(), m.limit.read(), m.limit.raw) == (40.0, PassFail.FAIL, 0)
        with pytest.raises(StateError):
            put(m.limit, OnOff.ON)


def test_a_sensor_has_neither_write_nor_update_and_an_actuator_no_sample():
    machine = inputs()
    assert not hasattr(machine.encoder, "write") and not hasattr(machine.encoder, "update")
    assert not hasattr(machine.limit, "write") and not hasattr(machine.limit, "update")
    from helpers.machines import actuator, relay

    assert not hasattr(actuator(), "sample") and not hasattr(relay(), "sample")


@pytest.mark.parametrize("garbage", [None, 2.5, "3", math.nan, [1], 2**63, -(2**63) - 1, 1j])
@pytest.mark.parametrize("synchronous", [True, False])
def test_a_driver_that_reads_no_integer_of_64_bits_has_failed(garbage, synchronous):
    class Derived(Scripted):
        read_many = Scripted.__mro__[1].read_many  # the contract's own, upon read

    machine = inputs(encoder=sensor(synchronous=synchronous, minimum=-1e30, maximum=1e30, resolution=1e18))
    box = Derived({"encoder": 3})
    with connect(machine, wired(machine, box)) as m:
        m.encoder.read()
        before = m.encoder.raw
        box.set("encoder", lambda: garbage)
        with pytest.raises(DriverError) as caught:
            m.sample() if synchronous else m.encoder.read()
        assert "encoder" in failed(caught.value)
        assert m.encoder.quality is Quality.BAD
        assert (m.encoder.raw, before) == (3, 3)
        box.set("encoder", np.int64(4))
        m.sample()
        assert type(m.encoder.read()) is float
        assert m.encoder.quality is Quality.GOOD


@pytest.mark.parametrize("extreme", [2**63 - 1, -(2**63)])
@pytest.mark.parametrize("synchronous", [True, False])
def test_the_extremes_of_int64_are_read(box, extreme, synchronous):
    machine = inputs(encoder=sensor(synchronous=synchronous))
    box.set("encoder", extreme)
    with connect(machine, wired(machine, box)) as m:
        assert m.encoder.read() == extreme * 0.5
        assert (m.encoder.raw, m.encoder.quality) == (extreme, Quality.OUT_OF_RANGE)


def test_a_driver_that_fills_half_the_buffer_and_fails_leaves_all_values(box):
    def half(call):
        raise OSError("half way")

    class Half(Scripted):
        def read_many(self, channels, out):
            if self.broken:
                out[0] = 77
            super().read_many(channels, out)

    machine, half_way = inputs(), Half({"encoder": 10})
    with connect(machine, wired(machine, half_way)) as m:
        half_way.broken = OSError("half way")
        with pytest.raises(DriverError):
            m.sample()
        assert (m.encoder.read(), m.encoder.raw) == (5.0, 10)
        half_way.broken = None


# Declarations ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "wrong",
    [{"resolution": 0.0}, {"minimum": 100.0}, {"minimum": math.nan}, {"on_error": "hold"}, {"max_age": 1.0},
     {"on_error": "ignore"}, {"on_error": "hold", "max_age": "soon"}, {"on_error": "hold", "max_age": -1.0}],
)  # fmt: skip
def test_a_wrong_declaration_is_an_error_at_once(wrong):
    with pytest.raises(DeclarationError):
        sensor(**wrong)


def test_a_wrong_binary_declaration_is_an_error_at_once():
    with pytest.raises(DeclarationError):
        BinarySensor(PassFail, one=OnOff.ON)
    with pytest.raises(DeclarationError):
        BinarySensor(PassFail, one=PassFail.FAIL, max_age=1.0)


def test_only_an_incremental_sensor_can_be_referenced():
    machine = inputs()
    with connect(machine) as m, pytest.raises(DeclarationError, match="encoder is not declared incremental"):
        m.encoder.referenced()


@pytest.mark.parametrize("use", [lambda s: s.read(), lambda s: s.sample(), lambda s: s.reset(), lambda s: s.raw])
def test_outside_connect_a_sensor_has_no_hardware(use):
    with pytest.raises(NotConnected):
        use(sensor())


def test_the_timer_of_the_paper_is_an_asynchronous_sensor_in_sampling_periods():
    assert (timer().units, timer().synchronous, timer().resolution) == ("sampling_period", False, 1.0)
