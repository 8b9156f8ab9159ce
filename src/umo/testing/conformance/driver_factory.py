"""Opens drivers of the subject, and brings the outputs back to their defaults."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cached_property
from typing import Any

from umo.cycle.segments import UNCONTROLLED_TIMEOUT
from umo.drivers.contract import Direction, Driver
from umo.testing.conformance.probe import Probe, Stopped, Watch
from umo.testing.conformance.subject import Output, Subject


class DriverFactory:
    """Makes drivers of the subject. What their calls do is watched."""

    def __init__(self, subject: Subject) -> None:
        self.subject = subject
        self.watch = Watch(subject.line)
        self.unreached: list[str] = []
        """Outputs that could not be brought to their defaults."""
        self.dirty = False
        """True if an output may be left at another level than its default: `restore` has something to do."""
        self._is_full = False
        """The device has turned away a second driver."""

    def new(self, direct: bool = False) -> Probe:
        """A new driver, not opened, whose channels are known; `direct`: without the line, if the subject can do so."""
        make = self.subject.direct if direct and self.subject.direct is not None else self.subject.make
        driver: Driver[Any] = self.watch.call("making the driver", self.patience, make)
        driver.period = self.subject.period
        probe = Probe(driver, self.watch)
        probe.timeout = self.patience
        for text in (*self.channels, *self.subject.refused):  # as umo does: all of them before `open`
            probe.channel(text)
        return probe

    @property
    def patience(self) -> float:
        """Return the timeout in s of a call that has to succeed, the same as umo sets when it initialises and
        resets."""
        return max(UNCONTROLLED_TIMEOUT, self.subject.timeout)

    def bring_up(self, probe: Probe) -> None:
        """Open a driver and initialise its channels."""
        probe.open()
        for text in self.channels:
            probe.initialize(text, self.default(text))

    @contextmanager
    def opened(self, direct: bool = False) -> Iterator[Probe]:
        """A new driver, open and with its channels initialised, which is closed at the end of the context."""
        with self.leaving(self.new(direct)) as probe:
            self.bring_up(probe)
            yield probe

    @contextmanager
    def leaving(self, probe: Probe) -> Iterator[Probe]:
        """Return a context at whose end the driver is reset and closed (`leave`). An error there does not replace an
        earlier exception."""
        try:
            yield probe
        except BaseException:
            with suppress(OSError, Stopped):
                self.leave(probe)
            raise
        self.leave(probe)

    def leave(self, probe: Probe) -> None:
        """Reset, finalise and close. Failed calls are tried again with a new driver by `restore`; the first error is
        raised at the end."""
        probe.timeout = self.patience
        errors: list[BaseException] = []

        def attempt(call: Callable[..., None], *arguments: Any) -> None:
            try:
                call(*arguments)
            except (OSError, Stopped) as error:
                self.dirty = True
                errors.append(error)

        initialised = list(probe.opened)
        for text in initialised:
            attempt(probe.reset, text, self.default(text))
        for text in reversed(initialised):
            attempt(probe.finalize, text)
        attempt(probe.close)
        if errors:
            raise errors[0]

    def bring_to_default(self, probe: Probe, output: Output) -> None:
        """Bring an output to its default as the guardian does with a new driver: initialised, then reset."""
        probe.initialize(output.channel, output.default)
        probe.reset(output.channel, output.default)

    def ready(self, probe: Probe, text: str) -> None:
        """Initialise a channel with the driver that uses it, as umo does, and once more if that fails. This brings an
        output to its default."""
        if text in probe.opened:
            return
        try:
            probe.initialize(text, self.default(text))
        except OSError:
            probe.opened.remove(text)
            raise

    def restore(self, always: bool = False) -> None:
        """A new driver brings every output to its default that may not be there."""
        if not (self.dirty or always) or not self.subject.outputs:
            return
        self.dirty = False
        self.unreached = left = [output.channel for output in self.subject.outputs]
        with suppress(OSError):
            probe = self.new()
            try:
                probe.open()
                for output in self.subject.outputs:
                    if self.failure(self.bring_to_default, probe, output) is None:
                        left = [text for text in left if text != output.channel]
            finally:
                probe.close()
        self.unreached = left

    @contextmanager
    def second(self, direct: bool = False) -> Iterator[Probe | None]:
        """Return another open driver of the device, with outputs that are not initialised; None if the device accepts
        only one driver, after one wait."""
        if self._is_full:
            yield None
            return
        probe = self.new(direct)
        try:
            try:
                probe.open()
                for each in self.subject.inputs:
                    probe.initialize(each.channel, None)
                for each in self.subject.inputs[:1]:
                    probe.read(each.channel)  # a device may let it in and then hang up
            except OSError:
                self._is_full = True
                yield None
            else:
                yield probe
        finally:
            self.failure(probe.close)

    # Channels -----------------------------------------------------------------------------------------

    @cached_property
    def channels(self) -> tuple[str, ...]:
        """Return all channels, inputs first."""
        inputs = [each.channel for each in self.subject.inputs]
        return tuple(dict.fromkeys((*inputs, *self._defaults)))

    @cached_property
    def _defaults(self) -> dict[str, int]:
        return {output.channel: output.default for output in self.subject.outputs}

    def default(self, text: str) -> int | None:
        return self._defaults.get(text)

    @cached_property
    def readable(self) -> tuple[str, ...]:
        """Channels whose direction allows reading."""
        probe = self.new()
        return tuple(text for text in self.channels if Direction.INPUT in probe.channel(text).direction)

    # Calls --------------------------------------------------------------------------------------------

    def failure(self, call: Callable[..., object], *arguments: Any) -> OSError | None:
        """Return the error of a call, or None if it succeeded."""
        try:
            call(*arguments)
        except OSError as error:
            return error
        return None
