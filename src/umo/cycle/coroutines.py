"""Facts about a sequence that Python provides: where it waits, its code, its arguments."""

from __future__ import annotations

import inspect
from enum import Enum
from types import CodeType, CoroutineType, FrameType
from typing import Any

from umo.objects import Node
from umo.text import cut_repr, place_among


def frames_of(sequence: Any) -> list[FrameType]:
    """Return the frames in which a sequence waits, the outermost first."""
    frames: list[FrameType] = []
    while isinstance(sequence, CoroutineType):
        if sequence.cr_frame is not None:
            frames.append(sequence.cr_frame)
        sequence = sequence.cr_await
    return frames


def place_of(sequence: Any) -> str:
    """Return the place at which a sequence waits, in code that is not Python's own."""
    frames = frames_of(sequence)
    return place_among((each.f_code.co_filename, each.f_lineno, each.f_code.co_name) for each in frames)


def code_of(sequence: Any) -> CodeType | None:
    """Return the code of the sequence's `async def` function; None for a sequence that no such function has made."""
    return getattr(sequence, "cr_code", None)


def given_to(sequence: Any) -> dict[str, Any]:
    """Return the arguments of the sequence's function, and the values that it uses from enclosing functions. After the
    end of the sequence, return {}."""
    code, values = _running(sequence)
    names = () if code is None else (*_parameters(code), *code.co_freevars)
    return {name: values[name] for name in names if name in values}


def arguments_text(sequence: Any) -> str:
    """Return the short arguments of an `async def` function as text: objects of the machine, numbers, strings."""
    code, values = _running(sequence)
    if code is None:
        return ""
    shown = {name: _argument(values[name]) for name in _parameters(code) if name in values}
    return ", ".join(f"{name}={text}" for name, text in shown.items() if text)


def is_new(sequence: Any) -> bool:
    """Return True if the object is a sequence that has not begun."""
    return inspect.iscoroutine(sequence) and inspect.getcoroutinestate(sequence) == inspect.CORO_CREATED


def _running(sequence: Any) -> tuple[CodeType | None, dict[str, Any]]:
    """Return the code of a sequence and the values of its names. After the end of the sequence, the code is None and
    there are no values."""
    frame: FrameType | None = getattr(sequence, "cr_frame", None)
    return (None, {}) if frame is None else (frame.f_code, frame.f_locals)


def _parameters(code: CodeType) -> tuple[str, ...]:
    return code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]


def _argument(value: object) -> str:
    if isinstance(value, Node):
        return value._path
    return cut_repr(value) if isinstance(value, str | int | float | Enum) else ""
