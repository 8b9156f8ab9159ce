"""A driver under test. Every call of the driver is observed and recorded as text."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from math import inf
from operator import index
from time import monotonic
from typing import Any, TypeVar

import numpy as np

from umo.drivers.contract import UNREAD, Channel, Driver, IntArray
from umo.errors import text_of
from umo.testing.conformance.closed_twice import Placeholders
from umo.testing.conformance.taps import Tap

T = TypeVar("T")


class NotingArray(np.ndarray[Any, Any]):
    """An array for readings that notes values which are stored in it and are no whole numbers."""

    cut: list[str]

    @classmethod
    def of(cls, count: int) -> NotingArray:
        """Return an array without readings."""
        array = np.full(count, UNREAD).view(cls)
        array.cut = []
        return array

    def __array_finalize__(self, other: Any) -> None:
        self.cut = getattr(other, "cut", [])  # a part of the array notes in the list of the whole

    def __setitem__(self, place: Any, value: Any) -> None:
        array = np.asarray(value)
        if self.dtype.kind in "iu" and array.size and array.dtype.kind not in "iub":
            self.cut.append(f"values of type {array.dtype}, such as {array.flat[0]}")
        super().__setitem__(place, value)


class Watch:
    """The call that the driver carries out now. Another thread watches the call to find out whether it hangs."""

    def __init__(self, line: Tap | None = None) -> None:
        self.line = line
        self.doing = "make the driver"
        self.began: float | None = None
        self.limit = 0.0
        """Timeout in s of the call that is in progress."""
        self.took = 0.0
        """Duration in s of the last call."""
        self.stopped = False
        """True if no further call may be made, because the user wants the kit to end."""
        self.until = inf
        """The time (`monotonic`) after which no further call may be made, because the time of the run is up."""
        self.over = False
        """True if no more calls may be made, because one did not return in time."""
        self.failed = ""
        """The last call if it has failed."""
        self.interrupted = False
        """True if a call has raised KeyboardInterrupt."""
        self.after: Callable[[str], object] | None = None
        """Function that is called after each call of the driver."""
        self.wrong_kind = ""
        """The first call that raised an exception other than an OSError."""
        self.wrong_type = ""
        """The first reading that is not an int within the bits of its channel."""
        self.beyond: str | None = None
        """The channel of the reading `wrong_type`, if that is an int beyond its bits."""

    def call(self, what: str, limit: float, function: Callable[..., T], *arguments: Any) -> T:
        """Call the driver with this timeout. OSErrors are passed on, with a note about the call; other exceptions are
        noted here and become OSErrors."""
        if self.over:
            raise Stopped
        if self.stopped:
            self.stopped = False  # the calls that tidy up are still to be made
            raise Stopped
        began = monotonic()
        if began > self.until:
            self.until = inf
            raise TimeUp
        self.doing, self.limit, self.began = what, limit, began
        try:
            found = function(*arguments)
            if self.line is not None and self.line.passes:
                self.line.disturbed = ""
            self.failed = ""
            return found
        except OSError as error:
            error.umo_call, error.umo_after = what, self._before(what)  # type: ignore[attr-defined]
            self.failed = what
            raise
        except KeyboardInterrupt:
            self.interrupted = True
            raise WrongKind("KeyboardInterrupt", what) from None
        except BaseException as error:
            self.wrong_kind = self.wrong_kind or f"{what} raised {text_of(error)}"
            before, self.failed = self._before(what), what
            raise WrongKind(text_of(error), what, before) from None
        finally:
            self.took = monotonic() - began
            self.began = None
            if self.after is not None:
                self.after(what)

    @contextmanager
    def placeholders(self) -> Iterator[Placeholders]:
        """Return a context in which each descriptor that becomes free by a call is occupied immediately."""
        held = Placeholders()
        self.after = held.look
        try:
            yield held
        finally:
            self.after = None
            held.release()

    def _before(self, what: str) -> str:
        """Return what the kit has disturbed before this call and passes now, or another call that has just failed."""
        disturbed = self.line.disturbed if self.line is not None and self.line.passes else ""
        return disturbed or (f"a {self.failed} that failed" if self.failed not in ("", what) else "")


class Stopped(BaseException):
    """Raised if the kit was asked to end."""


class TimeUp(Stopped):
    """Raised if the time of the run is over."""


class WrongKind(OSError):
    """Raised in place of an exception of the driver that is not an OSError. The exception is noted in the watch, and
    this error, an OSError, is handled like other failures."""

    def __init__(self, text: str, call: str, after: str = "") -> None:
        super().__init__(text)
        self.umo_call, self.umo_after = call, after


def call_of(error: OSError) -> str:
    """Return the call that raised the error, as text."""
    return getattr(error, "umo_call", "a call")


def disturbed_before(error: OSError) -> str:
    """Return a text about the disturbance that the kit made just before the call, or before an earlier call that
    failed; empty if there was none."""
    return getattr(error, "umo_after", "")


def failed(error: OSError) -> str:
    """Return a text about a call that had to succeed and has failed. It contains the error, and what happened just
    before the call: a disturbance by the kit, or another failed call."""
    after = disturbed_before(error)
    return f"{call_of(error)} failed{f', right after {after}' if after else ''}: {text_of(error)}"


class Probe:
    """The functions of one driver. Channels are given by their texts."""

    def __init__(self, driver: Driver[Any], watch: Watch) -> None:
        self.driver = driver
        self.watch = watch
        self.opened: list[str] = []
        """Channels that were initialised and not finalised."""
        self.levels: dict[str, int] = {}
        """The levels that successful calls wrote to the outputs last."""
        self._channels: dict[str, Channel] = {}
        self._whole: tuple[Channel, ...] = ()
        self._timeout = driver.timeout

    @property
    def timeout(self) -> float:
        """The timeout in s that was set here. The driver may use another timeout; this is not checked here."""
        return self._timeout

    @timeout.setter
    def timeout(self, seconds: float) -> None:
        self._timeout = self.driver.timeout = seconds

    def channel(self, text: str) -> Channel:
        """Return the channel of a text. The driver is asked for it only once, as umo does."""
        if text not in self._channels:
            self._channels[text] = self.call(f"channel({text!r})", self.driver.channel, text)
        return self._channels[text]

    def open(self) -> None:
        self.call("open", self.driver.open)

    def close(self) -> None:
        self.call("close", self.driver.close)

    def initialize(self, text: str, default: int | None) -> None:
        if text not in self.opened:
            self.opened.append(text)
        self._bring(text, default, f"initialize of {text}", self.driver.initialize)

    def finalize(self, text: str) -> None:
        if text in self.opened:
            self.opened.remove(text)
        self.call(f"finalize of {text}", self.driver.finalize, self.channel(text))

    def reset(self, text: str, default: int | None) -> None:
        self._bring(text, default, f"reset of {text}", self.driver.reset)

    def read(self, text: str) -> int:
        channel = self.channel(text)
        return self._checked(channel, self.call(f"read of {text}", self.driver.read, channel))

    def write(self, text: str, raw: int) -> None:
        self._bring(text, raw, f"write of {raw} to {text}", self.driver.write)

    def _bring(self, text: str, raw: int | None, what: str, function: Callable[..., None]) -> None:
        """Make a call that brings an output to a level. `raw` is None for an input."""
        self.levels.pop(text, None)
        self.call(what, function, self.channel(text), raw)
        if raw is not None:
            self.levels[text] = raw

    def read_many(self, texts: Sequence[str], out: IntArray | None = None) -> list[int]:
        """Read channels into `out`, or into an array like the one that umo passes."""
        channels = self._block(texts)
        out = NotingArray.of(len(texts)) if out is None else out
        self.call(f"read_many of {', '.join(texts)}", self.driver.read_many, channels, out)
        if isinstance(out, NotingArray) and out.cut:
            self._note(f"stored {out.cut[0]}; numpy cuts the fraction of a float")
        return [self._checked(channel, raw) for channel, raw in zip(channels, out.tolist(), strict=True)]

    def write_many(self, texts: Sequence[str], raws: Sequence[int] | IntArray) -> None:
        channels = self._block(texts)
        array = np.array(raws, np.int64) if not isinstance(raws, np.ndarray) else raws
        array = array.view()
        array.setflags(write=False)  # as the image hands it over
        raws = array.tolist()
        for text in texts:
            self.levels.pop(text, None)
        self.call(f"write_many to {', '.join(texts)}", self.driver.write_many, channels, array)
        self.levels |= zip(texts, raws, strict=True)

    def write_by(self, many: bool, text: str, raw: int) -> None:
        """Write one output, alone or as a block."""
        if many:
            self.write_many((text,), (raw,))
        else:
            self.write(text, raw)

    def _block(self, texts: Sequence[str]) -> tuple[Channel, ...]:
        """Return the channels of a block. It is the same object as long as the same block is transferred, as in a
        machine."""
        channels = tuple(map(self.channel, texts))
        if channels != self._whole:
            self._whole = channels
        return self._whole

    def call(self, what: str, function: Callable[..., T], *arguments: Any) -> T:
        """Call any function of the driver."""
        return self.watch.call(what, self.timeout, function, *arguments)

    def _checked(self, channel: Channel, raw: Any) -> int:
        try:
            value = index(raw)
        except TypeError:
            self._note(f"returned {raw!r}, a {type(raw).__name__}")
            return int(raw) if isinstance(raw, float) and raw.is_integer() else -(1 << 62)
        if type(raw) is not int:
            self._note(f"returned {raw!r}, a {type(raw).__name__}")
        elif not channel.lowest <= value <= channel.highest:
            if not self.watch.wrong_type:
                self.watch.beyond = channel.text
            self._note(f"returned {value}; {channel.text} has {channel.lowest} to {channel.highest}")
        return value

    def _note(self, words: str) -> None:
        """Record what is wrong with the reading of the last call."""
        self.watch.wrong_type = self.watch.wrong_type or f"{self.watch.doing} {words}"
