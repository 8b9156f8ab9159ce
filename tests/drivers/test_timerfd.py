"""The paper's Timer_Input (section 5.3) on an injected clock: no test waits."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable
from ctypes import CFUNCTYPE, POINTER, byref, c_int, c_int32, c_int64, c_longlong, c_void_p, cast
from itertools import product
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from helpers.machines import bench, wired
from helpers.tiers import some
from umo import connect
from umo.drivers import Channel, Direction, DriverError
from umo.drivers.optional import WaitEnded
from umo.drivers.timerfd import Ticker, TimerFd, WhileWaiting
from umo.drivers.transfers_in_c import native
from umo.testing import Scripted

IN_C = pytest.mark.skipif(native is None, reason="the extension of the drivers was not built")
linux = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="timerfd is Linux")


US = 1_000
PERIOD = 1_000 * US


class Kernel:
    """A clock in ns, and a timer that expires once per period, `busy_wait` before each tick. A look at the clock takes
    1 us; a wake-up is late by the next number of `late`, in us."""

    def __init__(self, late: Iterable[int] = (), busy_wait: int = 0, period: int = PERIOD) -> None:
        self.now = 0
        self.period = period
        self.late = iter(late)
        self.slept: list[int] = []
        """When each sleep began, in us."""
        self.napped: list[int] = []
        """us"""
        self.asleep = 0
        """ns, in sleeps and naps and where something else runs"""
        self.sleeps: list[Callable[[], None]] = []
        """What happens in the next sleep in place of it."""
        self.after_nap: Callable[[], None] = lambda: None
        self._expired = 0
        self._offset = busy_wait

    def clock(self) -> int:
        self.now += US
        return self.now

    def sleep(self) -> None:
        if self.sleeps:
            self.sleeps[-1]()
            return
        expired = (self.now + self._offset) // self.period
        if expired == self._expired:
            self.slept.append(self.now // US)
            begun, self.now = self.now, (expired + 1) * self.period - self._offset + US * next(self.late, 0)
            self.asleep += self.now - begun
            expired = (self.now + self._offset) // self.period
        self._expired = expired

    def nap(self, seconds: float) -> None:
        self.napped.append(round(seconds * 1e6))
        self.now += round(seconds * 1e9) + US * next(self.late, 0)
        self.asleep += round(seconds * 1e9)
        self.after_nap()

    def work(self, us: int) -> None:
        self.now += us * US

    def stand_still(self, us: int) -> None:
        """Something else runs."""
        self.now += us * US
        self.asleep += us * US

    def noting(self, called: list[int], takes: Callable[[], int]) -> WhileWaiting:
        """Work of so many us that notes its periods."""

        def work() -> None:
            called.append(self.now // PERIOD)
            self.work(takes())

        return WhileWaiting(work, self.clock)

    def ticker(self) -> Ticker:
        self.now = -US  # the first tick is due at PERIOD
        ticker = Ticker(self.period * 1e-9, self.clock, self.sleep, self.nap, lambda: self.now - self.asleep)
        ticker.wait_busily(self._offset * 1e-9)
        return ticker


@pytest.mark.parametrize("passed", [1, 3])
def test_it_returns_at_once_with_the_ticks_that_have_passed_then_blocks_again(passed: int) -> None:
    kernel = Kernel()
    ticker = kernel.ticker()
    kernel.work(passed * 1000 + 500)
    assert ticker.wait() == passed
    assert kernel.slept == []
    assert ticker.wait() == 0
    assert len(kernel.slept) == 1


@given(st.lists(st.tuples(st.integers(0, 4000), st.integers(0, 3000)), max_size=30), st.integers(0, 500))
def test_every_tick_is_counted_once_and_none_comes_too_soon(plan: list[tuple[int, int]], busy_wait: int) -> None:
    """The grid stays where it was, whatever works long and wakes late, and however long the thread waits busily."""
    kernel, consumed = Kernel((late for _, late in plan), busy_wait * US), 0
    ticker = kernel.ticker()
    for work, _ in plan:
        kernel.work(work)
        consumed += max(ticker.wait(), 1)
        assert ticker.due == consumed * PERIOD
        assert ticker.woke >= ticker.due


def test_it_wakes_before_the_tick_and_looks_at_the_clock_until_the_tick() -> None:
    kernel = Kernel(late=[70, 70], busy_wait=100 * US)
    ticker = kernel.ticker()
    for number in (1, 2):
        assert ticker.wait() == 0
        assert 0 <= ticker.woke - number * PERIOD <= US
    assert len(kernel.slept) == 2


def test_a_wait_that_begins_between_waking_up_and_the_tick_does_not_sleep() -> None:
    kernel = Kernel(busy_wait=100 * US)
    ticker = kernel.ticker()
    kernel.work(950)
    assert ticker.wait() == 0
    assert (kernel.slept, kernel.napped, ticker.due) == ([], [], PERIOD)
    assert ticker.wait() == 0
    assert (len(kernel.slept), ticker.due) == (1, 2 * PERIOD)


@pytest.mark.parametrize("work", [600, 880, 920, 960])
def test_a_thread_that_waits_busily_sleeps_a_sixteenth_of_the_time_or_what_its_work_leaves(work: int) -> None:
    """The kernel holds up a real-time thread that sleeps less than 5 %."""
    kernel = Kernel(busy_wait=100 * US)
    ticker = kernel.ticker()
    slept = 0
    for number in range(1, 201):
        kernel.work(work)
        before = len(kernel.slept)
        assert ticker.wait() == 0
        assert ticker.due == number * PERIOD
        slept += (len(kernel.slept) - before) * (900 - work)
    slept += sum(kernel.napped)
    left = (1 + 10 / 16) / 200  # a debt of one period is borne, and what ten periods add until the next look
    assert slept / 200_000 >= min(1 / 16, 1 - work / 1000) - left - 0.001
    assert bool(kernel.napped) == (work > 830)


@pytest.mark.parametrize("works", [(600, 1100), (600, 600, 1050)])
def test_a_thread_that_misses_ticks_sleeps_no_less(works: tuple[int, ...]) -> None:
    kernel = Kernel(busy_wait=500 * US)
    ticker = kernel.ticker()
    for work in works * 700:
        kernel.work(work)
        ticker.wait()
    assert kernel.asleep / kernel.now > 0.05


@pytest.mark.parametrize(
    ("period", "work", "idle"),
    some(
        lambda case: case[0] == 100 or (case[0] != 1 and case[1] == 0.94),
        product([10, 20, 100, 1], [0.6, 0.9, 0.94], [0, 5]),
    ),
)
def test_no_second_is_used_up(period: int, work: float, idle: int) -> None:
    """Nor when much work begins after some periods without any. `period` is in ms, `work` a share of it."""
    kernel = Kernel(busy_wait=period * 500 * US, period=period * 1000 * US)
    ticker = kernel.ticker()
    times, used = [], []
    for number in range(idle + max(3000 // period, 30)):
        kernel.work(round(work * period * 1000) if number >= idle else 0)
        times.append(kernel.now)
        used.append(kernel.now - kernel.asleep)
        ticker.wait()
        times.append(kernel.now)
        used.append(kernel.now - kernel.asleep)
    second = 10**9
    ends = [int(np.interp(time + second, times, used)) for time in times if time + second <= times[-1]]
    assert max(end - begin for begin, end in zip(used, ends, strict=False)) <= 0.95 * second


def test_a_thread_that_is_tired_sleeps_no_more_than_it_owes() -> None:
    kernel = Kernel(busy_wait=500 * US)
    ticker = kernel.ticker()
    for _ in range(1000):
        kernel.work(480)
        assert ticker.wait() == 0
    assert 80 < len(kernel.napped) < 90  # of 520 us each, and 20 us of sleep in each other period: a sixteenth


def test_a_thread_that_stood_still_owes_no_sleep() -> None:
    """After a blocking call, or beside a process that took the processor: it waits busily again at once."""
    kernel = Kernel(busy_wait=100 * US)
    ticker = kernel.ticker()
    ticker.wait()
    kernel.stand_still(500_000)
    assert ticker.wait() == 500
    for _ in range(20):
        kernel.work(300)
        assert ticker.wait() == 0
    assert kernel.napped == []


def in_c(kernel: Kernel) -> tuple[Ticker, Callable[[], int]]:
    """A ticker, and its wait by the function in C on this clock."""
    ticker: Any = kernel.ticker()
    functions = [
        CFUNCTYPE(c_longlong)(kernel.clock),
        CFUNCTYPE(c_int)(lambda: kernel.sleep() or 0),
        CFUNCTYPE(c_int, c_longlong)(lambda ns: kernel.nap(ns * 1e-9) or 0),
        CFUNCTYPE(c_longlong)(lambda: kernel.now - kernel.asleep),
    ]
    ticker.c_clock, ticker.c_sleep, ticker.c_nap, ticker.c_processor_time = (
        cast(each, c_void_p).value for each in functions
    )
    tick = CFUNCTYPE(c_int32, c_void_p, POINTER(c_int64), c_int32)(native.TICK)
    missed = c_int64(-1)

    def wait(keep: object = functions) -> int:
        assert tick(ticker.address(), byref(missed), 1) == 0
        return missed.value

    return ticker, wait


@linux
@IN_C
@given(st.lists(st.tuples(st.integers(0, 4000), st.integers(0, 3000)), max_size=60), st.sampled_from([0, 70, 500, 990]))
def test_the_wait_in_c_is_that_of_python(plan: list[tuple[int, int]], busy_wait: int) -> None:
    """At each wait: what it returns, the tick, the waking up, what it sleeps, and what sleep the thread owes."""
    late = [each for _, each in plan]
    kernels = Kernel(iter(late), busy_wait * US), Kernel(iter(late), busy_wait * US)
    python = kernels[0].ticker()
    c, wait = in_c(kernels[1])
    for work, _ in plan:
        for kernel in kernels:
            kernel.work(work)
        assert python.wait() == wait()
        for name in ("due", "woke", "_next", "_owed", "_napped", "_looked", "_used_then"):
            assert getattr(python, name) == getattr(c, name), name
        assert (kernels[0].slept, kernels[0].napped) == (kernels[1].slept, kernels[1].napped)


@linux
@IN_C
def test_a_wait_in_c_that_is_ended_is_left_to_python() -> None:
    c, wait = in_c(Kernel())
    c.stop_waiting()
    with pytest.raises(AssertionError):
        wait()
    with pytest.raises(WaitEnded):
        c.wait()
    assert wait() == 0


def test_what_is_done_meanwhile_is_done_once_before_each_tick() -> None:
    kernel, called = Kernel(busy_wait=100 * US), []
    ticker = kernel.ticker()
    ticker.meanwhile = WhileWaiting(lambda: (called.append(kernel.now), kernel.work(50)), kernel.clock)
    for _ in range(3):
        assert ticker.wait() == 0
        assert ticker.woke - ticker.due <= US
    assert [at // PERIOD for at in called] == [0, 1, 2]


def test_what_took_too_long_once_meanwhile_is_left_out_for_eight_periods() -> None:
    kernel, called = Kernel(busy_wait=100 * US), []
    ticker = kernel.ticker()
    ticker.meanwhile = WhileWaiting(
        lambda: (called.append(kernel.now // PERIOD), kernel.work(400 if len(called) == 3 else 50)), kernel.clock
    )
    late = [ticker.wait() or ticker.woke - ticker.due > US for _ in range(30)]
    assert [number for number, each in enumerate(late) if each] == [2]
    assert called == [0, 1, 2, *range(11, 30)]


def test_what_took_long_a_few_calls_ago_is_not_begun_when_less_time_is_left() -> None:
    kernel, called = Kernel(late=[0, 30, *[0] * 20, 30], busy_wait=100 * US), []
    ticker = kernel.ticker()
    ticker.meanwhile = WhileWaiting(
        lambda: (called.append(kernel.now // PERIOD), kernel.work(80 if len(called) == 1 else 50)), kernel.clock
    )
    for _ in range(25):
        assert ticker.wait() == 0
        assert ticker.woke - ticker.due <= US
    assert called == [0, *range(2, 25)]


def test_one_long_time_does_not_keep_it_from_being_done_for_good() -> None:
    kernel, called = Kernel(late=[0, *[40] * 400], busy_wait=100 * US), []
    ticker = kernel.ticker()
    ticker.meanwhile = kernel.noting(called, lambda: 95 if len(called) == 1 else 40)
    for _ in range(400):
        ticker.wait()
    assert called[1] < 60
    assert len(called) > 300


@pytest.mark.parametrize("long", [110, 250, 2500])
def test_what_always_takes_too_long_meanwhile_makes_fewer_and_fewer_ticks_late(long: int) -> None:
    kernel, called = Kernel(busy_wait=100 * US), []
    ticker = kernel.ticker()
    ticker.meanwhile = kernel.noting(called, lambda: long)
    for _ in range(1000):
        ticker.wait()
    assert len(called) <= 8


def test_nothing_is_done_meanwhile_when_the_tick_has_passed_or_the_thread_does_not_wait_busily() -> None:
    kernel = Kernel(late=[150], busy_wait=100 * US)
    ticker = kernel.ticker()
    ticker.meanwhile = WhileWaiting(lambda: pytest.fail("called after the tick"), kernel.clock)
    assert ticker.wait() == 0


def test_the_channel_is_one_whatever_it_is_called_and_only_an_input():
    assert TimerFd().channel("timer") == TimerFd().channel("x") == Channel("tick", Direction.INPUT, 63)


def test_a_timer_that_does_not_run_is_a_driver_error():
    driver = TimerFd()
    with pytest.raises(DriverError, match="not running"):
        driver.read(driver.channel("tick"))


@given(st.integers(0, 900), st.sampled_from([0, 200 * US]))
def test_a_stop_ends_the_wait_once_and_a_loop_that_goes_on_keeps_its_grid(at: int, busy_wait: int):
    """It comes while the thread sleeps, or while it works."""
    kernel = Kernel(busy_wait=busy_wait)
    ticker = kernel.ticker()
    assert ticker.wait() == 0

    def interrupted() -> None:
        kernel.now += at * US * (kernel.period - busy_wait) // PERIOD
        ticker.stop_waiting()

    kernel.sleeps.append(interrupted)
    begun = ticker.due
    if at:
        with pytest.raises(WaitEnded):
            ticker.wait()
    else:
        ticker.stop_waiting()
        with pytest.raises(WaitEnded):
            ticker.wait()
    assert kernel.now < begun + PERIOD
    kernel.sleeps.clear()
    assert ticker.wait() == 0
    assert ticker.due == begun + PERIOD


def test_a_stop_ends_a_nap_within_a_slice():
    """Of a thread that owes much sleep in a long period."""
    kernel = Kernel(busy_wait=200 * US, period=10_000 * PERIOD)
    ticker = kernel.ticker()
    ticker.wait()
    kernel.work(9_990_000)
    ticker.wait()
    kernel.work(9_990_000)
    naps = len(kernel.napped)
    kernel.after_nap = ticker.stop_waiting
    kernel.now = ticker.due + 5_000_000 * US  # half of the period is left
    with pytest.raises(WaitEnded):
        ticker.wait()
    assert kernel.napped[naps:] == [50_000]


def test_reset_does_not_move_the_grid():
    driver = TimerFd()
    kernel = Kernel()
    driver.ticker = kernel.ticker()
    kernel.work(2500)
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
