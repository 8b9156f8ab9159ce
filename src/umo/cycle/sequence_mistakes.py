"""The messages for errors with sequences: an argument that is not a condition, not a sequence, or cannot be awaited.
Each message says what to write instead."""

from __future__ import annotations

import ast
import inspect
import linecache
import sys
from collections.abc import Generator, Iterator
from itertools import islice
from types import CoroutineType, FrameType, FunctionType
from typing import Any

from umo.objects import Atomic
from umo.objects.stored_names import MAKING
from umo.states import TwoState, shown
from umo.text import cut_repr, is_own, str_of

AWAITABLE_HINT = "a sequence can await only the functions of umo.control"
"""The part of a message that says what a sequence can await."""


def forgotten(call: str, function: str, *, in_sequence: bool) -> str:
    """Return the message for a sequence that a function has called and that is never awaited. `in_sequence`: whether
    the calling function is itself a sequence."""
    instead = "write `await` before it" if in_sequence else "write `cycle.start(...)` around it"
    if function in MAKING:
        instead = f"nothing runs yet in `{function}`: await it in the application"
    elif function == "<lambda>":
        instead = "a `lambda` does not wait: await it in a sequence"
    return f"nobody awaits `{call}`, so it does not run; {instead}"


def no_machine(application: Any) -> str:
    """Return the message for an application that cannot take the machine as its first argument; "" if it can, or if
    this is not known."""
    try:
        given = list(inspect.signature(application).parameters.values())
    except (TypeError, ValueError):
        return ""
    if given and given[0].kind not in (inspect.Parameter.KEYWORD_ONLY, inspect.Parameter.VAR_KEYWORD):
        return ""
    name = getattr(application, "__name__", "it")
    return f"{name} has no parameter for the machine: write `async def {name}(m)`"


def meant_await(error: BaseException) -> str:
    """Return a message about the error in an `await` that is more precise than Python's; "" if another cause is
    likely."""
    text = str_of(error) if type(error) in (RuntimeError, TypeError) else ""
    if text == "no running event loop":  # asyncio.sleep, for one
        return f"asyncio cannot be used in a sequence; {AWAITABLE_HINT}"
    if not text.endswith("can't be used in 'await' expression"):
        return ""
    if text.startswith(("object method", "object function")):
        return f"{text}: it is not called; write `await ...()`"
    if text.startswith(("object tuple", "object list")):
        return f"{text}; several sequences are awaited by `await together(...)`"
    return f"{text}; {AWAITABLE_HINT}"


def instead_of_sequence(given: object) -> str:
    """Return a message that names the object passed in place of a sequence, and says what to write instead."""
    if inspect.iscoroutinefunction(given):
        name = getattr(given, "__name__", "it")
        return f"{name} is an `async def` function and was not called: write `{name}()`"
    if inspect.isasyncgen(given):
        return f"{given.__name__}() is not a sequence, as there is a `yield` in it"
    if isinstance(given, list | tuple | set | frozenset | Generator):
        return f"a {type(given).__name__} is not a sequence; give several with a star: `together(*sequences)`"
    return f"{cut_repr(given)} is not a sequence; call an `async def` function"


def check_condition(function: str, condition: object) -> None:
    """Check a condition. Raises TypeError for an object that cannot be called in each period, such as the result of a
    comparison, and for a sequence. The check searches the call in the surrounding code, so it may only be called by
    `function` itself, which is an `async def`."""
    if type(condition) is FunctionType and not condition.__code__.co_flags & inspect.CO_COROUTINE:
        return  # nearly always
    if not callable(condition) or isinstance(condition, type):
        source = _first_argument(function, sys._getframe(1).f_back)
        instead = _instead(function, condition, source)
        if isinstance(condition, CoroutineType):
            condition.close()  # it is told here that nobody awaits it
        raise TypeError(f"{function}() takes a function, which it calls in every period; {instead}")
    name = getattr(condition, "__name__", "the condition")
    if inspect.iscoroutinefunction(condition):
        raise TypeError(
            f"{function}() needs a condition that answers immediately, but {name} is a sequence: `def {name}`"
        )
    item = getattr(condition, "__self__", None)
    if isinstance(item, Atomic):
        source = (_first_argument(function, sys._getframe(1).f_back) or f"{item.path}.{name}").removesuffix(".read")
        raise TypeError(f"{function}() needs a condition that is true or false: {_compared(function, item, source)}")


def _compared(function: str, item: Atomic, source: str) -> str:
    if (states := item._states) is not None:
        return f"write `{function}(lambda: {source}.read() is {shown(getattr(item, 'one', next(iter(states))))})`"
    return f"write, for example, `{function}(lambda: {source}.read() > 5.0)`"


def _instead(function: str, given: object, source: str) -> str:
    """Return what was passed, and what to write instead."""
    name = source or "..."
    if isinstance(given, CoroutineType):
        return f"`{source or given.__name__}` is a sequence: write `await {source or given.__name__}`"
    if callable(getattr(given, "__await__", None)):
        return f"`{name}` is a task: write `await {name}`, or `{function}(lambda: {name}.done)`"
    if isinstance(given, Atomic):
        return f"`{name}` is an object: {_compared(function, given, name)}"
    if isinstance(given, TwoState):
        compared = f"{name} is {shown(given)}"
        return f"`{name}` was read only once, before the call, and gave {given}: write `{function}(lambda: {compared})`"
    if source and not isinstance(given, type):
        once = f"`{source}` was evaluated only once, before the call, and gave {cut_repr(given)}"
        return f"{once}: write `{function}(lambda: {source})`"
    return f"{cut_repr(given)} is not a function: write `{function}(lambda: ...)`"


def _first_argument(function: str, frame: FrameType | None) -> str:
    """Return the source of the first argument of the call that this frame awaits; "" if it cannot be read."""
    if frame is None or is_own(frame.f_code.co_filename):
        return ""
    start, end, _, _ = next(islice(frame.f_code.co_positions(), frame.f_lasti // 2, None), (None,) * 4)
    if start is None or end is None:
        return ""
    lines = [linecache.getline(frame.f_code.co_filename, number) for number in range(start, end + 1)]
    return _argument_in("".join(lines).strip(), function)


def _argument_in(text: str, function: str) -> str:
    for whole, call in calls_in(text, function):
        if call.args:
            return " ".join((ast.get_source_segment(whole, call.args[0]) or "").split())
    return ""


def calls_in(text: str, name: str) -> Iterator[tuple[str, ast.Call]]:
    """Return the calls of a function in a piece of source, such as a line that begins a block, each with the statement
    that contains it."""
    for whole in (text, f"{text} pass", f"{text} pass".removeprefix("el")):
        try:
            nodes = ast.walk(ast.parse(whole))
        except (SyntaxError, ValueError):
            continue
        yield from ((whole, node) for node in nodes if isinstance(node, ast.Call) and called_name(node) == name)


def called_name(call: ast.Call) -> str:
    """Return the name of the called function: `until` for `control.until(...)`."""
    function: Any = call.func
    name: str = getattr(function, "attr", getattr(function, "id", ""))
    return name
