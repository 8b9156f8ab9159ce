"""Sequences: application code that the cycle itself advances, one step a period."""

from __future__ import annotations

import asyncio
import contextlib
import functools
import gc
import sys
import warnings
import weakref
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from helpers.cycling import Cycle, after, by_hand, gather, steps_until_done, stubborn
from helpers.machines import actuator
from umo import Compound, DigitalActuator, TaskFailed, connect
from umo.control import first, next_period, timeout, together, unless, until, wait
from umo.cycle.clock import Clock
from umo.cycle.sequences import Sequences, Task
from umo.errors import Cancelled, DeclarationError, TimeExpired
from umo.states import PassFail
from umo.testing import periods, put
from umo.text import place_of

# next_period -----------------------------------------------------------------------------------------


def test_a_started_sequence_begins_with_the_next_control_and_takes_one_step_a_period():
    seen = []

    async def count():
        for i in range(3):
            seen.append(i)
            await next_period()
        return "end"

    with Cycle() as cycle:
        task = cycle.start(count())
        assert seen == []
        for expected in ([0], [0, 1], [0, 1, 2]):
            cycle.steps(1)
            assert (seen, task.done, task.result) == (expected, False, None)
        cycle.steps(1)
        assert (task.done, task.result) == (True, "end")
        cycle.steps(1)
        assert seen == [0, 1, 2]


def test_next_period_returns_the_tick_with_the_periods_consumed():
    seen = []

    async def watch():
        while True:
            tick = await next_period()
            seen.append((tick.period, tick.ticks))

    with Cycle(missed=[0, 0, 3, 1]) as cycle:
        cycle.start(watch())
        cycle.steps(5)
    assert seen == [(0.001, 1), (0.001, 3), (0.001, 1), (0.001, 1)]


def test_sequences_act_before_control_so_that_a_setpoint_is_used_in_its_period():
    class Servo(Compound):
        timer: Any
        motor: DigitalActuator
        goal: float = 0.0

        def control(self) -> None:
            self.motor.write(self.goal)

    async def go(m):
        m.goal = 5.0
        await next_period()

    from helpers.machines import timer

    with connect(Servo(timer=timer(), motor=actuator())) as m:
        m.cycle.start(go(m))
        periods(m, 1)
        assert m.motor.read() == 5.0


def test_control_of_a_part_does_not_advance_sequences():
    class Inner(Compound):
        motor: DigitalActuator

    class Outer(Compound):
        inner: Inner

    with connect(Outer(inner=Inner(motor=actuator()))) as m:
        task = m.inner.cycle.start(asyncgen_free())
        m.inner.control()
        assert not task.done
        m.control()
        assert task.done


async def asyncgen_free():
    return 1


def test_a_sequence_that_starts_another_stays_before_it():
    seen: list[str] = []

    async def child():
        while True:
            seen.append("child")
            await next_period()

    async def parent(m):
        m.cycle.start(child())
        while True:
            seen.append("parent")
            await next_period()

    with Cycle() as cycle:
        cycle.start(parent(cycle.m))
        cycle.steps(3)
    assert seen == ["parent", "parent", "child", "parent", "child"]


def test_a_sequence_started_by_another_begins_with_the_next_period():
    seen = []

    async def child(m):
        seen.append(m.now)

    async def parent(m):
        m.cycle.start(child(m))
        seen.append(m.now)
        await next_period()

    with Cycle() as cycle:
        cycle.start(parent(cycle.m))
        cycle.steps(2)
    assert seen == pytest.approx([0.001, 0.002])


# wait ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("duration", "ends_in"),
    [
        (0, 1),
        ("0 s", 1),
        ("0.1 ms", 2),
        ("1 ms", 2),
        (0.001, 2),
        ("1.1 ms", 3),
        ("5 ms", 6),
        (0.1, 101),
        ("0.3 s", 301),
    ],
)
def test_wait_takes_whole_periods_rounded_up(duration, ends_in):
    assert steps_until_done(wait(duration)) == ends_in


def test_a_rounding_error_is_not_a_period_more():
    """0.07 / 0.01 is a little above 7 in floating point."""
    sequences, clock = Sequences(), Clock(0.01)
    task = sequences.start(wait(0.07))
    for _ in range(8):
        assert not task.done
        sequences.advance(clock)
    assert task.done


@given(st.integers(1, 200), st.lists(st.integers(0, 4), max_size=60))
def test_missed_periods_count_in_a_wait(whole, missed):
    ends = steps_until_done(wait(whole * 0.001), missed)
    ticks = [max(missed[i], 1) if i < len(missed) else 1 for i in range(ends)]
    assert sum(ticks[1:]) >= whole
    assert sum(ticks[1:-1]) < whole


@pytest.mark.parametrize("wrong", ["soon", -1, float("nan"), float("inf"), None])
def test_a_wait_for_no_duration_is_an_error(wrong):
    with Cycle() as cycle:
        cycle.start(wait(wrong))
        with pytest.raises(DeclarationError, match="is not a duration"):
            cycle.steps(1)


def test_a_machine_without_a_timer_cannot_count_seconds():
    class Still(Compound):
        motor: DigitalActuator

    with connect(Still(motor=actuator())) as m:
        m.cycle.start(wait("1 s"))
        m.control()
        with pytest.raises(TaskFailed, match="without a timer"):
            m.control()


# until -----------------------------------------------------------------------------------------------


def test_until_asks_at_once_and_then_once_a_period():
    asked = []

    def condition():
        asked.append(1)
        return len(asked) == 4

    assert steps_until_done(until(condition)) == 4
    assert len(asked) == 4
    assert steps_until_done(until(lambda: True)) == 1


@pytest.mark.parametrize(("timeout", "ends_in"), [("3 ms", 4), (0.003, 4), ("2.5 ms", 4), (0, 1)])
def test_until_expires_after_its_timeout(timeout, ends_in):
    with Cycle() as cycle:
        cycle.start(until(lambda: False, timeout))
        cycle.steps(ends_in - 1)
        with pytest.raises(
            TimeExpired, match=r"lambda: False, timeout.*test_sequences.py:\d+\) did not come true within 0\.?0?0?\d* s"
        ) as caught:
            cycle.steps(1)
        assert isinstance(caught.value, TimeoutError)


def test_until_takes_a_condition_that_comes_true_in_its_last_period():
    asked = []

    def condition():
        asked.append(1)
        return len(asked) == 4

    assert steps_until_done(until(condition, "3 ms")) == 4


def test_missed_periods_count_in_a_timeout():
    with Cycle(missed=[0, 5]) as cycle:
        cycle.start(until(lambda: False, "5 ms"))
        cycle.steps(1)
        with pytest.raises(TimeExpired):
            cycle.steps(1)


@pytest.mark.parametrize(
    ("levels", "ends_in"),
    [("1111", 3), ("011111", 4), ("1101111", 6), ("10111", 5)],
)
def test_until_waits_until_the_condition_has_stayed_true(levels, ends_in):
    asked = iter(levels)
    assert steps_until_done(until(lambda: next(asked) == "1", stays="2 ms")) == ends_in


def test_missed_periods_count_in_what_stays():
    assert steps_until_done(until(lambda: True, stays="4 ms"), missed=[0, 4]) == 2


def test_a_condition_that_does_not_stay_true_is_named():
    with Cycle() as cycle:
        cycle.start(until(lambda: cycle.m.now % 0.002 < 0.0005, "20 ms", stays="3 ms"))
        with pytest.raises(TimeExpired, match=r"did not stay true for 0.003 s within 0.02 s"):
            cycle.steps(22)


def test_a_condition_without_source_is_named_as_well():
    with Cycle() as cycle:
        cycle.start(until(functools.partial(bool, 0), 0))
        with pytest.raises(TimeExpired, match=r"functools.partial.* did not come true"):
            cycle.steps(1)


def test_until_sees_the_sample_of_the_same_period():
    with Cycle() as cycle:
        task = cycle.start(until(lambda: cycle.m.limit.read() is PassFail.FAIL))
        cycle.steps(2)
        put(cycle.m.limit, PassFail.FAIL)
        cycle.steps(1)
        assert task.done


# A block with a time limit ---------------------------------------------------------------------------


async def limited(duration, sequence):
    async with timeout(duration):
        return await sequence


@pytest.mark.parametrize(("takes", "ends"), [(1, True), (3, True), (4, False)])
def test_a_block_that_takes_longer_than_its_limit_expires(takes, ends):
    log = []
    with Cycle() as cycle:
        task = cycle.start(limited("3 ms", after(takes, "result", log)))
        if ends:
            cycle.steps(takes + 1)
            assert (task.done, task.result) == (True, "result")
        else:
            cycle.steps(3)
            with pytest.raises(TimeExpired, match=r"the block did not end within 0.003 s \(.*test_sequences.py:\d+\)"):
                cycle.steps(1)
            assert log == ["cancelled result", "left result"]


def test_missed_periods_count_in_the_limit_of_a_block():
    with Cycle(missed=[0, 5]) as cycle:
        cycle.start(limited("5 ms", after(9, log=[])))
        cycle.steps(1)
        with pytest.raises(TimeExpired):
            cycle.steps(1)


def test_of_nested_blocks_the_one_whose_time_is_over_expires():
    async def nested(outer, inner):
        try:
            async with timeout(outer):
                try:
                    async with timeout(inner):
                        await wait("1 s")
                except TimeExpired:
                    await wait("2 ms")
                    return "inner"
        except TimeExpired:
            return "outer"

    for outer, inner, expected in (("9 ms", "2 ms", "inner"), ("2 ms", "9 ms", "outer"), ("3 ms", "2 ms", "outer")):
        with Cycle() as cycle:
            task = cycle.start(nested(outer, inner))
            cycle.steps(10)
            assert task.result == expected


def test_a_block_in_one_of_several_sequences_limits_that_one():
    async def first():
        with contextlib.suppress(TimeExpired):
            await limited("2 ms", wait("1 s"))
        return 1

    with Cycle() as cycle:
        task = cycle.start(gather(first(), after(5, 2)))
        cycle.steps(6)
        assert task.result == (1, 2)


def test_a_block_around_several_sequences_cancels_them_all():
    log = []
    with Cycle() as cycle:
        cycle.start(limited("2 ms", gather(after(9, 1, log), after(9, 2, log))))
        with pytest.raises(TimeExpired):
            cycle.steps(3)
    assert log == ["cancelled 2", "left 2", "cancelled 1", "left 1"]


def test_a_stop_within_a_block_is_not_its_timeout():
    log = []
    with Cycle() as cycle:
        cycle.start(limited("1 s", after(99, 1, log)))
        cycle.steps(2)
    assert log == ["cancelled 1", "left 1"]


async def tidying(log, block):
    """A block of 2 ms with a clean-up of 5 ms."""
    async with block:
        try:
            await wait("1 s")
        finally:
            log.append("tidying")
            await wait("5 ms")
            log.append("tidy")


def test_a_block_used_again_counts_from_the_start():
    async def twice():
        block = timeout("3 ms")
        for _ in range(3):
            async with block:
                await wait("2 ms")
        for _ in range(2):
            with contextlib.suppress(TimeExpired):
                async with block:
                    await wait("1 s")
        return "ended"

    with Cycle() as cycle:
        task = cycle.start(twice())
        cycle.steps(13)
        assert task.result == "ended"


def test_a_block_that_is_in_use_cannot_be_used_once_more():
    async def nested():
        block = timeout("3 ms")
        async with block, block:
            pass

    with Cycle() as cycle:
        cycle.start(nested())
        with pytest.raises(TaskFailed, match="in use"):
            cycle.steps(1)


@pytest.mark.parametrize("how", ["stop", "cancel"])
def test_a_stop_while_an_expired_block_cleans_up_stops_it(how):
    log = []
    with Cycle() as cycle:
        task = cycle.start(tidying(log, timeout("2 ms")))
        cycle.steps(4)
        assert log == ["tidying"]
        if how == "cancel":
            task.cancel()
    assert log == ["tidying"]
    assert task.done


def test_an_outer_block_that_expires_while_an_inner_one_cleans_up_ends_the_inner_one():
    log = []

    async def nested():
        try:
            async with timeout("4 ms"):
                with contextlib.suppress(TimeExpired):
                    await tidying(log, timeout("2 ms"))
                log.append("went on")
                await wait("1 s")
        except TimeExpired:
            return "outer"

    with Cycle() as cycle:
        task = cycle.start(nested())
        cycle.steps(6)
        assert (task.result, log) == ("outer", ["tidying"])


@pytest.mark.parametrize("started", ["before", "after"])
def test_a_block_that_expires_cancels_the_started_sequence_that_it_awaits(started):
    log, tasks = [], []

    async def block(m):
        if started == "after":
            tasks.append(m.cycle.start(after(99, "child", log)))
        async with timeout("2 ms"):
            await tasks[0]

    with Cycle() as cycle:
        if started == "before":
            tasks.append(cycle.start(after(99, "child", log)))
        cycle.start(block(cycle.m))
        with pytest.raises(TimeExpired):
            cycle.steps(4)
        assert log == ["cancelled child", "left child"]
        assert tasks[0].done


def test_a_block_outside_of_a_sequence_is_an_error():
    async def block():
        async with timeout("1 s"):
            pass

    with pytest.raises(TaskFailed, match="only in a sequence"):
        by_hand(block())


# Waiting for a task ----------------------------------------------------------------------------------


def test_a_sequence_may_wait_for_another_and_gets_its_result():
    async def parent(m):
        task = m.cycle.start(after(3, "child"))
        return await task, await task

    with Cycle() as cycle:
        task = cycle.start(parent(cycle.m))
        cycle.steps(6)
        assert task.result == ("child", "child")


def test_to_wait_for_a_cancelled_task_is_an_error():
    async def parent(m):
        task = m.cycle.start(after(30, log=[]))
        await next_period()
        task.cancel()
        await task

    with Cycle() as cycle:
        cycle.start(parent(cycle.m))
        with pytest.raises(TaskFailed, match="sequence after was cancelled"):
            cycle.steps(3)


@pytest.mark.parametrize("when", ["before", "after"])
def test_to_wait_for_a_task_that_failed_is_an_error_with_its_cause(when):
    """If nobody waited when it failed, the error came out of `control`, and the program went on."""

    async def waits(task):
        return await task

    with Cycle() as cycle:
        task = cycle.start(after(2, error=ValueError("broken")))
        if when == "before":
            cycle.start(waits(task))
        else:
            with pytest.raises(ValueError, match="broken"):
                cycle.steps(5)
        if when == "after":
            cycle.start(waits(task))
        with pytest.raises(TaskFailed, match=r"sequence after failed: ValueError: broken \(.*cycling.py") as caught:
            cycle.steps(5)
        assert isinstance(caught.value.__cause__, ValueError)


def test_of_two_sequences_that_wait_for_each_other_the_second_is_told():
    """It was told of neither: each waited until its time limit, or for ever."""
    tasks = []

    async def one():
        await tasks[1]

    async def other():
        async with timeout("9 ms"):
            await tasks[0]

    with Cycle() as cycle:
        tasks += [cycle.start(one()), cycle.start(other())]
        with pytest.raises(TaskFailed, match=r"other awaits .*one: it would wait for itself \(.*one awaits .*other\)"):
            cycle.steps(2)
        assert [task.done for task in tasks] == [True, True]


def test_a_task_that_waits_for_itself_is_an_error():
    own = []

    async def snake():
        await own[0]

    with Cycle() as cycle:
        own.append(cycle.start(snake()))
        with pytest.raises(TaskFailed, match=r"snake awaits sequence .*snake: it would wait for itself$"):
            cycle.steps(1)


# together --------------------------------------------------------------------------------------------


def test_together_runs_side_by_side_and_gives_the_results_in_order():
    with Cycle() as cycle:
        task = cycle.start(gather(after(3, "a"), after(1, "b"), after(0, "c")))
        cycle.steps(3)
        assert not task.done
        cycle.steps(1)
        assert (task.done, task.result) == (True, ("a", "b", "c"))


def test_together_of_nothing_ends_at_once():
    assert steps_until_done(gather()) == 1


def test_the_first_failure_cancels_the_rest_and_is_raised():
    log: list[str] = []
    with Cycle() as cycle:
        cycle.start(gather(after(9, "a", log), after(1, "b", error=ValueError("first")), after(9, "c", log)))
        cycle.steps(1)
        with pytest.raises(ValueError, match="first"):
            cycle.steps(1)
        assert log == ["cancelled c", "left c", "cancelled a", "left a"]
        cycle.steps(2)


def test_what_follows_a_failure_in_the_same_period_is_not_begun():
    begun = []

    async def late():
        begun.append(1)

    with Cycle() as cycle:
        cycle.start(gather(after(0, "a", error=ValueError("first")), late()))
        with pytest.raises(ValueError, match="first"):
            cycle.steps(1)
    assert begun == []


def test_a_failing_clean_up_spares_none_of_the_others_and_hides_not_the_first_failure():
    log: list[str] = []
    with Cycle() as cycle:
        cycle.start(gather(stubborn(log, "a"), after(1, error=ValueError("first")), stubborn(log, "b")))
        cycle.steps(1)
        with pytest.raises(ValueError, match="first") as caught:
            cycle.steps(1)
    assert log == ["b", "a"]
    assert len(caught.value.__notes__) == 2


def test_cancelling_together_cancels_all_and_an_error_in_their_clean_up_surfaces():
    log: list[str] = []
    with Cycle() as cycle:
        task = cycle.start(gather(stubborn(log, "a"), stubborn(log, "b")))
        cycle.steps(2)
        with pytest.raises(RuntimeError, match="cleaning up b") as caught:
            task.cancel()
    assert log == ["b", "a"]
    assert "cleaning up a" in caught.value.__notes__[0]


def test_waits_in_together_count_the_same_periods():
    assert steps_until_done(gather(wait("3 ms"), wait("5 ms")), missed=[0, 2, 0]) == 5


# Cancel ----------------------------------------------------------------------------------------------


def test_leaving_throws_cancelled_into_every_sequence_the_last_started_first():
    log: list[str] = []
    with Cycle() as cycle:
        tasks = [cycle.start(after(99, name, log)) for name in "abc"]
        cycle.steps(2)
        assert log == []
    assert log == ["cancelled c", "left c", "cancelled b", "left b", "cancelled a", "left a"]
    assert all(task.done for task in tasks)


def test_a_sequence_that_never_began_is_dropped_without_a_word():
    log: list[str] = []
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with Cycle() as cycle:
            cycle.start(after(99, "a", log))
        gc.collect()
    assert log == []


def test_a_task_can_be_cancelled_and_the_rest_go_on():
    log: list[str] = []
    with Cycle() as cycle:
        one, other = cycle.start(after(99, "a", log)), cycle.start(after(2, "b"))
        cycle.steps(1)
        one.cancel()
        one.cancel()
        assert (log, one.done) == (["cancelled a", "left a"], True)
        cycle.steps(2)
        assert other.result == "b"


def test_a_cancelled_sequence_has_left_when_cancel_returns_whatever_it_does_about_it():
    log: list[str] = []

    async def returns():
        try:
            await next_period()
        except Cancelled:
            log.append("returned")

    async def awaits_again():
        try:
            while True:
                with contextlib.suppress(Cancelled):
                    await next_period()
        finally:
            log.append("left")

    with Cycle() as cycle:
        for sequence in (returns, awaits_again):
            task = cycle.start(sequence())
            cycle.steps(1)
            task.cancel()
            assert task.done
    assert log == ["returned", "left"]


def test_a_sequence_that_waits_again_whatever_cancels_it_is_named_with_its_place():
    """It was told as "coroutine ignored GeneratorExit", without a name: the application was searched for it."""

    async def swallows():
        for _ in range(3):  # the third time is Python's own, when the sequence is freed
            with contextlib.suppress(BaseException):
                await wait("1 s")

    async def stops(how):
        task = cycle.start(swallows())
        await wait("2 ms")
        task.cancel() if how == "cancel" else await first(task, wait("1 ms"))

    place = r"tests/cycle/test_sequences\.py:\d+ in swallows"
    message = rf"sequence .*swallows was cancelled and did not end: it waits again \({place}\)"
    for how in ("cancel", "first"):
        with Cycle() as cycle:
            cycle.start(stops(how))
            with pytest.raises(TaskFailed, match=message):
                cycle.steps(5)
    with pytest.raises(TaskFailed, match=message), Cycle() as cycle:
        cycle.start(swallows())
        cycle.steps(2)


def test_an_error_in_what_a_cancelled_sequence_went_on_to_await_is_not_lost():
    log: list[str] = []

    async def work():
        with contextlib.suppress(Cancelled):
            await next_period()
        await together(stubborn(log, "a"))

    with Cycle() as cycle:
        task = cycle.start(work())
        cycle.steps(1)
        with pytest.raises(RuntimeError, match="cleaning up a"):
            task.cancel()
    assert log == ["a"]


def test_cancelled_is_no_exception_that_a_sequence_catches_by_accident():
    assert not issubclass(Cancelled, Exception)
    log: list[str] = []

    async def careless():
        try:
            await next_period()
        except Exception:
            log.append("caught")

    with Cycle() as cycle:
        cycle.start(careless())
        cycle.steps(1)
    assert log == []


@pytest.mark.parametrize("together_with_another", [False, True])
def test_a_task_that_cancels_itself_cleans_up_where_it_awaits_next(together_with_another):
    log: list[str] = []

    tasks = []

    async def work(m):
        try:
            await next_period()
            tasks[0].cancel()
            log.append("still in this period")
            await next_period()
            log.append("went on")
        except Cancelled:
            log.append("cancelled")
            raise
        finally:
            log.append("left")

    with Cycle() as cycle:
        sequence = gather(work(cycle.m), after(99, "b", log)) if together_with_another else work(cycle.m)
        other = cycle.start(after(2, "other"))
        tasks.append(cycle.start(sequence))
        cycle.steps(1)
        assert not tasks[0].done
        cycle.steps(1)
        beside = ["cancelled b", "left b"] if together_with_another else []
        assert log == ["still in this period", *beside, "cancelled", "left"]
        assert (tasks[0].done, tasks[0].result) == (True, None)
        cycle.steps(1)
        assert other.done


def test_a_task_that_cancels_itself_and_then_returns_has_ended_with_its_result():
    async def work(tasks):
        tasks[0].cancel()
        return "end"

    with Cycle() as cycle:
        tasks: list[Any] = []
        tasks.append(cycle.start(work(tasks)))
        cycle.steps(2)
        assert (tasks[0].done, tasks[0].result) == (True, "end")


def test_an_error_in_the_clean_up_of_a_task_that_cancels_itself_comes_out_of_control():
    async def work(tasks):
        try:
            tasks[0].cancel()
            await next_period()
        finally:
            raise ValueError("cleaning up")

    with Cycle() as cycle:
        tasks: list[Any] = []
        tasks.append(cycle.start(work(tasks)))
        with pytest.raises(ValueError, match="cleaning up"):
            cycle.steps(1)
        cycle.steps(1)


def line_of(error):
    """The name of the function that raised it."""
    trace = error.__traceback__
    while trace.tb_next is not None:
        trace = trace.tb_next
    return trace.tb_frame.f_code.co_name


def test_stopping_raises_the_first_error_of_a_clean_up_as_it_is_and_notes_the_others():
    log: list[str] = []
    sequences = Sequences()
    for name in "abc":
        sequences.start(stubborn(log, name))
    sequences.start(after(99, "d", log))
    sequences.advance(Clock(0.001))
    with pytest.raises(RuntimeError, match="cleaning up c") as caught:
        sequences.cancel()
    assert line_of(caught.value) == "stubborn"
    assert log == ["cancelled d", "left d", "c", "b", "a"]
    beside = [note.partition("cleaning up ")[2][0] for note in caught.value.__notes__]
    assert beside == ["b", "a"]
    sequences.cancel()


def test_what_a_clean_up_starts_is_dropped_too():
    begun: list[int] = []

    async def child():
        begun.append(1)

    async def parent(m):
        try:
            await next_period()
        finally:
            m.cycle.start(child())

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with Cycle() as cycle:
            cycle.start(parent(cycle.m))
            cycle.steps(1)
        gc.collect()
    assert begun == []


# Errors ----------------------------------------------------------------------------------------------


def test_an_error_that_nobody_awaits_comes_out_of_control_and_the_others_live_on():
    with Cycle() as cycle:
        cycle.start(after(1, error=ValueError("alone")))
        other = cycle.start(after(4, "b"))
        cycle.steps(1)
        with pytest.raises(ValueError, match="alone"):
            cycle.steps(1)
        cycle.steps(5)
        assert other.result == "b"


def test_two_errors_in_one_period_surface_one_after_the_other():
    with Cycle() as cycle:
        cycle.start(after(0, error=ValueError("one")))
        cycle.start(after(0, error=KeyError("two")))
        with pytest.raises(ValueError):
            cycle.steps(1)
        with pytest.raises(KeyError):
            cycle.steps(1)


def exits():
    sys.exit(0)


def closes():
    raise GeneratorExit


def runs_out():
    next(iter(()))


@pytest.mark.parametrize("leave", [exits, closes])
@pytest.mark.parametrize("where", ["alone", "together", "in a condition"])
def test_what_would_end_the_run_in_silence_comes_out_as_an_error_that_names_the_sequence(leave, where):
    async def work():
        await next_period()
        if where == "in a condition":
            await until(leave)
        leave()

    log: list[str] = []
    with Cycle() as cycle:
        cycle.start(gather(after(99, "b", log), work()) if where == "together" else work())
        cycle.steps(1)
        with pytest.raises(TaskFailed, match=r"work raised (SystemExit: 0|GeneratorExit) \(") as caught:
            cycle.steps(1)
        assert line_of(caught.value.__cause__) == leave.__name__
        assert log == (["cancelled b", "left b"] if where == "together" else [])


@pytest.mark.parametrize("leave", [exits, closes])
def test_a_clean_up_may_not_end_the_run_in_silence_either(leave):
    async def work():
        try:
            await next_period()
        finally:
            leave()

    with Cycle() as cycle:
        task = cycle.start(work())
        cycle.steps(1)
        with pytest.raises(TaskFailed, match="work raised"):
            task.cancel()


@pytest.mark.parametrize("where", ["alone", "together", "in a condition"])
def test_an_iterator_that_runs_out_ends_no_sequence_as_if_it_had_returned(where):
    async def work():
        await next_period()
        if where == "in a condition":
            await until(runs_out, "1 s")
        runs_out()

    with Cycle() as cycle:
        cycle.start(gather(after(99), work()) if where == "together" else work())
        cycle.steps(1)
        with pytest.raises(RuntimeError, match="raised StopIteration") as caught:
            cycle.steps(1)
        assert line_of(caught.value.__cause__) == "runs_out"


def test_a_sequence_that_was_started_twice_is_an_error_that_says_so():
    async def work():
        await next_period()

    with Cycle() as cycle:
        sequence = work()
        cycle.start(sequence)
        cycle.start(sequence)
        with pytest.raises(
            TypeError, match="work was started twice; call the `async def` function again for each start"
        ):
            cycle.steps(1)
        cycle.steps(1)


def test_a_sequence_that_starts_itself_is_an_error_that_says_so():
    own: list[Any] = []

    async def work(m):
        m.cycle.start(own[0])
        await next_period()
        await next_period()

    with Cycle() as cycle:
        own.append(work(cycle.m))
        cycle.start(own[0])
        cycle.steps(1)
        with pytest.raises(TypeError, match="was started twice"):
            cycle.steps(1)


def test_a_sequence_that_runs_the_control_of_the_machine_is_an_error_that_says_so():
    async def work(m):
        m.control()

    with Cycle() as cycle:
        cycle.start(work(cycle.m))
        other = cycle.start(after(1))
        with pytest.raises(TaskFailed, match="a sequence called `control` of the root"):
            cycle.steps(1)
        cycle.steps(2)
        assert other.done


class Foreign:
    def __await__(self):
        yield "something"


@pytest.mark.parametrize("where", ["alone", "together"])
def test_a_foreign_awaitable_is_a_type_error(where):
    log: list[str] = []

    async def mistaken():
        try:
            await Foreign()
        finally:
            log.append("left")

    with Cycle() as cycle:
        cycle.start(mistaken() if where == "alone" else gather(after(9, "b", log), mistaken()))
        with pytest.raises(
            TypeError, match=r"awaited 'something'; a sequence can await only the functions of umo.control"
        ):
            cycle.steps(1)
        assert log == (["left"] if where == "alone" else ["left", "cancelled b", "left b"])


def test_an_error_in_the_clean_up_after_a_foreign_awaitable_hides_not_the_mistake():
    async def mistaken():
        try:
            await Foreign()
        finally:
            raise ValueError("cleaning up")

    with Cycle() as cycle:
        cycle.start(mistaken())
        with pytest.raises(TypeError, match="awaited 'something'") as caught:
            cycle.steps(1)
    assert "cleaning up" in caught.value.__notes__[0]


def test_a_sleep_of_asyncio_is_a_type_error_though_it_yields_nothing():
    async def mistaken():
        await asyncio.sleep(0)

    with Cycle() as cycle:
        cycle.start(mistaken())
        with pytest.raises(TypeError, match=r"awaited None; a sequence can await only the functions of umo.control"):
            cycle.steps(1)


@pytest.mark.parametrize("wrong", [None, 5, lambda: None, iter([])])
def test_only_a_coroutine_is_a_sequence(wrong):
    with Cycle() as cycle, pytest.raises(TypeError, match="is not a sequence; call an `async def` function"):
        cycle.start(wrong)


def test_a_longer_sleep_of_asyncio_is_a_type_error_at_the_users_line():
    async def sequence():
        await asyncio.sleep(1.0)

    with pytest.raises(TypeError, match="asyncio cannot be used in a sequence") as caught:
        Task(sequence()).advance(None)
    assert "test_sequences.py" in place_of(caught.value)


def test_umo_needs_no_asyncio_loop():
    with pytest.raises(RuntimeError):
        asyncio.get_running_loop()
    assert steps_until_done(gather(wait("2 ms"), until(lambda: True))) == 3


def test_an_error_that_the_application_handles_keeps_nothing_alive():
    """The collector is off while a machine runs, and an application may try again for a day."""

    class Large:
        pass

    left = []

    async def fails():
        at_client = Large()
        left.append(weakref.ref(at_client))
        await next_period()
        raise ValueError(type(at_client).__name__)

    async def again_and_again():
        while True:
            with contextlib.suppress(ValueError):
                await together(fails(), wait(10.0))
            with contextlib.suppress(TimeExpired):
                async with timeout(0.002):
                    await fails_late()
            with contextlib.suppress(TimeExpired):
                at_client = Large()
                left.append(weakref.ref(at_client))
                await until(lambda at_client=at_client: at_client is None, 0.002)
            at_client = None

    async def fails_late():
        at_client = Large()
        left.append(weakref.ref(at_client))
        await wait(10.0)

    gc.disable()
    try:
        with Cycle() as cycle:
            cycle.start(again_and_again())
            cycle.steps(60)
            assert len(left) > 20
            assert sum(each() is not None for each in left[:-4]) == 0
    finally:
        gc.enable()


async def failing():
    for _ in range(3):
        await next_period()
    raise TaskFailed("the valve sticks")


async def awaiting_for(count, task):
    passed = iter(range(count))

    async def waiting():
        await task

    return await unless(lambda: next(passed, None) is None, waiting())


@pytest.mark.parametrize("fails_first", [True, False])
def test_a_failure_whose_awaiter_is_cancelled_in_the_same_period_comes_out_of_control(fails_first):
    with Cycle() as cycle:
        if fails_first:
            task = cycle.start(failing())
            cycle.start(awaiting_for(3, task))
        else:

            async def main():
                await awaiting_for(5, cycle.start(failing()))

            cycle.start(main())
        with pytest.raises(TaskFailed, match="the valve sticks"):
            cycle.steps(9)
        cycle.steps(9)


def test_a_failure_that_its_awaiter_takes_in_time_does_not_come_out_of_control():
    with Cycle() as cycle:

        async def main():
            with contextlib.suppress(TaskFailed):
                await awaiting_for(6, cycle.start(failing()))
            return "taken"

        task = cycle.start(main())
        cycle.steps(9)
        assert task.result == "taken"


def test_a_failure_that_nobody_has_taken_before_the_stop_is_raised_by_the_stop():
    cycle = Cycle()

    async def main():
        await cycle.start(failing())

    with pytest.raises(TaskFailed, match="the valve sticks"), cycle:
        cycle.start(main())
        cycle.steps(5)
