"""The only way to call the user's code. Whatever this code raises, and any wrong value that it returns, becomes an
error with its place and has no other effect.

The user's code is all code that umo calls but that is not part of umo: observers, conditions, actions, properties,
sequences that clean up, the declarations of a station. Decision 0022 lists the places.
"""

from __future__ import annotations

import json
import signal
import threading
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from inspect import CO_COROUTINE, getsourcefile, getsourcelines, iscoroutinefunction, unwrap
from math import nan
from types import FunctionType
from typing import Any, NamedTuple

from umo.errors import Cancelled, DeclarationError, Interrupted, TaskFailed, UmoError, forget_frames, text_of
from umo.text import CodePlace, did_you_mean, in_brackets, is_own, shown_place

MAX_LENGTH = 2000
"""Largest length of an error's text, in characters."""


class Raised(NamedTuple):
    """An error of the user's code, with its text and place. It does not keep the traceback of the exception, which
    would keep every object alive that the code had used."""

    kind: type[BaseException]
    text: str
    """The text of the exception (`text_of`)."""

    def __str__(self) -> str:
        """Return the text, which always includes the type, because a client raises the same error."""
        return f"{self.kind.__name__}: {self.text}" if issubclass(self.kind, UmoError) else self.text


def attempt(call: Callable[..., Any], *arguments: Any) -> tuple[Any, Raised | None]:
    """Call the user's code. Return its result and None, or None and the error that it raised, whatever the class of the
    error.

    Only a Ctrl-C passes: a KeyboardInterrupt in the main thread, while Python's handler of SIGINT is installed. While a
    machine is connected, this handler is not installed. SIGINT then requests the machine to stop, and a
    KeyboardInterrupt counts as an error of the code that raises it. The `Interrupted` of a further signal passes."""
    try:
        return call(*arguments), None
    except BaseException as error:
        return None, told(error)


def told(error: BaseException) -> Raised:
    """Return the error that has just been caught as a `Raised`. The frames in which the error was raised are released.
    A Ctrl-C is raised again."""
    if is_interrupt(error):
        raise error
    text = text_of(error)
    forget_frames(error)
    return Raised(type(error), text if len(text) <= MAX_LENGTH else f"{text[:MAX_LENGTH]}...")


def check_overrides(cls: type) -> None:
    """Raise DeclarationError for a sequence that overrides a plain method of umo, because nothing would await it."""
    for number, owner in enumerate(cls.__mro__):
        for name, value in vars(owner).items():
            if not (isinstance(value, FunctionType) and value.__code__.co_flags & CO_COROUTINE):
                continue
            if any(_is_plain(vars(base).get(name)) for base in cls.__mro__[number + 1 :]):
                starts = "; a sequence is started in it: `self.cycle.start(...)`" if name == "control" else ""
                place = in_brackets(shown_place(definition(value)))
                what = f"{cls.__name__}.{name} is a sequence; it must act at once: `def {name}(self)`"
                raise DeclarationError(f"{what}{starts}{place}")


def _is_plain(method: object) -> bool:
    """Return True if the object is a plain method of umo, not a sequence."""
    if not isinstance(method, FunctionType) or method.__code__.co_flags & CO_COROUTINE:
        return False
    return is_own(method.__code__.co_filename)


def definition(function: Callable[..., Any]) -> CodePlace | None:
    """Return the place of a function in the source, or None if it is not written in Python."""
    code = getattr(unwrap(function), "__code__", None)
    return None if code is None else CodePlace(code.co_filename, code.co_firstlineno, "<module>")


def abstract_names(cls: type) -> frozenset[str]:
    """Return the abstract functions of a class (`abstractmethod`) that neither the class nor a base defines. It
    corresponds to `__abstractmethods__` of a class of `abc`."""
    known = {name for base in cls.__bases__ for name in getattr(base, "_abstract", ())}
    known |= {name for name, value in vars(cls).items() if getattr(value, "__isabstractmethod__", False)}
    return frozenset(name for name in known if getattr(getattr(cls, name, None), "__isabstractmethod__", False))


def incomplete(cls: type, names: Collection[str]) -> DeclarationError:
    """Return the error to raise for an object whose class lacks these functions."""
    base = next(each for each in reversed(cls.__mro__) if min(names) in vars(each))
    kinds = cls.__mro__[: cls.__mro__.index(base)]
    own = {name for kind in kinds for name, value in vars(kind).items() if isinstance(value, FunctionType | property)}
    missing = ", ".join(f"`{name}`{did_you_mean(name, own - {*names})}" for name in sorted(names))
    place = in_brackets(shown_place(class_place(cls)))
    return DeclarationError(f"{cls.__name__} has no {missing}, which each {base.__name__} must have{place}")


def class_place(cls: type) -> CodePlace | None:
    """Return the place where a class begins in the source, or None if there is no source."""
    try:
        return CodePlace(getsourcefile(cls) or "", getsourcelines(cls)[1], "<module>")
    except (OSError, TypeError):  # it was made by a program, or in an interactive session
        return None


def check_acts_at_once(what: str, function: Any) -> None:
    """Raise DeclarationError for a sequence in place of a plain function: a sequence used as a condition would always
    be true."""
    if iscoroutinefunction(function):
        place = in_brackets(shown_place(definition(function)))
        raise DeclarationError(f"{what} is a sequence; it must act at once: `def`, not `async def`{place}")


@contextmanager
def raise_as(kind: type[UmoError], what: str) -> Iterator[None]:
    """Return a context that turns exceptions into an error of this kind, whose text begins with `what`. Use it for
    declarations, outside of a run. Errors of umo and a Ctrl-C pass unchanged."""
    try:
        yield
    except BaseException as error:
        if isinstance(error, UmoError) or is_interrupt(error):
            raise
        raise kind(f"{what}: {text_of(error)}") from error


def refuse_exit(error: BaseException, what: str) -> None:
    """Turn a BaseException that is not an Exception into a TaskFailed, because a SystemExit would end the whole run,
    and `sys.exit(0)` would even count as a success. A Ctrl-C, and the Cancelled of a sequence, stay unchanged."""
    if not isinstance(error, Exception | Cancelled) and not is_interrupt(error):
        raise TaskFailed(f"{what} raised {text_of(error)}; it must end by returning or with an error") from error


def is_interrupt(error: BaseException) -> bool:
    """Return True if an exception comes from the user's Ctrl-C, or from another signal of the user, and was not raised
    by code."""
    if isinstance(error, Interrupted):
        return True
    return (
        isinstance(error, KeyboardInterrupt)
        and threading.current_thread() is threading.main_thread()
        and signal.getsignal(signal.SIGINT) is signal.default_int_handler
    )


def read_numbers(numbers: Iterable[tuple[str, Any, Any, str, Any]]) -> list[float]:
    """Return the present values of signals. The third and fourth item of each signal are the owner and the name of its
    attribute. NaN stands for a signal that has no value or cannot be read."""
    values = []
    for _, _, owner, name, _ in numbers:  # not by `attempt`: a call for each in every period is too dear
        try:
            values.append(float(getattr(owner, name)))
        except BaseException as error:
            if is_interrupt(error):
                raise
            values.append(nan)
    return values


def as_json(result: Any, longest: int) -> str:
    """Return a result as JSON in ASCII with at most this number of bytes. Objects in the result that are not plain data
    are replaced by their strings. A result that is too long, contains itself or has numbers that are not finite is
    replaced by its string, which is cut and marked as cut."""
    text, error = attempt(partial(json.dumps, result, default=str, allow_nan=False))
    if error is None and len(text) <= longest:
        return str(text)
    shown, error = attempt(lambda: str.__str__(result if isinstance(result, str) else repr(result)))
    return _cut(f"<{type(result).__name__}, which cannot be shown: {error.text}>" if error else shown, longest)


def briefly(result: Any, longest: int) -> str:
    """Describe a wrong result in a few words, quickly even if it is large: a plain value as JSON, anything else by its
    type."""
    if result is None or isinstance(result, bool | int | float | str):
        return as_json(result, longest)
    return f"an object of the type {type(result).__name__}"


def _cut(text: str, longest: int) -> str:
    """Return a text as JSON. If the text is too long, its end is cut off, and its length is added."""
    found, room = json.dumps(text[: longest + 1]), longest
    while len(found) > longest:
        if not room:
            return '""'
        room = room * 3 // 4
        found = json.dumps(f"{text[:room]}... (cut: {len(text):,} characters)")
    return found
