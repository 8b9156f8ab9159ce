"""The simulated circuit: every declared object works at once."""

from __future__ import annotations

import numpy as np
import pytest

from helpers.machines import bench
from umo import connect
from umo.drivers import Direction
from umo.drivers.simulated import Simulated, Written
from umo.states import OnOff, PassFail
from umo.testing import periods, put


def test_any_name_is_a_channel_both_ways_of_64_bits():
    channel = Simulated().channel("anything at all")
    assert (channel.text, channel.direction, channel.lowest) == ("anything at all", Direction.BOTH, -(2**63))


def test_a_channel_reads_0_then_what_was_set_or_written_last():
    driver = Simulated()
    channel = driver.channel("a")
    assert driver.read(channel) == 0
    driver.set("a", np.int64(5))
    assert (driver.read(channel), driver.get("a")) == (5, 5)
    driver.write(channel, 7)
    assert driver.read(channel) == 7


def test_read_many_and_write_many_agree_with_read_and_write():
    driver = Simulated()
    channels = [driver.channel(text) for text in "abc"]
    driver.write_many(channels, np.array([1, 2, 3]))
    out = np.zeros(3, np.int64)
    driver.read_many(channels, out)
    assert out.tolist() == [driver.read(channel) for channel in channels] == [1, 2, 3]


def test_the_history_holds_the_last_writes_oldest_first_initialise_and_reset_included():
    driver = Simulated(history=3)
    channel = driver.channel("a")
    driver.initialize(channel, 1)
    for raw in (2, 3):
        driver.write(channel, raw)
    driver.reset(channel, 4)
    driver.reset(channel, None)
    assert list(driver.history) == [Written("a", 2), Written("a", 3), Written("a", 4)]


def test_a_machine_works_without_any_wiring_at_one_millisecond_of_virtual_time():
    with connect(bench()) as m:
        assert m.cycle.period == pytest.approx(0.001)
        put(m.encoder, 12.5)
        put(m.limit, PassFail.FAIL)
        m.motor.write(3.0)
        m.valve.write(OnOff.ON)
        periods(m, 5)
        assert (m.encoder.read(), m.limit.read(), m.motor.read(), m.valve.read()) == (
            12.5,
            PassFail.FAIL,
            3.0,
            OnOff.ON,
        )
        assert m.now == pytest.approx(0.005)
        assert m.timer.read() == 0.0


def test_two_machines_on_simulated_channels_share_nothing():
    one, other = bench(), bench()
    with connect(one) as a, connect(other) as b:
        put(a.encoder, 50.0)
        a.sample()
        b.sample()
        assert (a.encoder.read(), b.encoder.read()) == (50.0, 0.0)
