"""The second signal that requests a stop, and each further signal, ends code that does not end by itself. A signal may
come at any time. The frames of the main thread show what it interrupts:

- The user's code (control, a sequence, a condition, an observer, `setup`, a loop of a program) is interrupted
  immediately: `Interrupted` is raised in it. The outputs are then reset, as after any error.
- Code of umo, or a call of a driver, that the user's code has called is not interrupted. The user's code is interrupted
  as soon as this call returns to it.
- A call of a driver, including a reset, is interrupted only when it hangs, that is, if the same call is still in
  progress when a signal comes `limit` s after an earlier signal. The call counts as failed.
- All other code belongs to umo and ends by itself.

Code that catches `Interrupted` and continues is interrupted again by each signal. After `MAX_RAISED` interruptions the
outputs are reset in the middle of this code, and the process ends. Further signals interrupt only a hanging call of
this reset.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from enum import Enum, auto
from functools import lru_cache
from time import monotonic
from types import FrameType, TracebackType
from typing import Any, NamedTuple, NoReturn

from umo.errors import Interrupted
from umo.exit_status import ExitStatus
from umo.system.processes import flush
from umo.system.signal_handling import handling
from umo.system.streams import say_without_waiting
from umo.text import COMMAND, LIBRARY, STATIONS, UMO, in_brackets, place_among, printable, some

CALL_MARGIN = 1.0
"""Time in s that a call of a driver may take in addition to twice its timeout, before a signal ends it."""
SIMULATED_CALL_LIMIT = 0.25
"""Time in s that a call may take if no driver has a device."""
MAX_RAISED = 2
"""Number of times that code may catch an `Interrupted` and continue."""
STOPPING, HANDLER = f"{UMO}cycle{os.sep}stopping.py", "_caught"
"""File and name of the handler of signals."""
LOOPS = ("cycle/run.py", "cycle/connect.py", "objects/presentation/", "plant/twin/")
"""The files of umo whose functions end by themselves, some of them after a stop was requested. Code that calls these
functions is not interrupted."""
ROOMS = ("control", "cycle", "drivers", "objects", "operation", "plant", "testing", "user_code.py", "wiring")
"""The packages of umo that the user's code calls while a machine is connected. Code of the other packages ends by
itself."""
DRIVERS = ("drivers/", "plant/", "testing/virtual.py", "testing/scripted.py")
"""Files of umo's drivers."""
CALLERS = tuple(
    f"cycle/{name}.py"
    for name in ("drivers_away", "image", "off_cycle", "phase_times", "segments", "stand_ins", "transfer")
)
"""Files of umo from which drivers are called."""
INSTALLED = ("numpy", "pint", "typer", "click", "rich", "pydantic", "_pytest", "pluggy", "coverage")
"""Folders of installed packages, which have no code of a machine."""


class Side(Enum):
    """The owner of the code in a file: user or umo."""

    USER = auto()
    LIBRARY = auto()
    """The code belongs to Python, or to a package that does not use machines. It counts as part of its caller."""
    UMO = auto()
    DRIVER = auto()
    """Code of umo's drivers."""
    CALLER = auto()
    """Code of umo that calls drivers."""
    LOOP = auto()
    """Code of umo that checks for a stop."""


@lru_cache(maxsize=4096)
def side_of(file: str) -> Side:
    """Return the side of a file of code."""
    if file.startswith(COMMAND):
        return Side.LOOP
    if file.startswith(UMO) and not file.startswith(STATIONS):
        name = file[len(UMO) :].replace(os.sep, "/")
        if name.startswith(LOOPS) or not name.startswith(ROOMS):
            return Side.LOOP
        return Side.CALLER if name in CALLERS else Side.DRIVER if name.startswith(DRIVERS) else Side.UMO
    installed = f"{os.sep}site-packages{os.sep}"
    if file.startswith(("<frozen ", "<string>")) or (file.startswith(LIBRARY) and installed not in file):
        return Side.LIBRARY
    package = file.rpartition(installed)[2].partition(os.sep)[0] if installed in file else ""
    return Side.LIBRARY if package in INSTALLED else Side.USER


def _side(frame: FrameType) -> Side:
    """Return the side of a frame. A program that was given as a text (`python -c`) is the user's, although its file has
    the same name as code that Python generates, such as the constructors of dataclasses."""
    file = frame.f_code.co_filename
    if file == "<string>" and frame.f_code.co_name == "<module>":
        return Side.USER
    return side_of(file)


class MainThreadPlace(NamedTuple):
    """The place of the main thread."""

    code: FrameType | None
    """Frame of the user's code that may be interrupted, or None if there is none."""
    at_once: bool
    """True if no function of umo that the user's code has called is still in progress."""
    call: FrameType | None
    """The outermost frame of the call of a driver that is in progress, or None if there is no such call."""


def standing_of(frame: FrameType | None, is_leaving: bool = False) -> MainThreadPlace:
    """Return the place of a thread, by its innermost frame. `is_leaving`: the outputs are being reset in the middle of
    the user's code; then only calls of drivers within the reset are considered."""
    within: list[FrameType] = []  # frames that are not umo's, up to one that is
    call: FrameType | None = None
    inner: FrameType | None = None
    at_once, frame = True, frame if is_leaving else _interrupted(frame)
    while frame is not None:
        if is_leaving and frame.f_code is StopSignals._end.__code__:
            return MainThreadPlace(None, False, None)
        side = _side(frame)
        is_called = inner is not None and _side(inner) in (Side.USER, Side.LIBRARY, Side.DRIVER)
        if side in (Side.USER, Side.LIBRARY):
            within.append(frame)
        else:
            own = _users(within)
            if side in (Side.CALLER, Side.DRIVER):
                if side is Side.CALLER and is_called:
                    call = call or inner
            elif own is not None:
                return MainThreadPlace(own, at_once and call is None, call)
            if side is Side.LOOP:
                return MainThreadPlace(None, False, call)
            within, at_once = [], False
        frame, inner = frame.f_back, frame
    own = _users(within)
    return MainThreadPlace(own, at_once and call is None and own is not None, call)


def _interrupted(frame: FrameType | None) -> FrameType | None:
    """Return the frame that the handler of signals has interrupted. A signal may also interrupt the handler of another
    signal."""
    found = frame
    while frame is not None:
        if frame.f_code.co_name == HANDLER and frame.f_code.co_filename == STOPPING:
            found = frame.f_back
        frame = frame.f_back
    return found


def _users(frames: Iterable[FrameType]) -> FrameType | None:
    """Return the innermost frame of the user's code among these frames, or None."""
    return next((each for each in frames if _side(each) is Side.USER), None)


def place_within(frame: FrameType | None, until: FrameType | None) -> str:
    """Return the place in the user's code between a frame and an outer frame, such as `control.py:41 in control`; "" if
    there is none."""
    found = []
    while frame is not None:
        found.append((frame.f_code.co_filename, frame.f_lineno, frame.f_code.co_name))
        frame = None if frame is until else frame.f_back
    return place_among(reversed(found))


def call_limit(timeouts: Sequence[float]) -> float:
    """Return the time in s after which a call of a driver counts as hanging. `timeouts`: timeouts in s of the drivers
    that have devices."""
    return CALL_MARGIN + 2 * max(timeouts) if timeouts else SIMULATED_CALL_LIMIT


@contextmanager
def asked_by_signals(ask: Callable[[], object]) -> Iterator[None]:
    """Return a context for a server program without outputs: SIGINT and SIGTERM call `ask` to stop it. A further signal
    raises `Interrupted` at the present line."""
    asked = False

    def handler(number: int, frame: FrameType | None) -> None:
        nonlocal asked
        if asked:
            raise Interrupted(f"it does not end{_at(place_within(frame, None))}", number)
        asked = True
        ask()

    with handling(handler, (signal.SIGINT, signal.SIGTERM)):
        yield


class SignalledMachine(NamedTuple):
    """The data about a connected machine that the handling of a signal needs."""

    limit: float
    """Time in s after which a call of one of its drivers counts as hanging."""
    leave: Callable[[], Sequence[str]]
    """The function that brings the outputs of the machine to their defaults immediately, and returns the paths of
    outputs that were not reached."""


class StopSignals:
    """The signals from the first one, which has requested the machines of this process to stop, until they have
    stopped."""

    def __init__(self, clock: Callable[[], float] = monotonic) -> None:
        self._clock = clock
        self._call: FrameType | None = None
        """The call of a driver that was active at an earlier signal, and the time of this signal."""
        self._since = 0.0
        self._raised = 0
        self._is_leaving = False

    def begin(self, frame: FrameType | None, machines: Sequence[SignalledMachine]) -> None:
        """Handle the first signal. Print immediately what the stop waits for. `machines`: the machines whose code
        further signals end; empty if a guardian does this."""
        standing = standing_of(frame)
        self._find_call(standing)
        if not machines:
            return
        if standing.call is not None and place_within(frame, standing.call):  # not umo's own, as the wait for a tick
            _tell_call(frame, standing.call, _limit(machines))
        elif standing.code is not None:
            place = place_within(frame, standing.code)
            say_without_waiting(printable(f"umo: asked to stop; {place} is in progress: a second Ctrl-C ends it"))
        else:
            say_without_waiting("umo: asked to stop; a second Ctrl-C ends code that does not end by itself")

    def insist(self, number: int, frame: FrameType | None, machines: Sequence[SignalledMachine]) -> None:
        """Handle a further signal."""
        standing, limit = standing_of(frame, self._is_leaving), _limit(machines)
        if standing.call is not None:
            if self._find_call(standing) >= limit:
                place = place_within(frame, standing.call)
                self._end(number, f"a call of a driver does not end{_at(place)}", machines)
            _tell_call(frame, standing.call, limit)
        if standing.code is None or self._is_leaving:
            return
        code, place = standing.code, place_within(frame, standing.code)

        def end() -> NoReturn:
            where = place if standing.at_once else place_within(code, code)
            self._end(number, f"the application does not end{_at(where)}", machines)

        if standing.at_once:
            end()
        _at_return(code, end)

    def _find_call(self, standing: MainThreadPlace) -> float:
        """Return the time in s since a signal first found the active call of a driver."""
        if standing.call is not self._call:
            self._call, self._since = standing.call, self._clock()
        return self._clock() - self._since

    def _end(self, number: int, what: str, machines: Sequence[SignalledMachine]) -> NoReturn:
        """Raise `Interrupted`, or end the process if the user's code has caught `Interrupted` too often."""
        self._raised += 1
        if self._raised > MAX_RAISED and not self._is_leaving:
            self._is_leaving = True
            _leave_and_exit(number, what, machines)
        tell_in_a_line()
        raise Interrupted(what, number)


def _limit(machines: Sequence[SignalledMachine]) -> float:
    """Return the time in s after which a call of a driver of these machines counts as hanging."""
    return max((each.limit for each in machines), default=0.0)


def _tell_call(frame: FrameType | None, call: FrameType, limit: float) -> None:
    """Report that a call of a driver is in progress and that this signal does not end the call."""
    what = f"a call of a driver is in progress{in_brackets(place_within(frame, call))}"
    say_without_waiting(printable(f"umo: {what}; if it has not ended in {limit:.2g} s, a signal ends it"))


def _at(place: str) -> str:
    return place and f": {place}"


def _at_return(frame: FrameType, call: Callable[[], NoReturn]) -> None:
    """Call the function as soon as the next line of this frame begins or the frame returns. A debugger that traces this
    thread stops tracing."""

    def trace(frame: FrameType, event: str, argument: Any) -> NoReturn:
        call()

    frame.f_trace = trace
    sys.settrace(lambda *_: None)


def _leave_and_exit(number: int, what: str, machines: Sequence[SignalledMachine]) -> NoReturn:
    """Bring all outputs to their defaults in the middle of the user's code, print this, and end this process."""
    left: list[str] = []
    for each in machines:
        try:
            left += each.leave()
        except BaseException as error:
            left.append(f"all outputs of a machine ({type(error).__name__})")
    end = f"not reached: {some(left)}" if left else "every actuator is at its default"
    flush()
    say_without_waiting(printable(f"umo: {what}, and it catches the exception that should end it; {end}"))
    os._exit(ExitStatus.UNREACHED if left else 128 + number)


def tell_in_a_line() -> None:
    """Change the end of a program that `Interrupted` ends: it prints one line instead of a traceback, and its exit
    status is that of the signal. It also prints a line if `Interrupted` has ended a `__del__`, from which no exception
    can be raised."""
    former = sys.excepthook
    if getattr(former, "tells_interrupted", False):
        return

    def hook(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
        if not isinstance(error, Interrupted):
            former(kind, error, trace)
            return
        notes = ", ".join(getattr(error, "__notes__", ()))
        flush()
        print(printable(f"umo: {error}{in_brackets(notes)}"), file=sys.stderr)
        raise SystemExit(128 + error.number)

    hook.tells_interrupted = True  # type: ignore[attr-defined]
    sys.excepthook = hook
    ignored = sys.unraisablehook

    def tell_ignored(unraisable: sys.UnraisableHookArgs) -> None:
        if isinstance(unraisable.exc_value, Interrupted):
            say_without_waiting(printable(f"umo: {unraisable.exc_value}; it was interrupted there"))
        else:
            ignored(unraisable)

    sys.unraisablehook = tell_ignored
