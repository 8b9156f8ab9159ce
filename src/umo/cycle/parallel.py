"""Functions that run sequences in parallel within another sequence: until all have ended, until the first has ended, or
until a condition is true."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple, cast

from umo.cycle.not_awaited import expects_errors
from umo.cycle.sequence_mistakes import check_condition
from umo.cycle.sequences import Routine, Task, adopting, cancel_all, one_period, own_task, with_notes
from umo.cycle.wait_graph import ParallelParts
from umo.errors import Cancelled
from umo.objects import link


class First(NamedTuple):
    """The sequence of `first` that ended first."""

    number: int
    """The index of the result among the given sequences, from 0."""
    result: Any


@adopting
async def together(*sequences: Routine | link.Task) -> tuple[Any, ...]:
    """Run sequences in parallel and return their results. The first error cancels the other sequences and is raised.
    One of the sequences may be a task that `cycle.start` has returned; it is cancelled like the others."""
    own = await own_task("together()")
    tasks = [_task(each, own) for each in sequences]
    running, tick = tasks, None
    own.waits_for = ParallelParts(tasks, any)
    try:
        while running := [task for task in running if not task.advance(tick)]:
            tick = await one_period()
    except BaseException as failure:
        _cancel_after(failure, tasks)
        raise
    finally:
        own.waits_for = None
    return tuple(task.result for task in tasks)


@adopting
async def first(*sequences: Routine | link.Task) -> First:
    """Run sequences in parallel until the first ends; the others are cancelled. Returns the index of the sequence that
    has ended, and its result: `number, result = await first(fill(), wait("5 s"))`.

    If two sequences would end in the same period, the one that comes first in the arguments is returned, and the other
    one is cancelled before its last step. The first error cancels the other sequences and is raised. An error that
    occurs while the others are cancelled is raised, too. Raises TypeError without a sequence.
    """
    if not sequences:
        raise TypeError("first() needs at least one sequence")
    own = await own_task("first()")
    tasks, tick = [_task(each, own) for each in sequences], None
    own.waits_for = ParallelParts(tasks, all)
    try:
        while (ended := next((n for n, task in enumerate(tasks) if task.advance(tick)), None)) is None:
            tick = await one_period()
    except BaseException as failure:
        _cancel_after(failure, tasks)
        raise
    finally:
        own.waits_for = None
    if errors := cancel_all(tasks):
        raise with_notes(errors.pop(0), errors)
    return First(ended, tasks[ended].result)


@expects_errors
@adopting
async def unless(condition: Callable[[], bool], sequence: Routine | link.Task) -> bool:
    """Run a sequence until it ends, or until the condition is true; then the sequence is cancelled. Returns whether the
    sequence ended by itself.

    The condition is evaluated immediately, so that the sequence does not begin if the condition is true, and then once
    per period before the sequence's step. An error in the condition cancels the sequence and is raised.
    """
    own = await own_task("unless()")
    task, tick = _task(sequence, own), None
    own.waits_for = ParallelParts([task], _never)
    try:
        check_condition("unless", condition)
        while not condition():
            if task.advance(tick):
                return True
            tick = await one_period()
    except BaseException as failure:
        _cancel_after(failure, [task])
        raise
    finally:
        own.waits_for = None
    task.cancel()
    return False


def _never(stuck: Iterable[bool]) -> bool:
    """Return False: the condition may become true whatever happens to the sequence."""
    return False


def _task(sequence: Routine | link.Task, own: Task) -> Task:
    return Task(_ended(sequence) if isinstance(sequence, Task) else cast(Routine, sequence), parent=own)


@adopting
async def _ended(task: Task) -> Any:
    """Await a started sequence, as a sequence of its own."""
    return await task


def _cancel_after(failure: BaseException, tasks: list[Task]) -> None:
    """Cancel the sequences after an error. The errors of their clean-ups are added to this error as notes. If the error
    is only a cancellation, the first error of a clean-up is raised instead."""
    errors = cancel_all(tasks)
    if errors and isinstance(failure, Cancelled | GeneratorExit):
        raise with_notes(errors.pop(0), errors) from None
    with_notes(failure, errors)
