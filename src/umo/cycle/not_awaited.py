"""The error that is raised if a sequence is called and dropped without an `await`.

Python only prints a warning, by one function for the whole process, and continues. While a machine is connected, umo
replaces this function for the thread of the machine. The error is raised in the innermost function that expects errors
of the user's code, at its next line or when it returns. So the error is a failure of the calling sequence or law, of
its equipment, or of the run. A sequence that is dropped because another error is being raised is not reported.
"""

from __future__ import annotations

import ast
import gc
import inspect
import linecache
import logging
import opcode
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from itertools import chain
from threading import get_ident
from types import CodeType, FrameType
from typing import Any, TypeVar

from umo.cycle.sequence_mistakes import calls_in, forgotten
from umo.errors import NotAwaited
from umo.objects import Compound, walk
from umo.system.streams import log_without_waiting
from umo.text import CodePlace, is_own, printable, shown_place

log = logging.getLogger("umo")
Raising = TypeVar("Raising", bound=Callable[..., Any])
_WARNING_FUNCTION = "_warn_unawaited_coroutine"
"""The function of `warnings` that Python calls with each coroutine that was never awaited."""


def _codes(*names: str) -> frozenset[int]:
    """Return the numbers of the instructions whose names begin like these. Each version of Python has other numbers."""
    return frozenset(number for name, number in opcode.opmap.items() if name.startswith(names))


_DROPS = _codes("POP_TOP")
"""The instruction that drops the result of a statement."""
_LEAVES = _codes("RETURN", "YIELD")
"""The instructions by which code returns, or waits, without an error."""
_FORGETS = _codes("STORE", "DELETE")
"""Instructions that drop the old value of a name: a sequence, or an error with all values of its frames."""
_HANDLES = _codes("POP_EXCEPT", "RERAISE")
"""Instructions that drop an error."""
_CATCHES = _codes("PUSH_EXC_INFO")
"""The instruction with which the handling of an error begins."""
_EXPECTING: set[CodeType] = set()
"""The code of `expects_errors`."""
_ADVANCING: set[CodeType] = set()
"""The code of `advances`."""


def expects_errors(function: Raising) -> Raising:
    """Decorate a function of umo that calls the user's code, and whose callers handle the errors of this code."""
    _EXPECTING.add(function.__code__)
    return function


def advances(function: Raising) -> Raising:
    """Decorate the function of umo in which a sequence takes a step. The error must be raised in the caller of this
    function, which handles it."""
    _ADVANCING.add(function.__code__)
    return function


class _Watch:
    """The watch of all machines of this process."""

    def __init__(self) -> None:
        self._threads: list[int] = []
        """The thread of each connected machine."""
        self._depths: dict[int, int] = {}
        """The depth to which each of these threads tracked the origins of sequences before."""
        self._former: Callable[[Any], object] = _pass_over
        self._collecting = False
        """True if the garbage collector is at work. A sequence that it drops has nothing to do with the code at that
        place."""
        self.debugger: Any = None
        """The trace function of the thread before an error was raised, such as that of a debugger."""

    def begin(self, thread: int) -> None:
        if not self._threads:
            self._former = getattr(warnings, _WARNING_FUNCTION)
            setattr(warnings, _WARNING_FUNCTION, self._let_go)
            gc.callbacks.append(self._note_collecting)
        if thread not in self._threads:
            self._depths[thread] = depth = sys.get_coroutine_origin_tracking_depth()
            sys.set_coroutine_origin_tracking_depth(max(depth, 1))
        self._threads.append(thread)

    def end(self, thread: int) -> None:
        self._threads.remove(thread)
        if not self._threads:
            setattr(warnings, _WARNING_FUNCTION, self._former)
            gc.callbacks.remove(self._note_collecting)
        if thread not in self._threads:
            depth = self._depths.pop(thread)
            if get_ident() == thread:
                sys.set_coroutine_origin_tracking_depth(depth)
        if self.debugger is not None and sys.gettrace() is None:
            sys.settrace(self.debugger)
        self.debugger = None

    def _note_collecting(self, phase: str, info: object) -> None:
        self._collecting = phase == "start"

    def _let_go(self, coroutine: Any) -> None:
        origin, frame = _origin(coroutine), sys._getframe(1)
        if origin is None or get_ident() not in self._threads or self._collecting or not _was_forgotten(frame, origin):
            self._former(coroutine)
            return
        tracing = sys.gettrace()
        if isinstance(getattr(tracing, "__self__", None), _Pending):
            return  # of several the first is told
        self.debugger = self.debugger or tracing
        _close_given(coroutine)
        _Pending(_text(coroutine, origin, frame), frame, partial(self._former, coroutine)).wait_in(frame)


def _pass_over(coroutine: object) -> None:
    """Report nothing."""


_WATCH = _Watch()


def _instruction(frame: FrameType) -> int:
    """Return the number of the instruction that the frame carries out."""
    code, place = frame.f_code.co_code, frame.f_lasti
    while place > 0 and code[place] == 0:  # a cache behind the instruction
        place -= 2
    return code[place]


def _was_forgotten(frame: FrameType, origin: CodePlace) -> bool:
    """Return True if the sequence that this frame drops may have been forgotten. A sequence that is dropped because of
    an error was not forgotten; it may be dropped anywhere."""
    instruction, code = _instruction(frame), frame.f_code
    if is_own(code.co_filename) and code not in _EXPECTING and code not in _ADVANCING:
        return instruction in _DROPS
    if instruction in _FORGETS:
        return (code.co_filename, code.co_name) == (origin.file, origin.function)
    return instruction in _DROPS or (instruction not in _HANDLES and not _may_await(origin))


def _may_await(origin: CodePlace) -> bool:
    """Return True if the function that has called the sequence gives it a name and awaits this name somewhere. Such a
    sequence was not forgotten: an error, or the program itself, has skipped the `await`."""
    function = _function_at(origin)
    nodes = [] if function is None else list(ast.walk(function))
    named = (each.targets for each in nodes if isinstance(each, ast.Assign) and _has_line(each, origin.line))
    names = {each.id for targets in named for each in targets if isinstance(each, ast.Name)}
    awaited = (each.value for each in nodes if isinstance(each, ast.Await))
    given = (each for value in awaited for each in (value, *getattr(value, "args", ())))
    return any(isinstance(each, ast.Name) and each.id in names for each in given)


def _function_at(place: CodePlace) -> ast.FunctionDef | ast.AsyncFunctionDef | None:
    """Return the innermost function around a place, or None if there is none or its source cannot be read."""
    try:
        tree = ast.parse("".join(linecache.getlines(place.file)))
    except (SyntaxError, ValueError):
        return None
    functions = ast.FunctionDef | ast.AsyncFunctionDef
    around = [each for each in ast.walk(tree) if isinstance(each, functions) and _has_line(each, place.line)]
    return around[-1] if around else None


def _is_in_sequence(origin: CodePlace, frame: FrameType | None) -> bool:
    """Return True if the dropped sequence was called by a sequence. A comprehension belongs to the function around it.
    If the source cannot be read, the frame that drops the sequence decides."""
    if origin.function == "<lambda>":
        return False
    if (function := _function_at(origin)) is not None:
        return isinstance(function, ast.AsyncFunctionDef)
    return frame is not None and bool(frame.f_code.co_flags & inspect.CO_COROUTINE)


def _has_line(node: ast.stmt, line: int) -> bool:
    return node.lineno <= line <= (node.end_lineno or node.lineno)


def _close_given(coroutine: Any) -> None:
    """Close the sequences that were arguments of a sequence that is not awaited. Only the latter is reported."""
    for value in inspect.getcoroutinelocals(coroutine).values():
        for each in value if isinstance(value, tuple) else (value,):
            if inspect.iscoroutine(each) and inspect.getcoroutinestate(each) == inspect.CORO_CREATED:
                each.close()


def hear() -> Callable[[], None]:
    """Raise an error from now on if a sequence of this thread is never awaited. Return the function that stops this
    check."""
    thread = get_ident()
    _WATCH.begin(thread)
    return partial(_WATCH.end, thread)


@contextmanager
def heard() -> Iterator[None]:
    """Return a context in which an error is raised if a sequence of this thread is never awaited (`hear`)."""
    end = hear()
    try:
        yield
    finally:
        end()


def tell_kept(root: Compound) -> None:
    """Report and close the sequences that were never awaited and are still attributes of a machine at its end. They are
    reported here because nothing will drop them later."""
    parts = [each for each in (root, *walk(root)) if isinstance(each, Compound)]
    values = [value for part in parts for value in vars(part).values()]
    for each in chain.from_iterable(value if isinstance(value, list | tuple) else (value,) for value in values):
        if inspect.iscoroutine(each) and inspect.getcoroutinestate(each) == inspect.CORO_CREATED:
            if (origin := _origin(each)) is not None:
                log_without_waiting(log, printable(_text(each, origin, None)))
            each.close()


def _origin(coroutine: Any) -> CodePlace | None:
    """Return the place where the sequence was called. Return None if this place, or the called function, is unknown or
    is not the user's."""
    code: CodeType | None = getattr(coroutine, "cr_code", None)
    places = getattr(coroutine, "cr_origin", None)
    if code is None or not places or (is_own(places[0][0]) and is_own(code.co_filename)):
        return None
    return CodePlace(*places[0])


def _text(coroutine: Any, origin: CodePlace, frame: FrameType | None) -> str:
    """Return the text of the report. `frame`: the frame that drops the sequence, if any."""
    name, code = coroutine.__name__, coroutine.cr_code
    if is_own(origin.file):  # umo has called what it takes for a plain function
        place = shown_place(CodePlace(code.co_filename, code.co_firstlineno, "<module>"))
        return f"{place}: `{name}` is a sequence, but its caller does not wait: write `def {name}`"
    call = _call_in(linecache.getline(origin.file, origin.line), name)
    told = forgotten(call, origin.function, in_sequence=_is_in_sequence(origin, frame))
    return f"{shown_place(origin)}: {told}"


def _call_in(line: str, name: str) -> str:
    """Return the call of the function in a line of the source. If the call continues in the next line, return the name
    of the function."""
    found = (ast.get_source_segment(whole, call) for whole, call in calls_in(line.strip(), name))
    return next(filter(None, found), f"{name}(...)")


class _Pending:
    """An error that is raised when a frame continues. A debugger that traces this thread stops tracing."""

    def __init__(self, text: str, frame: FrameType, warn: Callable[[], object]) -> None:
        self._text, self._warn = text, warn
        self._handled = sys.exc_info()[1]
        self._is_certain = _instruction(frame) in _DROPS
        """True if the sequence was dropped by a normal statement. False if it may have been dropped because of an
        error."""

    def wait_in(self, frame: FrameType) -> None:
        """Wait until the next line of the frame begins, or the frame ends."""
        frame.f_trace = self._look
        sys.settrace(self._at_call)

    def _at_call(self, frame: FrameType, event: str, argument: Any) -> None:
        """Trace nothing except the call."""

    def _look(self, frame: FrameType, event: str, argument: Any) -> Any:
        expects = frame.f_code in _EXPECTING or not is_own(frame.f_code.co_filename)
        has_ended = event == "exception" and issubclass(argument[0], StopIteration)  # a sequence, of its own accord
        frame.f_trace = None
        if not has_ended and self._is_failing(frame, event):
            self._give_up()
        elif expects:
            raise NotAwaited(self._text)
        else:
            self._go_out(frame)
        return None

    def _is_failing(self, frame: FrameType, event: str) -> bool:
        """Return True if another error is in progress."""
        instruction = _instruction(frame)
        if event == "return":
            return instruction not in _LEAVES
        handled = sys.exc_info()[1]
        is_new = handled is not None and handled is not self._handled
        return event == "exception" or instruction in _CATCHES or (is_new and not self._is_certain)

    def _go_out(self, frame: FrameType) -> None:
        """Wait in the innermost function around the frame that expects errors."""
        self._is_certain = True
        outer = frame.f_back
        while outer is not None and outer.f_code not in _EXPECTING and is_own(outer.f_code.co_filename):
            outer = outer.f_back
        if outer is None:
            self._give_up()
        else:
            self.wait_in(outer)

    def _give_up(self) -> None:
        """Give up: another error is raised, or this one cannot be raised. Python warns as usual."""
        sys.settrace(_WATCH.debugger)
        if self._is_certain:
            self._warn()
