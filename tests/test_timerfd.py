"""The paper's Timer_Input (section 5.3) on an injected counter: no test waits."""

from __future__ import annotations

import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from machines import bench, wired
from umo import Channel, Direction, DriverError, connect
from umo.drivers.timerfd import Ticker, TimerFd
from umo.testing import Scripted

linux = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="timerfd is Linux")


class Counter:
    """Ticks as the kernel counts them: asked with block=True it lets `late` ticks more pass than the one."""

    def __init__(self, late=()):
        self.count = 0
        self.late = iter(late)
        self.blocked = 0

    def pass_by(self, ticks):
        self.count += ticks

    def __call__(self, block):
        if block:
            assert self.count == 0, "blocks although a tick has passed"
            self.blocked += 1
            self.count = 1 + next(self.late, 0)
        count, self.count = self.count, 0
        return count


def test_it_blocks_for_the_next_tick_and_returns_0_when_none_has_passed():
    counter = Counter()
    ticker = Ticker(0.001, counter)
    assert [ticker.wait() for _ in range(5)] == [0] * 5
    assert counter.blocked == 5


@pytest.mark.parametrize("passed", [1, 3])
def test_it_returns_at_once_with_the_ticks_that_have_passed_then_blocks_again(passed):
    counter = Counter()
    ticker = Ticker(0.001, counter)
    counter.pass_by(passed)
    assert ticker.wait() == passed
    assert counter.blocked == 0
    assert ticker.wait() == 0
    assert counter.blocked == 1


def test_one_tick_that_has_passed_is_1_and_one_waited_for_is_0():
    """A plain blocking read of a timerfd returns 1 in both cases."""
    counter = Counter()
    ticker = Ticker(0.001, counter)
    first = ticker.wait()
    counter.pass_by(1)
    assert (first, ticker.wait()) == (0, 1)


def test_ticks_that_pass_between_the_wake_up_and_the_look_at_the_counter_are_not_lost():
    counter = Counter(late=[2])
    ticker = Ticker(0.001, counter)
    assert ticker.wait() == 0
    counter.pass_by(1)
    assert ticker.wait() == 3
    assert ticker.wait() == 0


def test_after_a_miss_there_is_no_burst_to_catch_up():
    counter = Counter()
    ticker = Ticker(0.001, counter)
    counter.pass_by(7)
    assert [ticker.wait() for _ in range(4)] == [7, 0, 0, 0]
    assert counter.blocked == 3


@given(st.lists(st.tuples(st.integers(0, 5), st.integers(0, 3)), max_size=30))
def test_every_tick_is_counted_once(plan):
    """The grid stays where it was: what the reads consume is what the kernel counted."""
    counter, total, consumed = Counter(late=[late for _, late in plan]), 0, 0
    ticker = Ticker(0.001, counter)
    for passed, _ in plan:
        counter.pass_by(passed)
        total += passed
        missed = ticker.wait()
        consumed += max(missed, 1)
    total += counter.blocked + sum(late for _, late in plan[: counter.blocked])
    assert consumed + ticker._late == total


def test_the_channel_is_one_whatever_it_is_called_and_only_an_input():
    assert TimerFd().channel("timer") == TimerFd().channel("x") == Channel("tick", Direction.INPUT, 63)


def test_a_timer_that_does_not_run_is_a_driver_error():
    driver = TimerFd()
    with pytest.raises(DriverError, match="not running"):
        driver.read(driver.channel("tick"))


def test_reset_does_not_move_the_grid():
    driver = TimerFd()
    counter = Counter()
    driver.ticker = Ticker(0.001, counter)
    counter.pass_by(2)
    driver.reset(driver.channel("tick"), None)
    assert driver.read(driver.channel("tick")) == 2


@linux
@pytest.mark.parametrize("period", [0.0, 1e-10])
def test_a_period_that_timerfd_takes_for_never_is_an_error(period):
    ticker = Ticker(period)
    with pytest.raises(DriverError, match="give the timer a period"):
        ticker.start()
    ticker.close()


@linux
def test_the_real_timer_ticks_and_is_given_back():
    machine = bench()
    driver = TimerFd()
    wiring = wired(machine, Scripted(), clock=driver)
    wiring["wire"]["timer"]["period"] = "100 us"
    with connect(machine, wiring) as m:
        ticks = 0
        for _ in range(5):
            ticks += max(int(m.timer.read()), 1)
        assert m.now == pytest.approx(ticks * 1e-4)
    assert driver.ticker._fd == -1


@linux
@pytest.mark.usefixtures("many_descriptors")
def test_a_timer_ticks_where_more_than_1024_descriptors_are_open():
    ticker = Ticker(1e-4)
    try:
        ticker.start()
        assert ticker._fd > 1023
        assert sum(max(ticker.wait(), 1) for _ in range(3)) >= 3
    finally:
        ticker.close()
