"""Sequences in parallel within another one: `first`, `unless`, and random trees of them with `together` and `Lock`.

`together` alone is in test_sequences.py.
"""

from __future__ import annotations

import contextlib
import gc
import weakref
from functools import partial
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.cycling import Cycle, after, steps_until_done, stubborn
from umo import TaskFailed
from umo.control import First, Lock, first, next_period, timeout, together, unless, until, wait
from umo.errors import Cancelled, TimeExpired


def ended(sequence: Any, steps: int = 20) -> Any:
    """The result of a sequence that ends within so many periods."""
    with Cycle() as cycle:
        task = cycle.start(sequence)
        cycle.steps(steps)
        assert task.done
        return task.result


# first -----------------------------------------------------------------------------------------------


def test_first_returns_which_one_ended_and_its_result_and_cancels_the_others():
    log: list[str] = []
    with Cycle() as cycle:
        task = cycle.start(first(after(9, "a", log), after(2, "b", log), after(9, "c", log)))
        cycle.steps(2)
        assert not task.done
        cycle.steps(1)
        assert (task.done, task.result) == (True, First(number=1, result="b"))
        assert log == ["left b", "cancelled c", "left c", "cancelled a", "left a"]


def test_of_two_that_would_end_in_the_same_period_the_one_given_first_counts():
    log: list[str] = []
    assert ended(first(after(3, "a", log), after(2, "b", log), after(2, "c", log))) == (1, "b")
    assert log == ["left b", "cancelled c", "left c", "cancelled a", "left a"]


def test_what_follows_one_that_ends_at_once_is_not_begun():
    log: list[str] = []
    assert ended(first(after(0, "a"), after(0, "b", log), together(after(0, "c", log)))) == (0, "a")
    assert log == []


def test_an_error_of_one_cancels_the_others_and_is_raised():
    log: list[str] = []
    with Cycle() as cycle:
        cycle.start(first(after(9, "a", log), after(1, error=ValueError("one")), after(9, "c", log)))
        cycle.steps(1)
        with pytest.raises(ValueError, match="one"):
            cycle.steps(1)
    assert log == ["cancelled c", "left c", "cancelled a", "left a"]


def test_an_error_in_the_clean_up_of_a_cancelled_one_is_raised_with_those_of_the_others():
    log: list[str] = []
    with Cycle() as cycle:
        cycle.start(first(stubborn(log, "a"), after(1, "b"), stubborn(log, "c")))
        cycle.steps(1)
        with pytest.raises(RuntimeError, match="cleaning up c") as caught:
            cycle.steps(1)
    assert log == ["c", "a"]
    assert "cleaning up a" in caught.value.__notes__[0]


def test_a_first_that_is_cancelled_cancels_all():
    log: list[str] = []
    with Cycle() as cycle:
        task = cycle.start(first(after(9, "a", log), after(9, "b", log)))
        cycle.steps(2)
        task.cancel()
    assert log == ["cancelled b", "left b", "cancelled a", "left a"]


def test_first_of_nothing_is_an_error():
    with Cycle() as cycle:
        cycle.start(first())
        with pytest.raises(TypeError, match=r"first\(\) needs at least one sequence"):
            cycle.steps(1)


@pytest.mark.parametrize("parallel", [together, first])
def test_a_part_that_is_no_sequence_is_an_error(parallel):
    with Cycle() as cycle:
        cycle.start(parallel(None))
        with pytest.raises(TypeError, match="None is not a sequence; call an `async def` function"):
            cycle.steps(1)


def test_waits_in_first_count_missed_periods():
    assert steps_until_done(first(wait("9 ms"), wait("5 ms")), missed=[0, 2, 0]) == 5


# unless ----------------------------------------------------------------------------------------------


def test_a_sequence_that_ends_by_itself_is_told_from_one_that_the_condition_ended():
    log: list[str] = []
    with Cycle() as cycle:
        m = cycle.m
        begun = m.now
        ends = cycle.start(unless(lambda: m.now - begun > 0.0055, after(3, "a", log)))
        ended = cycle.start(unless(lambda: m.now - begun > 0.0025, after(3, "b", log)))
        cycle.steps(6)
        assert (ends.result, ended.result) == (True, False)
    assert log == ["cancelled b", "left b", "left a"]


def test_a_sequence_whose_condition_is_true_at_once_never_begins():
    log: list[str] = []
    assert ended(unless(lambda: True, after(0, "a", log))) is False
    assert ended(unless(lambda: True, together(after(0, "a", log), first(after(0, "b", log))))) is False
    assert log == []


def test_the_condition_is_evaluated_before_each_step_and_not_after_the_last():
    seen: list[str] = []

    def condition() -> bool:
        seen.append("condition")
        return False

    async def work() -> None:
        for _ in range(3):
            seen.append("step")
            await next_period()

    assert ended(unless(condition, work())) is True
    assert seen == ["condition", "step"] * 3 + ["condition"]


def test_an_error_in_the_condition_cancels_the_sequence_and_is_raised():
    log: list[str] = []

    async def work() -> None:
        await unless(lambda: bool(log) and 1 / 0 > 1, work_of(log))

    async def work_of(log: list[str]) -> None:
        try:
            await next_period()
            log.append("step")
            await wait(10)
        finally:
            log.append("left")

    with Cycle() as cycle:
        cycle.start(work())
        cycle.steps(2)
        with pytest.raises(ZeroDivisionError):
            cycle.steps(1)
    assert log == ["step", "left"]


def test_an_error_of_the_sequence_is_raised():
    with Cycle() as cycle:
        cycle.start(unless(lambda: False, after(1, error=ValueError("broken"))))
        with pytest.raises(ValueError, match="broken"):
            cycle.steps(2)


def test_an_error_in_the_clean_up_of_a_sequence_that_the_condition_ended_is_raised():
    log: list[str] = []
    with Cycle() as cycle:
        cycle.start(unless(lambda: len(log) > 3, together(stubborn([], "a"), counting(log))))
        with pytest.raises(RuntimeError, match="cleaning up a"):
            cycle.steps(9)


async def counting(log: list[str]) -> None:
    while True:
        log.append("step")
        await next_period()


def test_a_block_with_a_time_limit_ends_what_it_runs():
    log: list[str] = []

    async def work() -> None:
        with contextlib.suppress(TimeExpired):
            async with timeout("3 ms"):
                await unless(lambda: False, first(after(99, "a", log), after(99, "b", log)))
        log.append("went on")

    ended(work())
    assert log == ["cancelled b", "left b", "cancelled a", "left a", "went on"]


# Started sequences -----------------------------------------------------------------------------------


@pytest.mark.parametrize("parallel", [together, first, lambda task: unless(lambda: False, task)])
def test_a_started_sequence_may_run_among_others(parallel):
    log: list[str] = []
    with Cycle() as cycle:
        ends = cycle.start(after(2, "a", log))
        task = cycle.start(parallel(ends))
        cycle.steps(4)
        assert (task.done, ends.result) == (True, "a")
        never = cycle.start(after(99, "b", log))
        task = cycle.start(parallel(never))
        cycle.steps(2)
        task.cancel()
        assert never.done
    assert log == ["left a", "cancelled b", "left b"]


def test_an_error_of_a_started_sequence_is_raised_and_cancels_the_others():
    log: list[str] = []

    async def work(m: Any) -> str:
        try:
            await first(m.cycle.start(after(1, error=ValueError("broken"))), after(9, "b", log))
        except TaskFailed as error:
            return str(error)
        return ""

    with Cycle() as cycle:
        task = cycle.start(work(cycle.m))
        cycle.steps(5)
        assert task.result.startswith("sequence after failed: ValueError: broken")
    assert log == ["cancelled b", "left b"]


# What is never begun ---------------------------------------------------------------------------------


@pytest.mark.parametrize("how", ["cancelled", "stopped"])
def test_a_tree_of_sequences_that_never_begins_is_dropped_without_a_word(how):
    """Warnings are errors: Python would warn of each coroutine that was never awaited."""
    log: list[str] = []
    with Cycle() as cycle:
        task = cycle.start(together(first(after(0, 1, log), unless(lambda: True, after(0, 2, log))), wait(1)))
        if how == "cancelled":
            task.cancel()
            cycle.steps(2)
    gc.collect()
    assert task.done
    assert log == []


# Leaks -----------------------------------------------------------------------------------------------


class Large:
    """Something that a frame keeps."""


def test_errors_that_the_application_handles_keep_nothing_alive():
    """The collector is off while a machine runs, and an application may try again for a day."""
    left: list[weakref.ref[Large]] = []

    async def fails(periods: int, message: str) -> None:
        kept = Large()
        left.append(weakref.ref(kept))
        for _ in range(periods):
            await next_period()
        raise ValueError(message, type(kept))

    async def fails_at_its_end() -> None:
        kept = Large()
        left.append(weakref.ref(kept))
        try:
            await wait(10)
        finally:
            raise ValueError(type(kept))

    async def again_and_again() -> None:
        lock = Lock()
        for _ in range(9):
            for run in (
                lambda: first(fails(1, "one"), fails_at_its_end(), fails_at_its_end()),
                lambda: first(wait("1 ms"), fails_at_its_end(), fails_at_its_end()),
                lambda: together(fails(1, "one"), fails_at_its_end(), fails_at_its_end()),
                lambda: together(fails(1, "one"), together(fails_at_its_end(), fails_at_its_end())),
                lambda: unless(lambda: False, first(fails(1, "one"), fails_at_its_end())),
                lambda: unless(lambda: len(left) % 2 == 0, fails_at_its_end()),
            ):
                with contextlib.suppress(ValueError):
                    await run()
                with contextlib.suppress(ValueError, TimeExpired):
                    async with timeout("1 ms"):
                        await run()
            with contextlib.suppress(TaskFailed, ValueError):
                async with lock:
                    await together(fails_at_its_end(), locked(lock))

    async def locked(lock: Lock) -> None:
        async with lock:
            pass

    gc.collect()
    gc.disable()
    try:
        with Cycle() as cycle:
            task = cycle.start(again_and_again())
            cycle.steps(200)
            assert task.done
            assert len(left) > 200
            assert sum(each() is not None for each in left) == 0
    finally:
        gc.enable()


# Random trees ----------------------------------------------------------------------------------------


class Broken(Exception):
    """What the sequences of a random tree raise."""


class Watched:
    """What the leaves of random trees did."""

    def __init__(self) -> None:
        self.lock = Lock()
        self.began: list[str] = []
        self.ended: list[str] = []
        self.inside: list[str] = []
        self.period = 0


LEAVES = st.tuples(st.just("leaf"), st.integers(0, 4), st.sampled_from(["returns", "fails", "fails when cancelled"]))
TREES = st.recursive(
    LEAVES,
    lambda below: st.one_of(
        st.tuples(st.just("together"), st.lists(below, max_size=3)),
        st.tuples(st.just("first"), st.lists(below, min_size=1, max_size=3)),
        st.tuples(st.just("unless"), st.integers(0, 8), below),
        st.tuples(st.just("lock"), below),
        st.tuples(st.just("timeout"), st.integers(1, 8), below),
        st.tuples(st.just("handles"), below),
    ),
    max_leaves=8,
)


def grown(tree: Any, watched: Watched, name: str) -> Any:
    """The sequence of a tree."""
    kind, *rest = tree
    if kind == "leaf":
        return leaf(watched, name, *rest)
    if kind in ("together", "first"):
        parts = [grown(each, watched, f"{name}.{n}") for n, each in enumerate(rest[0])]
        return (together if kind == "together" else first)(*parts)
    below = partial(grown, rest[-1], watched, f"{name}.0")
    if kind == "unless":
        return unless(lambda: watched.period >= rest[0], below())
    return {"lock": within_lock, "timeout": within_limit, "handles": handling}[kind](below, watched, name, rest[0])


async def leaf(watched: Watched, name: str, periods: int, end: str) -> None:
    watched.began.append(name)
    try:
        for _ in range(periods):
            await next_period()
        if end == "fails":
            raise Broken(name)
    except Cancelled:
        if end == "fails when cancelled":
            raise Broken(name) from None
        raise
    finally:
        watched.ended.append(name)


async def within_lock(below: Any, watched: Watched, name: str, _: Any) -> None:
    async with watched.lock:
        watched.inside.append(name)
        assert watched.inside == [name]
        try:
            await below()
        finally:
            watched.inside.remove(name)


async def within_limit(below: Any, watched: Watched, name: str, periods: int) -> None:
    async with timeout(periods * 0.001):
        await below()


async def handling(below: Any, watched: Watched, name: str, _: Any) -> None:
    with contextlib.suppress(Broken, TaskFailed):
        await below()


@settings(deadline=None)
@given(st.lists(st.tuples(TREES, st.none() | st.integers(0, 10)), min_size=1, max_size=4))
def test_every_sequence_that_began_ends_once_and_a_lock_is_held_by_one(roots: list[tuple[Any, int | None]]) -> None:
    """Roots are cancelled in the periods given, while parts of them fail, expire and wait for one lock."""
    watched = Watched()
    with Cycle() as cycle:
        tasks = [cycle.start(grown(tree, watched, str(number))) for number, (tree, _) in enumerate(roots)]
        while not all(task.done for task in tasks):
            assert watched.period < 200, "a sequence waits for ever"
            for task, (_, cancelled_in) in zip(tasks, roots, strict=True):
                if cancelled_in == watched.period:
                    with contextlib.suppress(Broken, TaskFailed):
                        task.cancel()
            with contextlib.suppress(Broken, TaskFailed):
                cycle.steps(1)
            assert watched.lock.locked or not watched.inside
            watched.period += 1
    assert sorted(watched.began) == sorted(set(watched.began)) == sorted(watched.ended)
    assert (watched.inside, watched.lock.locked, watched.lock.holder) == ([], False, None)


def test_a_condition_and_a_wait_are_common_parts_of_first():
    with Cycle() as cycle:
        m = cycle.m
        task = cycle.start(first(until(lambda: m.now > 0.0025), wait("5 ms")))
        cycle.steps(6)
        assert task.result == (0, None)


# A started sequence that is given to them -------------------------------------------------------------


async def at_once():
    return 1


async def failing_at_once():
    raise TaskFailed("at once")


@pytest.mark.parametrize(
    "given_to",
    [
        lambda task: unless(lambda: True, task),
        lambda task: first(at_once(), task),
        lambda task: together(failing_at_once(), task),
        lambda task: first(at_once(), together(at_once(), unless(lambda: False, task))),
    ],
)
def test_a_started_sequence_is_cancelled_with_what_it_is_given_to_also_if_that_ends_in_its_first_step(given_to):
    log: list[str] = []

    async def main(task):
        with contextlib.suppress(TaskFailed):
            await given_to(task)

    with Cycle() as cycle:
        task = cycle.start(after(9, "a", log))
        cycle.steps(2)
        cycle.start(main(task))
        cycle.steps(1)
        assert (task.done, log) == (True, ["cancelled a", "left a"])


def test_a_started_sequence_goes_on_if_a_function_that_has_it_as_an_argument_never_began():
    async def watching(task):
        await task

    with Cycle() as cycle:
        task = cycle.start(after(9, log=[]))
        cycle.steps(1)
        cycle.start(unless(lambda: True, watching(task)))
        cycle.steps(3)
        assert not task.done


def test_an_error_in_the_clean_up_of_a_started_sequence_that_was_not_awaited_yet_is_raised():
    log: list[str] = []
    with Cycle() as cycle:
        task = cycle.start(stubborn(log, "a"))
        cycle.steps(1)
        cycle.start(unless(lambda: True, together(task, after(3, "b", log))))
        with pytest.raises(RuntimeError, match="cleaning up a"):
            cycle.steps(1)
        assert log == ["a"]
