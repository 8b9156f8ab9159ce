"""All errors of umo, ordered by what is wrong: declaration, wiring, value, device, program.

UmoError
|-- DeclarationError (TypeError)     the declaration: a wrong child, default, range or unit
|-- WiringError (ValueError)         the wiring: every mistake, with its file and key
|   `-- ChannelError                 a channel's text, with the forms its driver knows
|-- RangeError (ValueError)          a value beyond its object's range, NaN or infinite
|-- RecipeError (ValueError)         a recipe is refused: every mistake, with its file and line
|-- StateError (TypeError)           a state of another two-state type
|-- OptionError (TypeError)          an option of a run: unknown, missing, or with a value of a wrong type
|-- PathError (LookupError)          a path that names no object of the machine
|-- NotConnected (RuntimeError)      an object was used outside `connect`
|-- DriverError (OSError)            the device: every path and channel that failed
|   |-- DeviceTimeout (TimeoutError) a call did not end within the driver's timeout
|   |-- ChannelsFailed               some channels of a block transfer; the others were transferred
|   `-- StopError                    outputs that could not be brought to their defaults
|-- BadInput (RuntimeError)          the input of a control law has no accepted quality, or a state was never read
|-- Interlocked (RuntimeError)       an interlock with effect="stop" forbids the write
|-- CommandRefused (RuntimeError)    a command from outside: without the lease, or not in this mode
|   `-- LeaseHeld                    another client has the lease
|-- NotAwaited (TypeError)           a sequence was called but never awaited
|-- Busy (RuntimeError)              a motion was started on an axis in motion
|-- TaskFailed                       the machine could not do its work: base of a station's own errors
|   |-- TimeExpired (TimeoutError)   a condition was not true within its timeout
|   |-- EquipmentFault               equipment is in fault: no work runs in it, and none can be started
|   |-- AxisError                    an axis does not follow its setpoint, or does not arrive
|   `-- HomingError                  an axis did not find its reference
|-- FramesError (RuntimeError)       frames cannot be published or read
|-- DeviceHeld (RuntimeError)        another process, or another machine of this one, holds a device
`-- AcknowledgeRequired (RuntimeError) the last run on a device ended unsafely and was not acknowledged
Cancelled (BaseException)            thrown into sequences when the machine stops
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from opcode import opmap
from traceback import format_list, walk_stack
from types import FrameType, TracebackType
from typing import Any, NamedTuple

from umo.text import (
    CodePlace,
    add_note,
    cut_words,
    did_you_mean,
    frames_of_mistake,
    in_a_line,
    in_brackets,
    near_attribute,
    raised_at,
    shown_place,
    some,
    str_of,
)

FAILURES = (Exception, SystemExit)
"""The exceptions that count as failures of a driver's call. They include SystemExit, because it would end the program
without an error."""


class UmoError(Exception):
    """Base of all errors that umo raises. All of them can be copied and pickled, whatever the arguments of the
    constructor. Long words that a message repeats are cut (`umo.text.cut_words`)."""

    def __init__(self, *args: object) -> None:
        super().__init__(*(cut_words(each) if isinstance(each, str) else each for each in args))

    def __reduce__(self) -> tuple[Any, ...]:
        return _rebuilt, (type(self), self.args, self.__dict__)


def _rebuilt(kind: type[UmoError], args: tuple[Any, ...], state: dict[str, Any]) -> UmoError:
    """Return an error made without its constructor, because the constructor makes the message from other arguments."""
    error = kind.__new__(kind)
    error.args = args
    error.__dict__.update(state)
    return error


class Interrupted(KeyboardInterrupt):
    """A signal has ended the run of a machine, user code that did not end by itself, or code that ran before there was
    a machine. `number`: the number of the signal. `result`: what the run has produced so far."""

    def __init__(self, what: str, number: int, result: Any = None) -> None:
        super().__init__(what)
        self.number, self.result = number, result


class DeclarationError(UmoError, TypeError):
    """The declaration of the machine is wrong."""


@dataclass(frozen=True, slots=True)
class Mistake:
    """A mistake in a wiring: file, key and message."""

    file: str
    key: str
    message: str

    def __post_init__(self) -> None:
        object.__setattr__(self, "message", cut_words(self.message))

    def __str__(self) -> str:
        return f"{self.file}: {self.key}: {self.message}" if self.key else f"{self.file}: {self.message}"


class WiringError(UmoError, ValueError):
    """The wiring does not fit the machine; `mistakes` lists all of them."""

    def __init__(self, message: str, mistakes: Sequence[Mistake] = ()) -> None:
        super().__init__("\n".join([message, *map(str, mistakes)]) if mistakes else message)
        self.mistakes = tuple(mistakes)


class RecipeError(UmoError, ValueError):
    """A recipe is refused; `mistakes` lists all mistakes, with file and line if known."""

    def __init__(self, message: str, mistakes: Sequence[Mistake] = ()) -> None:
        super().__init__("\n".join([message, *map(str, mistakes)]) if mistakes else message)
        self.mistakes = tuple(mistakes)


_PLACEHOLDER = re.compile(r"(?<![^\W_])(?:N|TYPE)(?![^\W_])|[{\[]")
"""The part of a form such as "coil:N" that shows that it is a form and not the text of a channel."""


class ChannelError(WiringError):
    """The text of a channel does not have a form that its driver knows."""

    def __init__(self, text: str, forms: Iterable[str]) -> None:
        forms = list(forms)
        self.text = text
        near = did_you_mean(text, (form for form in forms if not _PLACEHOLDER.search(form)))
        super().__init__(f"there is no channel {text!r}{near}; the forms are: {', '.join(forms)}")


class RangeError(UmoError, ValueError):
    """The value lies beyond the range of its object, or is not finite; nothing was changed."""


class StateError(UmoError, TypeError):
    """The value is not a state of the object's two-state type; nothing was changed."""


class OptionError(UmoError, TypeError):
    """An option of a run is missing, has a value of a wrong type, or is not used by anything."""


class PathError(UmoError, LookupError):
    """No object of the machine has this path."""


class NotConnected(UmoError, RuntimeError):
    """The object is not connected; use it inside `with connect(...)`."""


class Failure(NamedTuple):
    """The failure of one object: path, channel, cause, and the driver with its device."""

    path: str
    channel: str
    """Text of the channel; "-" if the driver or the application as a whole has failed, not a single object."""
    cause: str
    driver: str = ""
    """Name of the driver in the wiring, and its devices: `box (modbus tcp 127.0.0.1:502)`."""

    def __str__(self) -> str:
        return _together([self])


class DriverError(UmoError, OSError):
    """A device failed; `failures` names every path and channel concerned. The text names each driver and cause once,
    with the first objects and the number of the others.

    A driver raises it with a message only; umo adds the failures.
    """

    def __init__(self, message: str, failures: Sequence[Failure] = ()) -> None:
        alike: dict[tuple[str, str], list[Failure]] = {}
        for failure in failures:
            alike.setdefault((failure.driver, failure.cause), []).append(failure)
        causes = "\n  ".join(map(_together, alike.values()))
        super().__init__(f"{message}: {causes}" if causes else message)
        self.failures = tuple(failures)


def _together(failures: Sequence[Failure]) -> str:
    """Return the text for the failures of one driver with one cause."""
    first = failures[0]
    objects = [failure.path for failure in failures if failure.channel != "-" or not failure.driver]
    one = f" (channel {first.channel})" if len(objects) == 1 and first.channel not in ("-", first.path) else ""
    what = f"{first.driver}: {first.cause}" if first.driver else first.cause
    if not objects:
        return what
    return f"{what}; {some(objects)}{one}" if first.driver else f"{some(objects)}{one}: {what}"


class DeviceTimeout(DriverError, TimeoutError):
    """The device did not answer within the driver's `timeout`."""


class ChannelsFailed(DriverError):
    """Some channels of a driver's block transfer failed; all others were transferred. The device answers, so umo does
    not look for it.

    `causes` maps the text of each failed channel to an exception or a string. Only the text of an exception is kept.
    """

    def __init__(self, causes: Mapping[str, Exception | str]) -> None:
        self.causes = {text: cause if isinstance(cause, str) else text_of(cause) for text, cause in causes.items()}
        for cause in causes.values():
            if not isinstance(cause, str):
                forget_frames(cause)  # the frame that collected them is among these
        super().__init__("; ".join(f"{text}: {cause}" for text, cause in self.causes.items()))


class StopError(DriverError):
    """Some outputs could not be brought to their defaults; the error lists them."""


class BadInput(UmoError, RuntimeError):
    """A control law has read a sensor whose quality it does not accept, or code has read the state of a sensor that was
    never read (`why`). For a Vector the error names the first sensor and the number of others."""

    def __init__(self, path: str, quality: object, others: int = 0, *, why: str = "") -> None:
        more = f", and {others} more of the Vector {'is' if others == 1 else 'are'} not accepted" if others else ""
        super().__init__(f"{path} is {quality}{why and f': {why}'}{more}")
        self.path = path
        self.quality = quality


class Interlocked(UmoError, RuntimeError):
    """An interlock with effect="stop" inhibits the actuator: only its default may be written. Nothing was changed."""

    def __init__(self, path: str, reason: str) -> None:
        super().__init__(f"{path} is interlocked: {reason}")
        self.path = path
        self.reason = reason


class CommandRefused(UmoError, RuntimeError):
    """A client's command was refused: the client does not have the lease, another client has it, or the mode does not
    allow the command. Nothing was changed. Also raised if a hold of the client has ended because of an interlock, a
    fault of the equipment, or another client."""


class LeaseHeld(CommandRefused):
    """Another client has the lease."""


class Busy(UmoError, RuntimeError):
    """The axis is already in motion."""


class NotAwaited(UmoError, TypeError):
    """A sequence was called but never awaited or started, so its code did not run."""


class TaskFailed(UmoError):
    """The machine could not carry out its task. Base class for the errors of a station."""


class TimeExpired(TaskFailed, TimeoutError):
    """A condition was not true within its timeout."""


class EquipmentFault(TaskFailed):
    """The equipment is in fault (its `path`, the `reason`): its sequences and motions have ended, and nothing can be
    started in it before `clear`."""

    def __init__(self, path: str, reason: str | Callable[[], str]) -> None:
        """If `reason` is a function, it is called only when the text is needed, because it may call the user's code."""
        super().__init__(path, reason)
        self.path = path
        self._reason = reason

    @property
    def reason(self) -> str:
        return self._reason if isinstance(self._reason, str) else self._reason()

    def __str__(self) -> str:
        if len(self.args) == 1:  # as a client gets it: its text
            return str(self.args[0])
        return f"{self.path} is in fault: {self.reason}"


class AxisError(TaskFailed):
    """An axis does not follow its setpoint, or does not arrive: a stalled or over-driven motor, a dead encoder."""


class HomingError(TaskFailed):
    """An axis did not find its reference."""


class DeviceHeld(UmoError, RuntimeError):
    """A device is already in use: by another process, or by another connected machine of this process."""


class AcknowledgeRequired(UmoError, RuntimeError):
    """The last run on a device ended unsafely. Inspect the machine, then connect with `acknowledge=True`."""


class FramesError(UmoError, RuntimeError):
    """A ring of frames cannot be created or read: its version is wrong, it belongs to another user, or the disk is
    full."""


class Cancelled(BaseException):
    """The machine stops, or a sequence in the same `together` has failed. Raised inside a sequence."""


def text_of(error: BaseException) -> str:
    """Return the text of an exception in one line. An exception of umo, of the operating system or of a device explains
    itself. Any other exception comes from an error in code, so its type precedes the text, and the place where it was
    raised follows."""
    return text_later(error)()


def text_later(error: BaseException, *, placed: bool = False) -> Callable[[], str]:
    """Return a function that makes the text of an exception later, because making the text calls the user's code
    (`__str__`), which may be slow. The place is determined now, so that the error may lose its frames before the text
    is made. `placed`: add the place of the code also to errors of umo, except DriverError and TaskFailed."""
    return partial(_text_of, error, raised_at(error), placed)


def _text_of(error: BaseException, place: CodePlace | None, placed: bool = False) -> str:
    said = str_of(error).strip()
    if said and isinstance(error, UmoError | OSError | Interrupted):
        is_mistake = isinstance(error, UmoError) and not isinstance(error, DriverError | TaskFailed)
        return in_a_line(said) + (in_brackets(shown_place(place)) if placed and is_mistake else "")
    first = said.partition("\n")[0]
    near = _nearest_attribute(error) if isinstance(error, AttributeError) else ""
    return ": ".join(filter(None, (type(error).__name__, first))) + near + in_brackets(shown_place(place))


def _nearest_attribute(error: AttributeError) -> str:
    """Return a hint such as ` (did you mean 'target'?)` for the reading of an attribute that the object does not
    have."""
    with suppress(BaseException):  # `dir` of the user's may raise anything
        return "" if error.obj is None else near_attribute(error.name or "", dir(error.obj))
    return ""


def forget_frames(error: BaseException) -> None:
    """Drop the frames to which an error and its causes refer, when the text of the error is known and the error is not
    raised again.

    A frame that holds an exception whose traceback contains the frame forms a circle of references. Only the garbage
    collector frees such a circle, and the collector is off while a machine runs. An error that a frame is still
    handling, such as the end of the run, keeps its frames.
    """
    with suppress(BaseException):  # an exception of the user's may refuse anything
        trace = error.__traceback__
        if trace is not None:
            _clear(trace)
            error.__traceback__ = None
            _forget_causes(error)


class _MistakeText(str):
    """The text of an exception that comes from a mistake in a driver's code, with the exception and its frames."""

    __slots__ = ("error", "frames")
    error: BaseException
    frames: tuple[CodePlace, ...]

    def __reduce__(self) -> tuple[Any, ...]:  # the exception may not be picklable
        return str, (str(self),)


def cause_of_failure(error: BaseException) -> str:
    """Return the text of the cause of a failed call: a _MistakeText if the error comes from a mistake in the driver's
    code. The frames of the error are released, because a channel may fail again and again for a day."""
    cause = text_of(error)
    if not isinstance(error, UmoError | OSError) and (frames := frames_of_mistake(error)):
        cause = _MistakeText(cause)
        cause.error, cause.frames = error, frames
    forget_frames(error)
    return cause


def chained(error: DriverError) -> DriverError:
    """Return the error with its cause, if one of its failures comes from a mistake in a driver's code. Python then
    shows the lines of this code in the traceback."""
    mistakes = (each.cause for each in error.failures if isinstance(each.cause, _MistakeText))
    if (cause := next(mistakes, None)) is not None:
        shown = "".join(format_list([(*place, None) for place in cause.frames])).rstrip()
        if shown not in getattr(cause.error, "__notes__", ()):
            add_note(cause.error, shown)
        error.__cause__ = cause.error
    return error


def _forget_causes(error: BaseException) -> None:
    """Forget the frames of the causes of an error."""
    at_work: set[FrameType] | None = None
    waiting = _causes(error)
    while waiting:
        each = waiting.pop()
        trace = each.__traceback__
        if trace is None:
            continue
        if at_work is None:
            at_work = {frame for frame, _ in walk_stack(sys._getframe(1))}
        if trace.tb_frame not in at_work:
            _clear(trace)
            each.__traceback__ = None
            waiting += _causes(each)


def _causes(error: BaseException) -> list[BaseException]:
    several = error.exceptions if isinstance(error, BaseExceptionGroup) else ()
    return [each for each in (error.__cause__, error.__context__, *several) if each is not None]


_WAITING = opmap["YIELD_VALUE"]
"""The instruction at which a generator or coroutine waits."""


def _clear(trace: TracebackType) -> None:
    """Drop the variables of frames that have ended. Before Python 3.13, clearing a frame that waits ends its
    sequence."""
    each: TracebackType | None = trace
    while each is not None:
        frame = each.tb_frame
        each = each.tb_next
        if frame.f_code.co_code[frame.f_lasti] != _WAITING:
            try:  # noqa: SIM105  (`suppress` takes longer than what it does here)
                frame.clear()
            except RuntimeError:  # it still runs
                pass
