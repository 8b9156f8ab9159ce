"""The counter driver on the kernel's interrupt-counter, whose signal is a line of a simulated GPIO chip."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from umo.drivers.counter import Counter
from umo.errors import ChannelsFailed, DriverError

from .gpio_sim import fixed

KERNEL_DRIVER = Path("/sys/bus/platform/drivers/interrupt-cnt")
COUNT = Path("/sys/bus/counter/devices/counter0/count0")


@pytest.fixture
def counter() -> Iterator[Counter]:
    """Its count is 0, and disabled."""
    (COUNT / "enable").write_text("0")
    (COUNT / "count").write_text("0")
    driver = Counter(device="counter-0")
    yield driver
    driver.close()


def test_pulses_are_counted_from_initialisation(counter: Counter) -> None:
    fixed(0).pulse(2)  # not enabled yet
    channel = counter.channel("count:0")
    counter.open()
    counter.initialize(channel, None)
    assert counter.read(channel) == 0
    fixed(0).pulse(5)
    fixed(1).pulse(2)  # of the other counter
    assert counter.read(channel) == 5


def test_neither_reset_nor_closing_zeroes_a_count(counter: Counter) -> None:
    channel = counter.channel("count:0")
    for expected in (2, 4, 6):
        counter.open()
        counter.initialize(channel, None)
        counter.reset(channel, None)
        fixed(0).pulse(2)
        counter.reset(channel, None)
        assert counter.read(channel) == expected
        counter.finalize(channel)
        counter.close()


def test_enable_as_an_output_starts_and_stops_the_counting(counter: Counter) -> None:
    enable, count = counter.channel("enable:0"), counter.channel("count:0")
    counter.open()
    counter.initialize(enable, 0)
    counter.initialize(count, None)
    fixed(0).pulse()
    assert (counter.read(enable), counter.read(count)) == (0, 0)
    counter.write(enable, 1)
    fixed(0).pulse()
    assert (counter.read(enable), counter.read(count)) == (1, 1)
    counter.reset(enable, 0)
    fixed(0).pulse()
    assert counter.read(count) == 1


def test_a_count_can_be_written(counter: Counter) -> None:
    count = counter.channel("count:0")
    counter.open()
    counter.initialize(count, 100)
    fixed(0).pulse(3)
    assert counter.read(count) == 103


def test_a_block_is_the_same_as_single_reads(counter: Counter) -> None:
    channels = (counter.channel("enable:0"), counter.channel("count:0"))
    counter.open()
    for channel in channels:
        counter.initialize(channel, None)
    counter.write(channels[0], 1)
    fixed(0).pulse(2)
    out = np.empty(2, np.int64)
    counter.read_many(channels, out)
    assert out.tolist() == [1, 2]


def test_what_the_kernel_driver_does_not_have_or_take_is_an_error(counter: Counter) -> None:
    counter.open()
    with pytest.raises(DriverError, match="has no preset; it has: count, enable"):
        counter.initialize(counter.channel("preset:0"), None)
    counter.initialize(counter.channel("count:0"), None)
    with pytest.raises(DriverError, match="count:0: the device does not take 4294967295"):
        counter.write(counter.channel("count:0"), 2**32 - 1)  # it is a signed integer of 32 bits in the kernel
    with pytest.raises(DriverError, match="has no function 'quadrature x4'; it has: increase"):
        driver = Counter(function="quadrature x4")
        driver.open()
        driver.initialize(driver.channel("count:0"), None)


def test_a_counter_that_goes_fails_and_one_that_comes_back_is_used_again(counter: Counter) -> None:
    channel = counter.channel("count:0")
    counter.open()
    counter.initialize(channel, None)
    (KERNEL_DRIVER / "unbind").write_text("counter-0")
    try:
        with pytest.raises(DriverError, match="counter-0: the counter has gone"):
            counter.read(channel)
        with pytest.raises(DriverError, match=r"no counter 'counter-0'.*; there are: counter1 \(counter-1\)") as caught:
            counter.read_many((channel,), np.empty(1, np.int64))
        assert not isinstance(caught.value, ChannelsFailed)  # which says that the device answers
    finally:
        (KERNEL_DRIVER / "bind").write_text("counter-0")
    assert counter.read(channel) == 0  # the kernel's count begins again
    fixed(0).pulse(2)
    assert counter.read(channel) == 2
