"""A lock: equipment that several sequences share."""

from __future__ import annotations

import contextlib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.cycling import Cycle, by_hand
from helpers.machines import Bench, bench, wired
from umo import TaskFailed, connect
from umo.control import Lock, first, next_period, timeout, together, unless, wait
from umo.errors import TimeExpired
from umo.testing import Scripted, VirtualTimer, periods


async def uses(lock: Lock, count: int, log: list[str], name: str, error: Exception | None = None) -> None:
    async with lock:
        log.append(f"{name} has it")
        for _ in range(count):
            await next_period()
        if error is not None:
            raise error
    log.append(f"{name} gave it back")


def test_one_after_the_other_has_it_first_come_first_served():
    lock, log = Lock(), list[str]()
    with Cycle() as cycle:
        for name in "abc":
            cycle.start(uses(lock, 2, log, name))
        cycle.steps(2)
        assert (log, lock.locked, lock.holder) == (["a has it"], True, "sequence uses")
        cycle.start(uses(lock, 0, log, "d"))
        cycle.steps(8)
    assert log == [f"{name} {what}" for name in "abcd" for what in ("has it", "gave it back")]
    assert (lock.locked, lock.holder) == (False, None)


def test_one_that_comes_when_it_is_given_back_does_not_overtake_one_that_waits():
    """`a` asks again in the period, and at the place, where it gives the lock back."""
    lock, log = Lock(), list[str]()

    async def twice():
        await uses(lock, 1, log, "a")
        await uses(lock, 1, log, "a")

    with Cycle() as cycle:
        cycle.start(twice())
        cycle.start(uses(lock, 1, log, "b"))
        cycle.steps(6)
    assert [line for line in log if line.endswith("has it")] == ["a has it", "b has it", "a has it"]


@pytest.mark.parametrize("within", [False, True])
def test_one_that_is_paused_while_it_waits_keeps_no_other_from_it_and_keeps_its_place(within):
    lock, log = Lock(), list[str]()
    with Cycle() as cycle:
        cycle.start(uses(lock, 1, log, "a"))
        waits = uses(lock, 1, log, "b")
        held = cycle.start(together(waits) if within else waits)
        cycle.steps(1)
        held.paused = True
        cycle.steps(3)
        assert not lock.locked
        cycle.start(uses(lock, 2, log, "c"))
        cycle.start(uses(lock, 1, log, "d"))
        cycle.steps(1)
        held.paused = False
        cycle.steps(10)
    assert [line[0] for line in log if line.endswith("has it")] == ["a", "c", "b", "d"]
    assert not lock.locked


def test_one_that_was_paused_has_a_free_lock_when_it_goes_on():
    lock, log = Lock(), list[str]()
    with Cycle() as cycle:
        cycle.start(uses(lock, 1, log, "a"))
        held = cycle.start(uses(lock, 1, log, "b"))
        cycle.steps(1)
        held.paused = True
        cycle.steps(5)
        held.paused = False
        cycle.steps(4)
    assert log[-1] == "b gave it back"


def test_an_error_in_the_block_gives_it_back():
    lock, log = Lock(), list[str]()
    with Cycle() as cycle:
        cycle.start(uses(lock, 1, log, "a", ValueError("broken")))
        cycle.start(uses(lock, 0, log, "b"))
        cycle.steps(1)
        with pytest.raises(ValueError, match="broken"):
            cycle.steps(1)
        assert lock.locked
        cycle.steps(1)
    assert log == ["a has it", "b has it", "b gave it back"]


@pytest.mark.parametrize("who", [0, 1, 2])
def test_one_that_is_cancelled_gives_it_back_or_leaves_the_queue(who):
    lock, log = Lock(), list[str]()
    with Cycle() as cycle:
        tasks = [cycle.start(uses(lock, 1, log, name)) for name in "abc"]
        cycle.steps(1)
        tasks[who].cancel()
        cycle.steps(4)
        assert not lock.locked
    left = [name for name in "abc" if name != "abc"[who]]
    assert [line[0] for line in log if line.endswith("gave it back")] == left


def test_one_that_is_cancelled_before_it_knows_that_it_has_the_lock_passes_it_on():
    """`a` gives it back to `b`, which is cancelled before its next step."""
    lock, log = Lock(), list[str]()
    with Cycle() as cycle:
        b = cycle.start(after_a_period(uses(lock, 0, log, "b")))
        cycle.start(uses(lock, 2, log, "a"))
        cycle.start(after_a_period(uses(lock, 0, log, "c")))
        cycle.steps(3)
        assert log == ["a has it", "a gave it back"]
        assert lock.locked
        b.cancel()
        cycle.steps(1)
    assert log[2:] == ["c has it", "c gave it back"]


async def after_a_period(sequence):
    await next_period()
    await sequence


def test_a_time_limit_ends_the_waiting():
    lock, log = Lock(), list[str]()

    async def impatient():
        with contextlib.suppress(TimeExpired):
            async with timeout("2 ms"), lock:
                log.append("has it")
        log.append("went on")

    with Cycle() as cycle:
        cycle.start(uses(lock, 5, [], "a"))
        cycle.start(impatient())
        cycle.steps(9)
        assert not lock.locked
    assert log == ["went on"]


@pytest.mark.parametrize("run", [None, together, first, lambda sequence: unless(lambda: False, sequence)])
def test_to_take_a_lock_that_one_has_already_is_an_error(run):
    lock, log = Lock(), list[str]()

    async def greedy():
        async with lock:
            await (uses(lock, 1, log, "a") if run is None else run(uses(lock, 1, log, "a")))

    with Cycle() as cycle:
        cycle.start(greedy())
        with pytest.raises(TaskFailed, match=r"waits for a Lock that sequence .*greedy has: it would wait for itself"):
            cycle.steps(1)
        assert not lock.locked
    assert log == []


def test_a_lock_outside_of_a_sequence_is_an_error():
    with pytest.raises(TaskFailed, match="only in a sequence that the cycle advances"):
        by_hand(uses(Lock(), 0, [], "a"))


def test_a_lock_made_in_setup_is_free_in_the_next_connection():
    class Sharing(Bench):
        def setup(self) -> None:
            self.lock = Lock()

    m, log = bench(Sharing), list[str]()
    for _ in range(2):
        with connect(m, wired(m, Scripted(), clock=VirtualTimer())):
            assert not m.lock.locked
            for name in "ab":
                m.cycle.start(uses(m.lock, 99, log, name))
            periods(m, 3)
            assert m.lock.locked
        assert not m.lock.locked
    assert log == ["a has it", "a has it"]


@settings(deadline=None)
@given(st.lists(st.tuples(st.integers(0, 5), st.integers(0, 3), st.none() | st.integers(0, 12)), max_size=6))
def test_whoever_waits_has_it_in_the_order_of_asking(users: list[tuple[int, int, int | None]]) -> None:
    """Each asks after some periods, keeps it for some, and may be cancelled in one."""
    lock, asked, had = Lock(), list[int](), list[int]()

    async def user(number: int, after: int, count: int) -> None:
        await wait(after * 0.001)
        asked.append(number)
        async with lock:
            had.append(number)
            await wait(count * 0.001)

    with Cycle() as cycle:
        tasks = [cycle.start(user(n, after, count)) for n, (after, count, _) in enumerate(users)]
        for period in range(40):
            for task, (*_, cancelled_in) in zip(tasks, users, strict=True):
                if period == cancelled_in:
                    task.cancel()
            cycle.steps(1)
        assert all(task.done for task in tasks)
    assert had == [number for number in asked if number in had]
    assert {n for n, (*_, cancelled_in) in enumerate(users) if cancelled_in is None} <= set(had)
