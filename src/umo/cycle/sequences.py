"""Sequences: application code as `async def` functions that the cycle itself advances, one step per period.

There is no asyncio loop: the cycle calls `coroutine.send` once per period, before the root's `control`. A sequence may
await the functions of this module, of `parallel` and of `lock`, and the motions built on them; anything else is a
TypeError.
"""

from __future__ import annotations

import inspect
import linecache
import math
import sys
from collections.abc import Callable, Collection, Coroutine, Generator, Iterable
from functools import partial
from operator import attrgetter
from types import CodeType, FrameType, coroutine
from typing import TYPE_CHECKING, Any, Protocol, TypeVar, cast

from umo.cycle import wait_graph
from umo.cycle.clock import Clock
from umo.cycle.coroutines import arguments_text, code_of, frames_of, is_new, place_of
from umo.cycle.not_awaited import advances, expects_errors
from umo.cycle.sequence_mistakes import AWAITABLE_HINT, check_condition, instead_of_sequence, meant_await
from umo.cycle.wait_graph import Waiter
from umo.cycle.writes import CalledAction, Turn, make_turn
from umo.duration import seconds as in_seconds
from umo.errors import Cancelled, TaskFailed, TimeExpired, forget_frames, text_later, text_of
from umo.objects import Node
from umo.text import add_note, in_brackets, shown_path
from umo.user_code import refuse_exit

Routine = Coroutine[Any, Any, Any]


class Containing(Protocol):
    """An object that handles sequences that have failed (`umo.cycle.equipment.Containment`)."""

    def contain_sequence(self, task: Task, error: BaseException) -> bool:
        """Handle the failure of a sequence. Return True if the machine continues."""

    def is_in_fault(self, node: Node | None) -> bool:
        """Return True if this part of the machine is in fault, so that nothing in it continues."""

    def gather(self) -> None:
        """Collect failures from now on, to settle them together."""

    def settle(self) -> None:
        """Bring the outputs of failed equipment to their defaults, and end its work."""


class _Uncontained:
    """Containment for sequences without a machine: it contains no failure."""

    def contain_sequence(self, task: Task, error: BaseException) -> bool:
        return False

    def is_in_fault(self, node: Node | None) -> bool:
        return False

    def gather(self) -> None:
        """Do nothing."""

    def settle(self) -> None:
        """Do nothing."""


Adopting = TypeVar("Adopting", bound=Callable[..., Any])


class _Request:
    """A request that a sequence may yield to the cycle. Any other value, including None, is an error."""

    def __init__(self, what: str) -> None:
        self._what = what

    def __repr__(self) -> str:
        return f"<{self._what}: only umo's cycle advances a sequence>"


_PERIOD = _Request("a wait for the next period")
_WHO = _Request("a question for the task")
"""A request that is answered at once with the `Task` that is being advanced."""
_ADOPTING: set[CodeType] = set()
"""The code of the `async def` functions to whose sequences a started sequence belongs. The started sequence is
cancelled together with such a sequence."""


def adopting(function: Adopting) -> Adopting:
    """Decorate an `async def` function so that a started sequence among its arguments belongs to the function's
    sequence. The started sequence is cancelled with the function's sequence, even if the latter never began."""
    _ADOPTING.add(function.__code__)
    return function


@coroutine
def _who() -> Generator[object, Any, Task | None]:
    return cast("Task | None", (yield _WHO))


async def own_task(what: str) -> Task:
    """Return the innermost task that advances the calling sequence. Raises TaskFailed if there is no such task. `what`
    is the name of the function that needs the task, for the message."""
    found = await _who()
    if found is None:
        raise TaskFailed(f"{what} can be used only in a sequence that the cycle advances")
    return found


@coroutine
def one_period() -> Generator[object, Clock, Clock]:
    """Wait for the next period like `next_period`, for sequences of umo: this function is quicker and does not report a
    forgotten `await`."""
    return (yield _PERIOD)


async def next_period() -> Clock:
    """Wait for the next period. Returns the clock: `period` in s, `ticks` consumed (1, or more after a miss)."""
    return await one_period()


async def wait(duration: str | float) -> None:
    """Wait for a time in s (or "20 ms"), rounded up to whole periods. Missed periods count."""
    await _pass(in_seconds(duration))


async def until(condition: Callable[[], bool], timeout: str | float | None = None, *, stays: str | float = 0.0) -> None:
    """Wait until the condition is true and has been true in every period for the time `stays`. The condition is
    evaluated immediately, then once per period. Raises TimeExpired after `timeout` (default: no timeout). Times are in
    s, or strings ("20 ms").
    """
    check_condition("until", condition)
    steady = in_seconds(stays)
    limit = math.inf if timeout is None else in_seconds(timeout)
    if steady > limit:
        raise ValueError(f"until(): it cannot stay true for {steady:g} s within {limit:g} s")
    if not await _pass(limit, condition, steady):
        what = f"did not stay true for {steady:g} s" if steady else "did not come true"
        raise TimeExpired(f"{_described(condition)} {what} within {limit:g} s")


@expects_errors
@coroutine
def _pass(
    limit: float, condition: Callable[[], bool] | None = None, stays: float = 0.0
) -> Generator[object, Clock, bool]:
    """Let periods pass. Return True when the condition has stayed true for the time `stays`, or False when the limit in
    s is over."""
    if condition is not None and limit == math.inf and not stays:  # no time is to be counted
        while not condition():
            yield _PERIOD
        return True
    passed, since = 0.0, math.inf  # whole periods: until now, and until the condition came true
    last, required = (math.inf if time else 0.0 for time in (limit, stays))  # known with the first tick
    while True:
        if condition is not None:
            since = min(since, passed) if condition() else math.inf
            if passed - since >= required:
                return True
        if passed >= last:
            return False
        tick = yield _PERIOD
        if not passed:
            last, required = (_whole_periods(time, tick.period) for time in (limit, stays))
        passed += tick.ticks


def _whole_periods(limit: float, period: float) -> float:
    if math.isinf(limit) or not limit:
        return limit
    if not period:
        raise TaskFailed("a machine without a timer cannot wait for a time: it has no sampling period")
    return math.ceil(limit / period - 1e-9)


def _described(condition: Callable[[], bool]) -> str:
    """Return a condition as text for a message: its name and place. For a lambda, its source line takes the place of
    the name."""
    code = getattr(condition, "__code__", None)
    if code is None:
        return repr(condition)
    source = linecache.getline(code.co_filename, code.co_firstlineno).strip()
    name = code.co_name if code.co_name != "<lambda>" else f"the condition `{source}`" if source else "the condition"
    return f"{name} ({shown_path(code.co_filename)}:{code.co_firstlineno})"


class AsyncBlock:
    """An object for `async with`."""

    if not TYPE_CHECKING:

        def __enter__(self):
            raise TypeError(f"a {type(self).__name__} is entered by `async with`, in a sequence")

        def __exit__(self, *error):
            """Do nothing: the block was not entered."""


class timeout(AsyncBlock):
    """A time limit for a block of a sequence:

        async with timeout("5 s"):
            await axis.home()
            await gripper.open()

    Raises TimeExpired if the block has not ended after this time, in s or as a string. Everything that the block awaits
    is then cancelled, even a started sequence. A block that ends in the very period in which the time is over is in
    time. Missed periods count.
    """

    def __init__(self, duration: str | float) -> None:
        self._limit = in_seconds(duration)
        caller = sys._getframe(1)
        self._place = (caller.f_code.co_filename, caller.f_lineno)
        self._task: Task | None = None
        self._passed = 0.0
        self._expiry: Cancelled | None = None
        """The error with which the block was cancelled because the time was over."""

    async def __aenter__(self) -> timeout:
        task = await own_task("timeout()")
        if self._task is not None:
            raise TaskFailed("a timeout() was used again while it was in use; create one for each block")
        self._task, self._passed, self._expiry = task, 0.0, None
        self._task.limits.append(self)
        return self

    async def __aexit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        assert self._task is not None
        self._task.limits.remove(self)
        self._task = None
        if error is not None and error is self._expiry:  # and not a stop, or an outer block, while it cleaned up
            file, line = self._place
            place = f"{shown_path(file)}:{line}"
            raise TimeExpired(f"the block did not end within {self._limit:g} s ({place})") from None

    def count(self, tick: Clock) -> None:
        """Count a period for the block."""
        self._passed += tick.ticks

    def expires(self, tick: Clock) -> Cancelled | None:
        """Return the error with which to cancel the block, if the time is over for the first time."""
        if self._expiry is not None or self._passed < _whole_periods(self._limit, tick.period):
            return None
        self._expiry = Cancelled()
        return self._expiry


class Task(Waiter):
    """A sequence that the cycle advances: a started sequence, or one that runs in parallel with others in `parent`.
    `part`: the object of the machine to which the task belongs. `contain` is called with the failure of the task, and
    returns whether the machine continues. `end_within` makes the calls that end the task when it is cancelled.
    `current`: the object that holds the current task of the machine."""

    def __init__(
        self,
        sequence: Routine,
        part: Any = None,
        contain: Callable[[Task, BaseException], bool] | None = None,
        end_within: Callable[[Callable[[], Any]], Any] | None = None,
        *,
        current: Turn | None = None,
        parent: Task | None = None,
    ) -> None:
        if not isinstance(sequence, Coroutine):
            raise TypeError(instead_of_sequence(sequence))
        super().__init__(parent)
        self.sequence = sequence
        self.part: Any = part if parent is None else parent.part
        self.number = 0
        """The index of a started sequence in the order of starting."""
        self.started_in = 0
        """The number of the period in which the task was started."""
        self._contain, self._end_within = contain, end_within
        self._current: Turn | None = current if parent is None else parent._current
        self._begun = False
        self._cancelling = self._cancelled = False
        self.done = False
        self.result: Any = None
        self.error: BaseException | None = None
        """The error that ended the task. The sequence that awaits the task takes this error. Frames must not refer to
        the error, because it would then never be freed while the garbage collector is off."""
        self._failure: Callable[[], str] | None = None
        """The function that returns the text of this error."""
        self.of_application = True
        """True if the task belongs to the application, and not to an action of a client."""
        self.action: CalledAction | None = None
        """The action of a client to which the task belongs."""
        self.clock: Clock | None = None
        """The clock of the part, by which the task takes its steps; None means the clock of the machine."""
        self.limits: list[timeout] = []
        """The time limits of the blocks in which the task is, the outermost first."""

    def __await__(self) -> Generator[object, Any, Any]:
        """Wait in another sequence for the end of the task. Return the result of the task. Raises TaskFailed if the
        task failed or was cancelled, or if the task itself waits for the awaiting sequence. If the awaiting sequence is
        cancelled, the task is cancelled too (as in asyncio)."""
        awaiting = yield from own_task(f"await {self.name}").__await__()
        if not self.done:
            self._refuse(awaiting)
        self.awaited_by.append(awaiting)
        awaiting.waits_for = self
        try:
            while not self.done:
                yield _PERIOD
        except BaseException:
            self.awaited_by.remove(awaiting)
            self.cancel()  # nobody awaits what fails in its cleaning up
            raise
        finally:
            awaiting.waits_for = None
        self.awaited_by.remove(awaiting)
        error, self.error = self.error, None
        if error is not None:
            self._failure = self._failure or text_later(error)
        if self._failure is not None:
            raise TaskFailed(f"{self.name} failed: {self._failure()}") from error
        if self._cancelled:
            raise TaskFailed(f"{self.name} was cancelled")
        return self.result

    def _refuse(self, awaiting: Task) -> None:
        """Raise TaskFailed if another sequence cannot await this one."""
        if awaiting.machine is not self.machine:
            raise TaskFailed(f"{awaiting.name} cannot await {self.name}, which another machine has started")
        if (why := wait_graph.circle(awaiting, self, "{waiting} awaits {target}")) is not None:
            raise TaskFailed(why)

    @property
    def started(self) -> Task:
        """The sequence that was started: this task, or the task that runs this one in parallel with others (`together`,
        `first`)."""
        return self if self.parent is None else cast(Task, self.parent).started

    @property
    def machine(self) -> object:
        """An object that identifies the machine that advances the task, or None."""
        return self._current

    @expects_errors
    def advance(self, tick: Clock | None) -> bool:
        """Advance by one step. Return True after the last step. The first step needs no tick. Raises the error of the
        sequence, if there is one."""
        if self.done:
            return True
        if not self._begun:
            self._begin()
            tick = None
        if tick is None or not self.limits:
            self._step(self.sequence.send, tick)
        else:
            self._step_within_limits(tick)
        if self._cancelling:
            self.end()
        return self.done

    def _step_within_limits(self, tick: Clock) -> None:
        for each in self.limits:
            each.count(tick)
        self._step(self.sequence.send, tick)
        while expiry := next(filter(None, (each.expires(tick) for each in self.limits)), None):
            self._step(self.sequence.throw, expiry)

    @advances
    def _step(self, resume: Callable[[Any], object], what: object) -> None:
        current = self._current
        if current is not None:
            before, current.task = current.task, self
        try:
            awaited = resume(what)
            while awaited is _WHO:
                awaited = self.sequence.send(self)
        except StopIteration as end:
            self.done, self.result = True, end.value
            return
        except BaseException as error:
            self.done = True
            refuse_exit(error, self.name)
            if text := meant_await(error):
                raise TypeError(text).with_traceback(error.__traceback__) from error
            raise
        finally:
            if current is not None:
                current.task = before
        if awaited is not _PERIOD:
            text = f"a sequence awaited {awaited!r}; {AWAITABLE_HINT}"
            raise with_notes(TypeError(f"{text}{in_brackets(place_of(self.sequence))}"), cancel_all([self]))

    def cancel(self) -> None:
        """Raise Cancelled inside the sequence. The sequence may clean up but must not continue. A sequence that cancels
        itself gets Cancelled at its next await. If its `finally` blocks raise an error, the sequence has failed with
        this error."""
        try:
            if self._end_within is None:
                self.end()
            else:
                self._end_within(self.end)
        except BaseException as error:
            if self._contain is None or not self._contain(self, error):
                raise

    def end(self) -> None:
        """Cancel the sequence. Raises the error that its `finally` blocks raise, if there is one."""
        if self.done:
            return
        if getattr(self.sequence, "cr_running", False):
            self._cancelling = True
            return
        self.done = self._cancelled = True
        if _dropped(self.sequence):
            return
        current = self._current
        if current is not None:
            before, current.task = current.task, self
        try:
            if self._awaits_after(Cancelled) and self._awaits_after(GeneratorExit):
                place = in_brackets(place_of(self.sequence))
                raise TaskFailed(f"{self.name} was cancelled and did not end: it waits again{place}")
        finally:
            if current is not None:
                current.task = before

    def _awaits_after(self, end: type[BaseException]) -> bool:
        """Raise this exception in the sequence. Return True if the sequence still awaits something."""
        try:
            awaited = self.sequence.throw(end())
            while awaited is _WHO:
                awaited = self.sequence.send(self)
        except (end, Cancelled, StopIteration):
            return False
        except BaseException as error:
            refuse_exit(error, self.name)
            raise
        return True

    @property
    def is_untold(self) -> bool:
        """True if the task has failed and its error is lost, because the sequence that awaited the task was cancelled
        before it took the error."""
        return self.error is not None and self._failure is None and not self.awaited_by

    def fail(self, error: BaseException, text: Callable[[], str] | None = None) -> None:
        """End the task with this error, whose frames are released. `text` is a function that returns the text of the
        error."""
        self.error, self._failure = error, text or text_later(error)
        forget_frames(error)

    def _begin(self) -> None:
        self._begun = True
        if inspect.iscoroutine(self.sequence) and inspect.getcoroutinestate(self.sequence) != inspect.CORO_CREATED:
            self.done = True
            raise TypeError(f"{self.name} was started twice; call the `async def` function again for each start")

    @property
    def shown(self) -> Waiter:
        own = self.parent is not None and code_of(self.sequence) in _ADOPTING
        return self.parent.shown if own and self.parent is not None else self

    @property
    def name(self) -> str:
        return f"sequence {getattr(self.sequence, '__qualname__', self.sequence)}"

    @property
    def details(self) -> str:
        number = self.started.number
        told = [arguments_text(self.sequence), f"started as no. {number}"]
        if self.parent is not None:
            told.append(f"part {'.'.join(map(str, reversed(self._places_among_parts)))}")
        return ", ".join(filter(None, told))

    @property
    def _places_among_parts(self) -> list[int]:
        """The index of the task among the tasks that run in parallel with it, from 1; then the index of the task around
        it, and so on outwards."""
        pairs = zip(self.lineage, self.lineage[1:], strict=False)
        found = [(each, around.waits_for) for each, around in pairs]
        return [
            parts.tasks.index(each) + 1
            for each, parts in found
            if isinstance(parts, wait_graph.ParallelParts) and each in parts.tasks
        ]


def _dropped(sequence: Any) -> bool:
    """Close a sequence that has not begun, and return True; return False for any other sequence. Sequences among its
    arguments do not begin either, and a started sequence that belongs to it is cancelled."""
    if not is_new(sequence):
        return False
    errors = [error for task in reversed(_close(sequence)) if (error := error_of(task.cancel)) is not None]
    if errors:
        raise with_notes(errors.pop(0), errors)
    return True


def _close(sequence: Any) -> list[Task]:
    """Close a sequence that has not begun, and the sequences among its arguments, because Python warns of each sequence
    that is not awaited. Return the started sequences that belong to the closed ones."""
    values = inspect.getcoroutinelocals(sequence)
    arguments = [values[name] for name in sequence.cr_code.co_varnames if name in values]
    adopts = sequence.cr_code in _ADOPTING
    sequence.close()
    tasks: list[Task] = []
    for each in arguments:
        for one in each if isinstance(each, tuple) else (each,):
            if is_new(one):
                tasks += _close(one)
            elif adopts and isinstance(one, Task):
                tasks.append(one)
    return tasks


def cancel_all(tasks: list[Task]) -> list[BaseException]:
    """Cancel all tasks, the last started first. An error in the `finally` blocks of one task does not prevent the
    cancellation of the others."""
    return [error for task in reversed(tasks) if (error := error_of(task.end)) is not None]


def error_of(call: Callable[[], object]) -> BaseException | None:
    """Return the error that a call raises, whatever its class, because the outputs must still be reset."""
    try:
        call()
    except BaseException as error:
        return error
    return None


def with_notes(error: BaseException, others: list[BaseException]) -> BaseException:
    for other in others:
        if other is error:
            continue
        add_note(error, f"also, while another sequence was cancelled: {text_of(other)}")
        forget_frames(other)  # its frames refer to the list that it is in: a circle
    return error


def _is_settled(task: Task) -> bool:
    """Return True if an ended sequence can be removed, because no other sequence still takes its error. Raises its
    error if nothing else would report it."""
    if task.error is not None and task.is_untold:
        raise task.error
    return task.error is None or not task.awaited_by


class Sequences:
    """All sequences that run in parallel on one machine. `faults` is notified of sequences that have failed."""

    def __init__(
        self, faults: Containing | None = None, current: Turn | None = None, action: CalledAction | None = None
    ) -> None:
        self._faults = faults or _Uncontained()
        self.of_application = current is None
        """True if the sequences belong to the application, and not to an action."""
        self.action = action
        """The action of a client to which the sequences belong."""
        self.current = current or make_turn()
        """The task that now takes a step in the machine."""
        self._tasks: dict[Task, None] = {}
        """The tasks in the order of starting."""
        self._tasks_of: dict[int, dict[Task, None]] = {}
        """The tasks of each object, by the id of the object."""
        self._number = 0
        self._advancing = False
        self.paused = False
        """True if the sequences are not advanced, so that no time passes for them."""
        self.progress = ""
        """The last progress of the sequences."""
        self.end_within: Callable[[Callable[[], Any]], Any] | None = None
        """The function that ends the sequences when they are cancelled; None to end them directly."""

    @property
    def running(self) -> bool:
        """True if any sequence runs."""
        return bool(self._tasks)

    @property
    def places(self) -> list[str]:
        """The place in the user's code at which each sequence waits."""
        return [place_of(task.sequence) for task in self._tasks]

    @property
    def frames(self) -> list[list[FrameType]]:
        """The frames in which each sequence waits, the outermost first."""
        return [frames_of(task.sequence) for task in self._tasks]

    def others(self, action: CalledAction | None = None) -> Sequences:
        """Return a new, empty group of sequences of the same machine, for an action of a client if one is given."""
        return Sequences(self._faults, self.current, action)

    def task(self, sequence: Routine, part: Any = None) -> Task:
        """Return a new task of this machine that the caller advances."""
        task = Task(sequence, part, current=self.current)
        task.of_application, task.action = self.of_application, self.action
        return task

    def start(self, sequence: Routine, part: Any = None) -> Task:
        task = Task(sequence, part, self._faults.contain_sequence, self._end, current=self.current)
        self._number += 1
        task.number, task.of_application, task.action = self._number, self.of_application, self.action
        self._tasks[task] = None
        self._tasks_of.setdefault(id(part), {})[task] = None
        return task

    def of(self, part: Any) -> Collection[Task]:
        """Return the sequences of one object."""
        return self._tasks_of.get(id(part), {})

    def _remove(self, task: Task) -> None:
        if task in self._tasks:
            del self._tasks[task]
            del self._tasks_of[id(task.part)][task]

    def _end(self, end: Callable[[], Any]) -> Any:
        return end() if self.end_within is None else self.end_within(end)

    def advance(self, tick: Clock, clock: Clock | None = None) -> None:
        """Advance each sequence with this clock by one step, in the order of starting, unless another sequence has just
        failed. The first error that is not contained is raised; it does not cancel other sequences."""
        if not self._tasks or self.paused:
            return
        if self._advancing:
            raise TaskFailed("a sequence called `control` of the root; only the cycle may call it, once per period")
        faults, some_failed = self._faults, False
        self._advancing = True
        faults.gather()
        try:
            for task in list(self._tasks):  # what they start begins with the next period
                if task.clock is not clock or task.paused or (some_failed and faults.is_in_fault(task.part)):
                    continue
                try:
                    over = task.advance(tick) and _is_settled(task)
                except BaseException as error:
                    some_failed = True
                    if not faults.contain_sequence(task, error):
                        self._remove(task)
                        task.error = error  # its text is asked for by who needs it: it may take long
                        raise
                    over = not task.awaited_by  # else whoever awaits it may be cancelled before he takes the error
                if over:
                    self._remove(task)
        finally:
            self._advancing = False
            faults.settle()

    def end_in(self, nodes: Iterable[int], fault: Callable[[], BaseException]) -> list[BaseException]:
        """Cancel the sequences of the objects with these ids, the last started first. Sequences that await a cancelled
        one get the fault. Return the errors of the `finally` blocks."""
        if not self._tasks:
            return []
        of_part = self._tasks_of
        found = sorted((task for node in nodes for task in of_part.get(node, ())), key=attrgetter("number"))
        if not found:
            return []
        ended = [task for task in found if not task.done]
        for task in ended:
            task.fail(fault())
        for task in found:
            if task.error is not None:  # its failure is told by this fault, whoever was to take it
                task.fail(task.error)
        errors: list[BaseException] = self._end(partial(cancel_all, ended))
        return errors

    def cancel(self) -> None:
        """Cancel each sequence because the machine stops, the last started first. Then raise the first error of their
        `finally` blocks, with the other errors as notes."""
        errors: list[BaseException] = []
        while self._tasks:  # cleaning up may start more
            tasks, self._tasks, self._tasks_of = list(self._tasks), {}, {}
            errors += cancel_all(tasks)
            untold = [task for task in tasks if task.error is not None and task.is_untold]
            contain = self._faults.contain_sequence
            errors += [task.error for task in untold if task.error and not contain(task, task.error)]
        if errors:
            raise with_notes(errors[0], errors[1:])
