"""The outcome of a run as plain data, which is sent to other processes and determines the exit status."""

from __future__ import annotations

import json
import traceback
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import umo.errors as errors
from umo.errors import AcknowledgeRequired, Interrupted, NotAwaited, RecipeError, StopError, UmoError, WiringError
from umo.exit_status import ExitStatus
from umo.process.station import StationError
from umo.system.descriptors import TooFewDescriptors
from umo.system.signal_handling import signal_name
from umo.text import Moment, in_a_line, in_brackets, place_of, printable, str_of
from umo.user_code import as_json

USER_ERRORS = (
    errors.WiringError,
    errors.RecipeError,
    errors.DeclarationError,
    errors.OptionError,
    errors.PathError,
    errors.RangeError,
    errors.StateError,
    errors.DeviceHeld,
    errors.AcknowledgeRequired,
    StationError,
    errors.FramesError,
    errors.CommandRefused,
    TooFewDescriptors,
)
MAX_LENGTH = 12_000
"""Largest length of a traceback, a message or a result, in characters."""
MAX_BYTES = 60_000
"""Largest size of an outcome in bytes, on its way to another process."""
BOUNDS = ((100_000, MAX_LENGTH), (1000, 4000), (100, 400), (1, 40))
"""Pairs of the largest number of unreached actuators and the largest number of characters of each text that are passed
on. The first pair that fits is used."""


@dataclass
class Failed:
    """The error that ended a run."""

    name: str
    message: str
    status: int
    """Exit status, as in `ExitStatus`."""
    traceback: str = ""

    def cut(self, longest: int) -> Failed:
        return replace(self, message=self.message[:longest], traceback=self.traceback[-longest:])

    @classmethod
    def of(cls, error: BaseException) -> Failed:
        try:
            lines = "".join(traceback.format_exception(error))
        except BaseException:  # of an exception that cannot be shown
            lines = type(error).__name__
        return cls(type(error).__name__, message_of(error), status_of(error), lines).cut(MAX_LENGTH)


@dataclass
class Outcome:
    """The outcome of a control process. `unreached`: the actuators that are not at their defaults, by path."""

    failure: Failed | None = None
    stopped_by: int | None = None
    """The signal that requested the stop."""
    stopped_who: str = ""
    """The client that has requested the stop: the page, `umo do STATION stop`, or a program that is attached."""
    time_over: bool = False
    """True if the time limit (`umo run --until`) ended the run."""
    driven: bool = False
    """True if the machine was connected completely, with every object initialised."""
    unsafe: bool = False
    """True if the guardian had to reset the machine, or was lost before all actuators were at their defaults. The next
    run must acknowledge this."""
    unreached: list[str] = field(default_factory=list)
    reports: dict[str, Any] = field(default_factory=dict)
    """Reports of the drivers on their circuits or plants, by the driver's name, as plain data."""
    unkept: str = ""
    """The reason why the last kept values were not written, as text; empty if they were written or nothing is kept."""
    simulated: float = 0.0
    """The time in s on the cycle's clock at the end."""
    result: Any = None
    """The application's result, if it is plain data; otherwise its text."""

    @property
    def outputs(self) -> str:
        """The state, as text, of the outputs after a run that ended safely."""
        if self.driven:
            return "every actuator is at its default"
        return (
            "the run had not started: the outputs that it had reached are at their defaults, the others are unchanged"
        )

    @property
    def status(self) -> int:
        """The exit status: as in `ExitStatus`, or 128 plus the signal."""
        if self.unreached:
            return ExitStatus.UNREACHED
        if self.failure is not None:
            return self.failure.status
        if self.unkept:
            return ExitStatus.NOT_RECORDED
        if self.stopped_by is not None:
            return 128 + self.stopped_by
        return ExitStatus.TIME_OVER if self.time_over else ExitStatus.DONE

    @property
    def stopper(self) -> str:
        """The client or the signal that has requested the stop; "" if there was no request."""
        return "" if self.stopped_by is None else printable(self.stopped_who) or signal_name(self.stopped_by)

    @property
    def early_end(self) -> str:
        """A request to stop, or the time limit, that ended the run, as text; "" if neither did."""
        if self.stopper:
            return f"stopped by {self.stopper}"
        return f"ended at {self.simulated:g} s (--until)" if self.time_over else ""

    def dump(self) -> dict[str, Any]:
        """Return the outcome as plain data of at most `MAX_BYTES` bytes as JSON, whatever the result of the
        application. Long texts are cut, and if there are very many unreached actuators, only the first ones are
        named."""
        for most, longest in BOUNDS:
            data = vars(self) | {
                "failure": self.failure and asdict(self.failure.cut(longest)),
                "unreached": self.unreached[:most],
                "reports": plain_reports(self.reports, longest),
                "result": plain(self.result, longest),
            }
            if len(json.dumps(data)) <= MAX_BYTES:
                break
        return data

    def encode(self) -> bytes:
        return json.dumps(self.dump()).encode()

    @classmethod
    def decode(cls, text: bytes) -> Outcome | None:
        """Return the outcome that a string contains, or None if it contains none."""
        try:
            outcome = cls.load(json.loads(text))
            return outcome if isinstance(outcome.status, int) else None
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
            return None

    @classmethod
    def load(cls, data: dict[str, Any]) -> Outcome:
        data = dict(data)
        failure = data.pop("failure")
        return cls(failure=failure and Failed(**failure), **data)


def plain(result: Any, longest: int = MAX_LENGTH) -> Any:
    """Return a copy of plain data in the form of JSON, if its size is moderate; otherwise its text, cut."""
    return json.loads(as_json(result, longest))


def plain_reports(reports: Mapping[str, Any], longest: int = MAX_LENGTH) -> dict[str, Any]:
    """Return, as plain data, the reports of the drivers that have one, if their total size is moderate."""
    return {name: plain(report, longest // len(reports)) for name, report in reports.items() if report}


def status_of(failure: BaseException) -> int:
    """Return the exit status: before the run an error is a user's mistake; during the run it is a failure."""
    if isinstance(failure, StopError):
        return ExitStatus.UNREACHED
    if isinstance(failure, Interrupted):
        return 128 + failure.number
    is_mistake = isinstance(failure, USER_ERRORS) and not _moment(failure)
    return ExitStatus.MISTAKE if is_mistake else ExitStatus.FAILED


def message_of(failure: BaseException) -> str:
    """Return the failure, its time and its place in one line, and other failures in a second line. Each mistake in a
    wiring or in recipes, and each locked device, has a separate line."""
    if isinstance(failure, StopError) and failure.__cause__ is not None:
        return "\n".join([message_of(failure.__cause__).partition("\n")[0], in_a_line(str_of(failure))])
    text = str_of(failure)
    if not isinstance(failure, UmoError | Interrupted):
        text = f"{type(failure).__name__}: {text}" if text else type(failure).__name__
    first, _, more = text.partition("\n")
    tells_place = isinstance(failure, Interrupted | NotAwaited)
    first += in_brackets(_moment(failure), "" if tells_place else place_of(failure))
    if isinstance(failure, WiringError | RecipeError | AcknowledgeRequired) and more:
        return f"{first}\n{more}"
    others = [more, *(note for note in _notes(failure) if not isinstance(note, Moment))]
    return "\n".join(filter(None, [first, "; ".join(filter(None, map(in_a_line, others)))]))


def _notes(failure: BaseException) -> list[str]:
    return getattr(failure, "__notes__", [])


def _moment(failure: BaseException) -> str:
    """Return the time at which the failure ended the run, as text; empty before the first period."""
    return next((note for note in _notes(failure) if isinstance(note, Moment)), "")
