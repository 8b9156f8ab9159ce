"""Sequences: application code as `async def` functions that the cycle itself advances, one step a period.

There is no asyncio loop: `coroutine.send` once per period, before the root's `control`. What a sequence may
await is here, and the motions built on it; anything else is a TypeError.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Awaitable, Callable, Coroutine, Generator
from types import coroutine
from typing import Any, Protocol

from umo.errors import Cancelled, TaskFailed, TimeExpired
from umo.objects.units import seconds as in_seconds
from umo.text import cause_of, place_of


class Tick(Protocol):
    """What each period tells the sequences."""

    @property
    def period(self) -> float: ...
    @property
    def ticks(self) -> int: ...


Sequence = Coroutine[Any, Any, Any]


_PERIOD = object()
"""The only object that a sequence may yield to the cycle; anything else, even None, is an error."""


@coroutine
def next_period() -> Generator[object, Tick, Tick]:
    """Wait for the next period. Returns its tick: `period` in s and `ticks` consumed (1, or more after a miss)."""
    return (yield _PERIOD)


async def wait(duration: str | float) -> None:
    """Wait for a time in s (or "20 ms"), rounded up to whole periods. Missed periods count."""
    await _pass(in_seconds(duration))


async def until(condition: Callable[[], bool], timeout: str | float | None = None) -> None:
    """Wait until the condition is true. It is evaluated at once, then once per period. TimeExpired after `timeout`
    (s, or a text such as "20 ms"; default: no timeout)."""
    if condition():
        return
    limit = math.inf if timeout is None else in_seconds(timeout)
    if not await _pass(limit, condition):
        name = getattr(condition, "__name__", "condition").replace("<lambda>", "the condition")
        raise TimeExpired(f"{name} did not come true within {limit:g} s")


@coroutine
def _pass(limit: float, condition: Callable[[], bool] | None = None) -> Generator[object, Tick, bool]:
    """Let periods pass until the condition is true (True) or the limit in s is over (False)."""
    if limit <= 0:
        return False
    passed = whole_periods = 0.0
    while True:
        tick = yield _PERIOD
        passed += tick.ticks
        if condition is not None and condition():
            return True
        whole_periods = whole_periods or _whole_periods(limit, tick.period)  # known with the first tick
        if passed >= whole_periods:
            return False


def _whole_periods(limit: float, period: float) -> float:
    if math.isinf(limit):
        return limit
    if not period:
        raise TaskFailed("a machine without a timer cannot wait for a time: it has no sampling period")
    return math.ceil(limit / period - 1e-9)


class _Together:
    def __init__(self, sequences: tuple[Sequence, ...]) -> None:
        self._tasks = [Task(sequence) for sequence in sequences]

    def __await__(self) -> Generator[object, Tick, tuple[Any, ...]]:
        running, tick = self._tasks, None
        try:
            while True:
                running = [task for task in running if not task.advance(tick)]
                if not running:
                    return tuple(task.result for task in self._tasks)
                tick = yield _PERIOD
        except BaseException as failure:
            errors = _cancel_all(self._tasks)
            if errors and isinstance(failure, Cancelled | GeneratorExit):
                raise _with_notes(errors[0], errors[1:]) from None
            _with_notes(failure, errors)
            raise


def together(*sequences: Sequence) -> Awaitable[tuple[Any, ...]]:
    """Run sequences in parallel and return their results. The first error cancels the others and is raised."""
    return _Together(sequences)


class Task:
    """A started sequence."""

    def __init__(self, sequence: Sequence) -> None:
        if not isinstance(sequence, Coroutine):
            raise TypeError(f"{sequence!r} is not a sequence; call an `async def` function")
        self._sequence = sequence
        self._begun = False
        self._cancelling = False
        self.done = False
        self.result: Any = None

    def advance(self, tick: Tick | None) -> bool:
        """One step; whether that was the last. The first needs no tick. What the sequence raises comes out here."""
        if self.done:
            return True
        if not self._begun:
            self._begin()
            tick = None
        try:
            awaited = self._sequence.send(tick)
        except StopIteration as end:
            self.done, self.result = True, end.value
            return True
        except BaseException as error:
            self.done = True
            self._refuse_exit(error)
            raise
        if awaited is not _PERIOD:
            wrong = TypeError(f"a sequence awaited {awaited!r}; a sequence can await only the functions of umo.control")
            raise _with_notes(wrong, _cancel_all([self]))
        if self._cancelling:
            self.cancel()
        return self.done

    def cancel(self) -> None:
        """Raise Cancelled inside the sequence. It may clean up but must not continue. A sequence that cancels
        itself gets Cancelled at its next await."""
        if self.done:
            return
        if getattr(self._sequence, "cr_running", False):
            self._cancelling = True
            return
        self.done = True
        try:
            self._sequence.throw(Cancelled())
            self._sequence.close()  # it awaited again: GeneratorExit ends it
        except (Cancelled, StopIteration):
            return
        except BaseException as error:
            self._refuse_exit(error)
            raise

    def _begin(self) -> None:
        self._begun = True
        if inspect.iscoroutine(self._sequence) and inspect.getcoroutinestate(self._sequence) != inspect.CORO_CREATED:
            self.done = True
            raise TypeError(f"{self._name} was started twice; call the `async def` function again for each start")

    def _refuse_exit(self, error: BaseException) -> None:
        """These two would end the whole run without a word, `sys.exit(0)` even as if all were well."""
        if isinstance(error, SystemExit | GeneratorExit):
            what = f"{self._name} raised {cause_of(error)}{place_of(error)}"
            raise TaskFailed(f"{what}; a sequence must end by returning or with an error") from error

    @property
    def _name(self) -> str:
        return f"sequence {getattr(self._sequence, '__qualname__', self._sequence)}"


def _cancel_all(tasks: list[Task]) -> list[BaseException]:
    """The last started first; an error in the cleaning up of one does not spare the others."""
    errors: list[BaseException] = []
    for task in reversed(tasks):
        try:
            task.cancel()
        except BaseException as error:  # whatever it is, the outputs are still to be reset
            errors.append(error)
    return errors


def _with_notes(error: BaseException, others: list[BaseException]) -> BaseException:
    for other in others:
        error.add_note(f"also, while another sequence was cancelled: {other!r}")
    return error


class Sequences:
    """All sequences that run side by side on one machine."""

    def __init__(self) -> None:
        self._tasks: list[Task] = []
        self._advancing = False

    def start(self, sequence: Sequence) -> Task:
        task = Task(sequence)
        self._tasks.append(task)
        return task

    def advance(self, tick: Tick) -> None:
        """One step of each, in the order started; the first error cancels nothing else and is raised."""
        if not self._tasks:
            return
        if self._advancing:
            raise TaskFailed("a sequence called `control` of the root; only the cycle may call it, once per period")
        self._advancing = True
        try:
            for task in self._tasks.copy():  # what they start begins with the next period
                if task.advance(tick):
                    self._tasks.remove(task)
        finally:
            self._advancing = False

    def cancel(self) -> None:
        """On stop: cancel each sequence, the last started first. Then the first error of their cleanup is raised; the
        others are added to it as notes."""
        errors: list[BaseException] = []
        while self._tasks:  # cleaning up may start more
            tasks, self._tasks = self._tasks, []
            errors += _cancel_all(tasks)
        if errors:
            raise _with_notes(errors[0], errors[1:])
