"""Sequences that wait for each other: a wait that cannot end is told when it begins, and no other is."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.cycling import Cycle
from helpers.tiers import first as first_cases
from umo import Compound, TaskFailed
from umo.control import Lock, first, next_period, timeout, together, unless, wait
from umo.cycle import wait_graph
from umo.errors import TimeExpired

ITSELF = "it would wait for itself"


async def uses(*locks: Lock) -> None:
    """Has them all for a period."""
    async with contextlib.AsyncExitStack() as stack:
        for lock in locks:
            await stack.enter_async_context(lock)
            await next_period()


def told(*sequences: Any, periods: int = 30) -> list[str]:
    """Run these beside each other; the errors that come out."""
    errors = []
    with Cycle() as cycle:
        tasks = [cycle.start(each) for each in sequences]
        for _ in range(periods):
            try:
                cycle.steps(1)
            except TaskFailed as error:
                errors.append(str(error))
        assert all(task.done for task in tasks), "a sequence waits for ever"
    return errors


@pytest.mark.parametrize(
    "around",
    [
        lambda task: task,
        lambda task: together(task, wait("1 ms")),
        lambda task: first(task, wait("1 s")),
        lambda task: unless(lambda: False, task),
        lambda task: together(first(unless(lambda: False, task))),
    ],
    ids=["await", "together", "first", "unless", "nested"],
)
@pytest.mark.parametrize("limited", [False, True])
def test_a_started_sequence_that_the_holder_awaits_does_not_wait_for_its_lock(around, limited):
    """Only a sequence that waited for itself was told so; this one waited until the time limit, or for ever."""
    lock = Lock()

    async def app(cycle):
        async with lock:
            task = cycle.start(uses(lock))
            async with timeout("10 s") if limited else contextlib.nullcontext():
                await around(task)

    with Cycle() as cycle:
        cycle.start(app(cycle))
        with pytest.raises(TaskFailed, match=rf"uses waits for a Lock that .*app has: {ITSELF} \(.*uses\)"):
            cycle.steps(5)
        assert not lock.locked


def test_two_locks_in_two_orders_are_told_with_the_circle():
    a, b = Lock(), Lock()
    (error,) = told(uses(a, b), uses(b, a))
    one, two = (f"sequence uses (started as no. {number})" for number in (1, 2))
    assert error == (
        f"{two} waits for a Lock that {one} has: it would wait for itself ({one} waits for a Lock that {two} has)"
    )


class Zone(Compound):
    pass


class Plant(Compound):
    zones: list[Zone]


async def carry(zone: Zone, own: Lock, others: Lock, *, speed: float, note: str = "slow") -> None:
    async with own:
        await next_period()
        async with others:
            pass


def test_sequences_of_one_function_are_told_apart_by_what_they_were_called_with():
    """Each claim of the message is true of one of them alone: `uses has, uses has` names nobody."""
    plant, a, b = Plant(zones=[Zone(), Zone()]), Lock(), Lock()

    first_one, other = plant.zones
    (error,) = told(carry(first_one, a, b, speed=1.5), carry(other, b, a, speed=1.5))
    details = "zone=zones.{}, speed=1.5, note='slow', started as no. {}"
    one, two = (f"sequence carry ({details.format(n, n + 1)})" for n in (0, 1))
    has = "waits for a Lock that"
    assert error in (f"{x} {has} {y} has: {ITSELF} ({y} {has} {x} has)" for x, y in ((one, two), (two, one)))


@pytest.mark.parametrize("nested", [False, True])
def test_parts_of_one_function_have_their_number(nested):
    a, b = Lock(), Lock()

    async def app():
        await together(uses(a, b), together(uses(b, a)) if nested else uses(b, a))

    (error,) = told(app())
    names = set(re.findall(r"sequence uses \([^)]*\)", error))
    assert len(names) == 2
    assert "sequence uses " not in re.sub(r"sequence uses \([^)]*\)", "", error)


def test_locks_in_a_ring_are_told_once_and_the_others_go_on():
    locks = [Lock() for _ in range(9)]
    assert len(told(*(uses(locks[n], locks[(n + 1) % 9]) for n in range(9)), periods=60)) == 1


def test_one_that_gives_up_by_itself_closes_no_circle():
    """`impatient` has `a` and waits for `b` with a time limit: `patient` has `b`, and gets `a` afterwards."""
    for run in (
        lambda lock: limited(lock),
        lambda lock: first(uses(lock), wait("3 ms")),
        lambda lock: unless(iter([False, False, False, True]).__next__, uses(lock)),
    ):
        a, b = Lock(), Lock()

        async def impatient(a=a, b=b, run=run):
            async with a:
                await next_period()
                await run(b)

        async def patient(a=a, b=b):
            async with b:
                await wait("3 ms")
                async with a:
                    pass

        assert told(impatient(), patient()) == []


async def limited(lock: Lock) -> None:
    with contextlib.suppress(TimeExpired):
        async with timeout("5 ms"), lock:
            pass


def test_a_lock_or_a_sequence_of_another_machine_is_refused():
    """What it waits for would advance in another thread, or not while this machine takes a step."""
    lock, tasks = Lock(), []

    async def has():
        async with lock:
            await wait("1 s")

    async def awaits():
        await tasks[0]

    with Cycle() as one, Cycle() as other:
        tasks.append(one.start(has()))
        one.steps(1)
        other.start(uses(lock))
        with pytest.raises(TaskFailed, match=r"waits for a Lock that .*has of another machine has"):
            other.steps(1)
        other.start(awaits())
        with pytest.raises(TaskFailed, match=r"awaits cannot await .*has, which another machine has started"):
            other.steps(1)


# Programs at random ------------------------------------------------------------------------------------

LOCKS, TASKS = 2, 3
PERIODS = 600
"""More than any program takes: each of its parts takes a few periods."""
WAITS = st.tuples(st.just("wait"), st.integers(0, 3))
AWAITS = st.tuples(st.just("await"), st.integers(0, TASKS - 1))


def statements(depth: int) -> Any:
    """Most of them are locks, in most of which another one is taken: else few programs have a circle."""
    if not depth:
        return WAITS | AWAITS
    below = statements(depth - 1)
    bodies, few = st.lists(below, min_size=1, max_size=2), st.integers(1, 9)
    locks = st.tuples(st.just("lock"), st.integers(0, LOCKS - 1), bodies)
    parts = st.lists(bodies, min_size=1, max_size=2)
    ways_out = st.one_of(
        st.tuples(st.just("first"), parts),
        st.tuples(st.just("unless"), few, bodies),
        st.tuples(st.just("timeout"), few, bodies),
    )
    return st.one_of(locks, locks, locks, ways_out, ways_out, st.tuples(st.just("together"), parts), below)


def crossing(one: int, pause: int, way: str, periods: int, then: int, around: bool) -> list[Any]:
    """A sequence that has a lock, and takes the other one, or awaits a sequence, in a way that it may give up: the
    second wait alone, or both."""

    def within(body: list[Any]) -> list[Any]:
        if way == "plain":
            return body
        return [(way, [body, [("wait", periods)]]) if way in ("first", "together") else (way, periods, body)]

    inner = [("lock", 1 - one, [("wait", then)]) if then < 3 else ("await", pause)]
    both = [("lock", one, [("wait", pause), *(inner if around else within(inner))])]
    return within(both) if around else both


CROSSINGS = st.lists(
    st.builds(
        crossing,
        st.integers(0, LOCKS - 1),
        st.integers(0, 2),
        st.sampled_from(["plain", "plain", "first", "together", "unless", "timeout"]),
        st.integers(1, 9),
        st.integers(0, 3),
        st.booleans(),
    ),
    min_size=2,
    max_size=TASKS,
)
PROGRAMS = CROSSINGS | st.lists(st.lists(statements(4), min_size=1, max_size=2), min_size=2, max_size=TASKS)


class Run:
    """A program that runs: each sequence of it is a list of statements."""

    def __init__(self, program: Any) -> None:
        self.locks = [Lock() for _ in range(LOCKS)]
        self.period = 0
        self.refused: list[str] = []
        """The places of the waits that were refused, in their order."""
        self.met: set[str] = set()
        """The places of the waits that came to their end."""
        with Cycle() as cycle:
            self.tasks = [cycle.start(self._root(body, str(n))) for n, body in enumerate(program)]
            while self.period < PERIODS and not all(task.done for task in self.tasks):
                cycle.steps(1)
                self.period += 1
            self.ended = all(task.done for task in self.tasks)

    async def _root(self, body: Any, place: str) -> None:
        with contextlib.suppress(TaskFailed):
            await self._run(body, place)

    async def _run(self, body: Any, place: str) -> None:
        for number, (kind, *rest) in enumerate(body):
            await getattr(self, f"_{kind}")(*rest, f"{place}.{number}")

    async def _wait(self, count: int, place: str) -> None:
        for _ in range(count):
            await next_period()

    async def _await(self, number: int, place: str) -> None:
        if number < len(self.tasks):
            with self._noted(place):
                await self.tasks[number]

    async def _lock(self, number: int, body: Any, place: str) -> None:
        with self._noted(place, lambda: self.locks[number]._owner):
            await self.locks[number].__aenter__()
        try:
            await next_period()
            await self._run(body, place)
        finally:
            await self.locks[number].__aexit__(None, None, None)

    async def _together(self, bodies: Any, place: str) -> None:
        await together(*self._parts(bodies, place))

    async def _first(self, bodies: Any, place: str) -> None:
        await first(*self._parts(bodies, place))

    def _parts(self, bodies: Any, place: str) -> list[Any]:
        return [self._run(body, f"{place}.{number}") for number, body in enumerate(bodies)]

    async def _unless(self, periods: int, body: Any, place: str) -> None:
        end = self.period + periods
        await unless(lambda: self.period >= end, self._run(body, place))

    async def _timeout(self, periods: int, body: Any, place: str) -> None:
        with contextlib.suppress(TimeExpired):
            async with timeout(periods * 0.001):
                await self._run(body, place)

    @contextlib.contextmanager
    def _noted(self, place: str, _: Callable[[], object] = lambda: None) -> Any:
        """Note what becomes of a wait. The error of a sequence that was awaited is an end of it as well."""
        try:
            yield
        except TaskFailed as error:
            if ITSELF in str(error) and not str(error).startswith(("sequence Run._root failed",)):
                self.refused.append(place)
            else:
                self._note(place)
            raise
        self._note(place)

    def _note(self, place: str) -> None:
        """Not once a started sequence was cancelled, by the end of one that awaits it: that frees whoever waits for it,
        and nobody could know of it when the wait began."""
        if not any(task._cancelled for task in self.tasks):  # type: ignore[attr-defined]
            self.met.add(place)


@pytest.mark.parametrize("programs", first_cases(1, [50, 1000]))
def test_a_program_ends_or_its_circle_is_told_and_what_is_told_is_one(programs: int) -> None:
    """The same program without this check is the model: the first wait that is refused never comes to its end there.
    (Until then both do the same.) A program in which none is refused ends."""
    found = {"circles": 0}

    @settings(deadline=None, max_examples=programs)
    @given(PROGRAMS)
    def tried(program: Any) -> None:
        checked = Run(program)
        assert checked.ended, "a sequence waits for ever"
        if checked.refused:
            found["circles"] += 1
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(wait_graph, "circle", lambda waiting, target, wait: ITSELF if target is waiting else None)
                model = Run(program)
            assert checked.refused[0] not in model.met

    tried()
    assert found["circles"]
