"""Sequences: application code as `async def` functions that the cycle itself advances, one step a period.

There is no asyncio loop: `coroutine.send` once per period, before the root's `control`. What a sequence may
await is here, and the motions built on it; anything else is a TypeError.
"""

from __future__ import annotations

import math
from collections.abc import Awaitable, Callable, Coroutine, Generator
from typing import Any, Protocol

from umo.errors import Cancelled, TaskFailed, TimeExpired
from umo.objects.units import seconds as in_seconds


class Tick(Protocol):
    """What each period tells the sequences."""

    @property
    def period(self) -> float: ...
    @property
    def ticks(self) -> int: ...


Sequence = Coroutine[Any, Any, Any]


_PERIOD = object()
"""What a sequence hands to the cycle when it waits; anything else, even None, is not from here."""


class _NextPeriod:
    def __await__(self) -> Generator[object, Tick, Tick]:
        return (yield _PERIOD)


def next_period() -> Awaitable[Tick]:
    """Until the next period; returns its tick: `period` in s and `ticks` consumed (1, or more after a miss)."""
    return _NextPeriod()


async def wait(duration: str | float) -> None:
    """A time in s (or "20 ms"), rounded up to whole periods; missed periods count."""
    await _pass(lambda: False, in_seconds(duration))


async def until(condition: Callable[[], bool], timeout: str | float | None = None) -> None:
    """Until the condition, asked once per period and at once, is true; TimeExpired after `timeout` (s or text)."""
    if condition():
        return
    limit = math.inf if timeout is None else in_seconds(timeout)
    if not await _pass(condition, limit):
        name = getattr(condition, "__name__", "condition").replace("<lambda>", "the condition")
        raise TimeExpired(f"{name} did not come true within {limit:g} s")


async def _pass(condition: Callable[[], bool], limit: float) -> bool:
    """Let periods pass until the condition is true (True) or the limit in s is over (False)."""
    passed = 0
    whole_periods = math.inf if limit > 0 else 0  # known with the first tick
    while passed < whole_periods:
        tick = await _NextPeriod()
        passed += tick.ticks
        if condition():
            return True
        if math.isfinite(limit):
            if not tick.period:
                raise TaskFailed("a machine without a timer has no periods to count seconds in")
            whole_periods = math.ceil(limit / tick.period - 1e-9)
    return False


class _Together:
    def __init__(self, sequences: tuple[Sequence, ...]) -> None:
        self._tasks = [Task(sequence) for sequence in sequences]

    def __await__(self) -> Generator[object, Tick, tuple[Any, ...]]:
        try:
            tick: Tick | None = None
            while True:
                for task in self._tasks:
                    task.advance(tick)
                if all(task.done for task in self._tasks):
                    return tuple(task.result for task in self._tasks)
                tick = yield _PERIOD
        except BaseException as failure:
            errors = _cancel_all(self._tasks)
            if errors and isinstance(failure, Cancelled | GeneratorExit):
                raise errors[0] from None
            for error in errors:
                failure.add_note(f"and while a sequence beside it was cancelled: {error!r}")
            raise


def together(*sequences: Sequence) -> Awaitable[tuple[Any, ...]]:
    """Run the sequences side by side; their results. The first failure cancels the rest and is raised."""
    return _Together(sequences)


class Task:
    """A sequence under way."""

    def __init__(self, sequence: Sequence) -> None:
        if not isinstance(sequence, Coroutine):
            raise TypeError(f"{sequence!r} is not a sequence; call an `async def` function")
        self._sequence = sequence
        self.done = False
        self.result: Any = None

    def advance(self, tick: Tick | None) -> None:
        """One step; the first one takes None. What the sequence raises comes out here."""
        if self.done:
            return
        try:
            awaited = self._sequence.send(tick)
        except StopIteration as end:
            self.done, self.result = True, end.value
            return
        except BaseException:
            self.done = True
            raise
        if awaited is not _PERIOD:
            self.cancel()
            raise TypeError(f"a sequence awaited {awaited!r}; only what umo.control offers can be awaited")

    def cancel(self) -> None:
        """Throw Cancelled in; the sequence may clean up, and may not go on."""
        if self.done:
            return
        self.done = True
        try:
            self._sequence.throw(Cancelled())
        except (Cancelled, StopIteration):
            return
        self._sequence.close()  # it awaited again: GeneratorExit ends it


def _cancel_all(tasks: list[Task]) -> list[BaseException]:
    """The last started first; an error in the cleaning up of one does not spare the others."""
    errors: list[BaseException] = []
    for task in reversed(tasks):
        try:
            task.cancel()
        except BaseException as error:  # even SystemExit: the outputs are still to be reset
            errors.append(error)
    return errors


class Sequences:
    """All sequences that run side by side on one machine."""

    def __init__(self) -> None:
        self._tasks: list[tuple[Task, bool]] = []

    def start(self, sequence: Sequence) -> Task:
        task = Task(sequence)
        self._tasks.append((task, True))
        return task

    def advance(self, tick: Tick) -> None:
        """One step of each, in the order started; the first error cancels nothing else and is raised."""
        if not self._tasks:
            return
        tasks, self._tasks = self._tasks, []
        try:
            while tasks:
                task, fresh = tasks.pop(0)
                task.advance(None if fresh else tick)
                if not task.done:
                    self._tasks.append((task, False))
        finally:
            self._tasks.extend(tasks)

    def cancel(self) -> None:
        """On stop: Cancelled into each, the last started first; the first error is raised after all."""
        errors: list[BaseException] = []
        while self._tasks:  # cleaning up may start more
            tasks, self._tasks = self._tasks, []
            errors += _cancel_all([task for task, _ in tasks])
        if errors:
            raise errors[0]
