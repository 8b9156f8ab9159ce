"""What a rule works with: open drivers of the subject, levels of its outputs as they are seen from outside, and the way
back to the defaults."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cached_property
from threading import Event, Thread
from time import monotonic, sleep
from typing import Any

from umo.cycle.transfer import PATIENCE
from umo.drivers.contract import Direction, Driver
from umo.testing.conformance.certificate import TransferTime
from umo.testing.conformance.probe import Probe, Stopped, Watch
from umo.testing.conformance.rules import NotTried, RuleBroken
from umo.testing.conformance.subject import Output, Subject
from umo.testing.conformance.taps import Tap
from umo.text import some

LOOK = 0.001
"""s between two looks at a level that has not come yet."""
NO_VIEW = "the level of no output can be seen: it needs a loop-back, or a channel that can be read back"
CONFIRMED = "every call succeeded, but no level can be seen: it needs a loop-back, or a channel that can be read back"
NO_LINE = "there is no line between driver and device that the kit can disturb"


class Trial:
    """The subject in use. `share` is how much of the present rule is done, for a progress line."""

    def __init__(self, subject: Subject, cycles: int) -> None:
        self.subject = subject
        self.cycles = cycles
        self.watch = Watch()
        self.share = 0.0
        self.times: dict[str, TransferTime] = {}
        self.unreached: list[str] = []
        """Outputs that could not be brought to their defaults."""
        self.kept: dict[str, Any] = {}
        """Results that several rules share."""
        self._dirty = False

    # Drivers -----------------------------------------------------------------------------------------

    def new(self, direct: bool = False) -> Probe:
        """A new driver, not opened, whose channels are known; `direct`: without the line, if the subject can do so."""
        make = self.subject.direct if direct and self.subject.direct is not None else self.subject.make
        driver: Driver[Any] = self.watch.call("making the driver", self.patience, make)
        driver.timeout, driver.period = self.patience, self.subject.period
        probe = Probe(driver, self.watch)
        for text in (*self.channels, *self.subject.refused):  # as umo does: all of them before `open`
            probe.channel(text)
        return probe

    @property
    def patience(self) -> float:
        """s that a call may take that is to succeed, as umo gives when it initialises and resets."""
        return max(PATIENCE, self.subject.timeout)

    @contextmanager
    def opened(self, direct: bool = False) -> Iterator[Probe]:
        """An open driver with its channels initialised. At the end its outputs are reset, its channels are finalised,
        and it is closed."""
        probe = self.new(direct)
        try:
            probe.open()
            for text in self.channels:
                probe.initialize(text, self.default(text))
            yield probe
        except BaseException:
            with suppress(OSError, Stopped):
                self.leave(probe)
            raise
        self.leave(probe)

    def leave(self, probe: Probe) -> None:
        """Reset, finalise and close. What fails is tried again with a new driver by `restore`; the first error is
        raised at the end."""
        probe.driver.timeout = self.patience
        errors: list[BaseException] = []

        def attempt(call: Callable[..., None], *arguments: Any) -> None:
            try:
                call(*arguments)
            except (OSError, Stopped) as error:
                self._dirty = True
                errors.append(error)

        initialised = list(probe.opened)
        for text in initialised:
            attempt(probe.reset, text, self.default(text))
        for text in reversed(initialised):
            attempt(probe.finalize, text)
        attempt(probe.close)
        if errors:
            raise errors[0]

    def restore(self, always: bool = False) -> None:
        """With a new driver: every output to its default, if it may not be there."""
        if not (self._dirty or always) or not self.subject.outputs:
            return
        self._dirty = False
        self.unreached = left = [output.channel for output in self.subject.outputs]
        with suppress(OSError):
            probe = self.new()
            try:
                probe.open()
                for output in self.subject.outputs:
                    if self.failure(probe.reset, output.channel, output.default) is None:
                        left = [text for text in left if text != output.channel]
            finally:
                probe.close()
        self.unreached = left

    def left_dirty(self) -> None:
        """`restore` has something to do: an output may be left at another level than its default."""
        self._dirty = True

    def hurry(self, probe: Probe) -> None:
        """Its calls have the subject's own timeout from now on."""
        probe.driver.timeout = self.subject.timeout

    # Channels ----------------------------------------------------------------------------------------

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
        """Channels whose direction allows reading."""
        probe = self.new()
        return tuple(text for text in self.channels if Direction.INPUT in probe.channel(text).direction)

    @property
    def steady(self) -> tuple[str, ...]:
        """Inputs that nothing drives and that do not change by themselves."""
        looped = {text for _, text in self.subject.loopbacks}
        return tuple(each.channel for each in self.subject.inputs if each.steady and each.channel not in looped)

    @cached_property
    def loops(self) -> dict[str, str]:
        return dict(self.subject.loopbacks)

    @cached_property
    def visible(self) -> tuple[Output, ...]:
        """Outputs whose level can be seen."""
        by = self.loops.keys() if self.subject.levels is None else self._defaults.keys()
        return tuple(each for each in self.subject.outputs if each.channel in by or each.channel in self.readable)

    @property
    def seen(self) -> tuple[Output, ...]:
        """As `visible`; NotTried if there is none."""
        if not self.subject.outputs:
            raise NotTried("the driver has no outputs")
        if not self.visible:
            raise NotTried(NO_VIEW)
        return self.visible

    @property
    def remark(self) -> str | None:
        """Which outputs the rule could not see."""
        unseen = [each.channel for each in self.subject.outputs if each not in self.visible]
        return f"except {some(unseen)}, whose level cannot be seen" if unseen else None

    def looked(self) -> str | None:
        """As `remark`, at the end of a rule whose calls succeeded; NotTried if it could see none of the outputs."""
        if self.subject.outputs and not self.visible:
            raise NotTried(CONFIRMED)
        return self.remark

    # Levels ------------------------------------------------------------------------------------------

    def level(self, probe: Probe, output: Output) -> int:
        """The level that the output has now: as the counterpart records it, at its loop-back, or read back."""
        if self.subject.levels is not None:
            return self.subject.levels(output.channel)[-1]
        view = self.loops.get(output.channel, output.channel)
        if view not in probe.opened:
            probe.initialize(view, self.default(view))
        return probe.read(view)

    def is_at(self, probe: Probe, output: Output, raw: int) -> bool:
        """Whether the output comes to this level within `settle`; sets `last_level`."""
        end = monotonic() + self.subject.settle
        while True:
            self.last_level = self.level(probe, output)
            if self.same(output, raw, self.last_level):
                return True
            if monotonic() >= end:
                return False
            sleep(LOOK)

    def is_read(self, probe: Probe, output: Output, raw: int) -> bool:
        """As `is_at`, of what the driver under test reads at the output's loop-back."""
        end = monotonic() + self.subject.settle
        while not self.same(output, raw, probe.read(self.loops[output.channel])):
            if monotonic() >= end:
                return False
            sleep(LOOK)
        return True

    def alike(self, text: str, before: int, now: int) -> bool:
        """Whether two readings of a channel mean one level: they are equal, or those of a loop-back agree with a level
        of its output."""
        if before == now or self.subject.agree is None:
            return before == now
        return any(
            self.same(output, raw, before) and self.same(output, raw, now)
            for output in self.subject.outputs
            if self.loops.get(output.channel) == text
            for raw in (*output.inner, output.default)
        )

    def fallen(self, text: str, found: int) -> bool:
        """Whether the device itself has brought an output to its default, as a watchdog does while a line is silent: a
        new driver, without the line, reads that too."""
        shown = [each for each in self.subject.outputs if self.loops.get(each.channel, each.channel) == text]
        if self.subject.direct is None or not any(self.same(each, each.default, found) for each in shown):
            return False
        probe = self.new(direct=True)
        try:
            probe.open()
            return self.alike(text, found, probe.read(text))
        except OSError:
            return False
        finally:
            with suppress(OSError):
                probe.close()

    def same(self, output: Output, raw: int, level: int) -> bool:
        """Whether a level that was seen is the output's raw one."""
        through = self.loops.get(output.channel)
        if through is None or self.subject.agree is None:
            return raw == level
        return self.subject.agree(output.channel, raw, through, level)

    def expect(self, probe: Probe, output: Output, raw: int, after: str) -> None:
        """RuleBroken if the output is not at this level."""
        if not self.is_at(probe, output, raw):
            raise RuleBroken(f"{output.channel} is at {self.last_level} after {after}, not at {raw}")

    @contextmanager
    def observing(self, output: Output, until: int) -> Iterator[list[int]]:
        """The levels that an output had within the block, in the list after its end; the first is the level before.
        A loop-back is watched on, until it shows the level `until`. Empty if only the driver under test can see it."""
        found: list[int] = []
        if self.subject.levels is not None:
            self.subject.levels(output.channel)
            yield found
            found += self.subject.levels(output.channel)
        elif output.channel in self.loops:
            with self._polling(self.loops[output.channel], found):
                yield found
                end = monotonic() + self.subject.settle
                while found and not self.same(output, until, found[-1]) and monotonic() < end:
                    sleep(LOOK)
        else:
            yield found

    @contextmanager
    def _polling(self, text: str, found: list[int]) -> Iterator[None]:
        """A second driver reads the input as quickly as it can; nothing if the device does not let it in."""
        probe, end = self.new(), Event()
        probe.watch = Watch()  # of another thread
        try:
            probe.open()
            probe.initialize(text, None)
            found.append(probe.read(text))
        except OSError:
            with suppress(OSError):
                probe.close()
            found.clear()
            yield
            return

        def poll() -> None:
            with suppress(OSError):
                while not end.is_set():
                    if (level := probe.read(text)) != found[-1]:
                        found.append(level)

        thread = Thread(target=poll, name="umo loop-back", daemon=True)
        thread.start()
        try:
            yield
        finally:
            end.set()
            thread.join(self.patience)
            with suppress(OSError):
                probe.finalize(text)
                probe.close()

    # Failures ----------------------------------------------------------------------------------------

    @property
    def line(self) -> Tap:
        """NotTried without one."""
        if self.subject.line is None:
            raise NotTried(NO_LINE)
        return self.subject.line

    @property
    def loss(self) -> Callable[[], Any]:
        """A function of a context in which the device is away; NotTried if the kit cannot take it away."""
        return self.subject.gone or self.line.gone

    def failure(self, call: Callable[..., object], *arguments: Any) -> OSError | None:
        """The error of a call, None if it succeeded."""
        try:
            call(*arguments)
        except OSError as error:
            return error
        return None

    @contextmanager
    def own_error_first(self) -> Iterator[None]:
        """For the tidying up in a `finally`: an error of it does not replace one that is on its way."""
        on_its_way = sys.exception()
        try:
            yield
        except (OSError, Stopped):
            if on_its_way is None:
                raise

    def fail_some(self, probe: Probe) -> None:
        """Calls that fail, by whatever means there are; NotTried without any."""
        if self.subject.refused:
            self.failure(probe.write, self.subject.refused[0], 0)
            self.failure(probe.read, self.subject.refused[0])
        elif self.subject.line is None and self.subject.gone is None:
            raise NotTried(f"no call can be made to fail: {NO_LINE}, and no channel that the device refuses")
        self.hurry(probe)
        away = self.subject.gone if self.subject.line is None else self.subject.line.silent
        if away is not None:
            with away():
                for call, arguments in self.transfers(probe, default=False)[::3]:  # a read and a write
                    self.failure(call, *arguments)

    def transfers(self, probe: Probe, default: bool = True) -> list[tuple[Callable[..., object], tuple[Any, ...]]]:
        """One call of each kind: its function and arguments. Outputs are written their defaults, or other levels."""
        found: list[tuple[Callable[..., object], tuple[Any, ...]]] = []
        if self.readable:
            found += [(probe.read, (self.readable[0],)), (probe.read_many, (self.readable,))]
        if outputs := self.subject.outputs:
            texts = [each.channel for each in outputs]
            raws = [each.default if default else each.other() for each in outputs]
            found += [(probe.write, (texts[0], raws[0])), (probe.write_many, (texts, raws))]
            found += [(probe.reset, (texts[-1], outputs[-1].default))]
        return found
