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
    """Makes drivers of the subject, and watches their calls."""

    def __init__(self, subject: Subject) -> None:
        self.subject = subject
        self.watch = Watch(subject.line)
        self.unreached: list[str] = []
        """Outputs that could not be brought to their defaults."""
        self.dirty = False
        """True if an output may be left at another level than its default: `restore` has something to do."""
        self._is_full = False
        """True if the device has refused a second driver."""

    def new(self, direct: bool = False) -> Probe:
        """Return a new driver that is not opened, and whose channels are known. `direct`: without the line, if the
        subject has such a driver."""
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
        """The timeout in s of a call that must succeed. umo sets the same timeout when it initialises and resets."""
        return max(UNCONTROLLED_TIMEOUT, self.subject.timeout)

    def bring_up(self, probe: Probe) -> None:
        """Open a driver and initialise its channels."""
        probe.open()
        for text in self.channels:
            probe.initialize(text, self.default(text))

    @contextmanager
    def opened(self, direct: bool = False) -> Iterator[Probe]:
        """Return a context with a new driver that is open and whose channels are initialised. The driver is closed at
        the end of the context."""
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
        """Reset and finalise the channels of a driver, and close it. `restore` tries failed calls again with a new
        driver. The first error is raised at the end."""
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
        """Bring an output to its default as the guardian does with a new driver: initialise it, then reset it."""
        probe.initialize(output.channel, output.default)
        probe.reset(output.channel, output.default)

    def ready(self, probe: Probe, text: str) -> None:
        """Initialise a channel with the driver that uses it, as umo does. If that fails, try once more. This brings an
        output to its default."""
        if text in probe.opened:
            return
        try:
            probe.initialize(text, self.default(text))
        except OSError:
            probe.opened.remove(text)
            raise

    def restore(self, always: bool = False) -> None:
        """Bring every output to its default that may be at another level, with a new driver."""
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
        """Return a context with another open driver of the device, whose outputs are not initialised. It yields None if
        the device accepts only one driver, which is tried only once."""
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
        """All channels, inputs first."""
        inputs = [each.channel for each in self.subject.inputs]
        return tuple(dict.fromkeys((*inputs, *self._defaults)))

    @cached_property
    def _defaults(self) -> dict[str, int]:
        return {output.channel: output.default for output in self.subject.outputs}

    def default(self, text: str) -> int | None:
        return self._defaults.get(text)

    @cached_property
    def readable(self) -> tuple[str, ...]:
        """The channels whose direction allows reading."""
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
