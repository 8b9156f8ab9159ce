"""What a rule works with: open drivers of the subject, levels of its outputs as they are seen from outside, and the way
back to the defaults."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import cached_property
from math import inf
from threading import Event, Thread
from time import monotonic, sleep
from typing import Any

from umo.cycle.transfer import PATIENCE
from umo.drivers.contract import Direction, Driver
from umo.testing.conformance.budget import Budget, CallTime
from umo.testing.conformance.certificate import TransferTime
from umo.testing.conformance.probe import Probe, Stopped, Watch, call_of
from umo.testing.conformance.process import state, threads
from umo.testing.conformance.rules import NotTried, RuleBroken
from umo.testing.conformance.subject import Output, Subject
from umo.testing.conformance.taps import Change, Tap, Traffic
from umo.text import reported, some

MEASURED = 3
LOOK = 0.001
"""s between two looks at a level that has not come yet."""
HASTE_LEAST = 0.2
"""s: no shorter timeout is chosen by the kit itself."""
HASTE = 10
"""Answers, by the time that the slowest of a few took, which a call that must time out waits for at least."""
STEPS = 0.02
"""Part of a range: a level that is no further off may be a step of the device."""
NO_VIEW = "the level of no output can be seen: it needs a loop-back, or a channel that can be read back"
CONFIRMED = "every call succeeded, but no level can be seen: it needs a loop-back, or a channel that can be read back"
NO_LINE = "there is no line between driver and device that the kit can disturb"


class Trial:
    """The subject in use. `share` is how much of the present rule is done, for a progress line."""

    def __init__(self, subject: Subject, cycles: int | None = None, budget: Budget | None = None) -> None:
        self.subject = subject
        self.cycles = cycles
        self.budget = budget if budget is not None else Budget(inf, ())
        self.pace = CallTime()
        self.haste = subject.timeout
        """s: the timeout of calls that must time out."""
        self.watch = Watch()
        self.share = 0.0
        self.times: dict[str, TransferTime] = {}
        self.unreached: list[str] = []
        """Outputs that could not be brought to their defaults."""
        self.kept: dict[str, Any] = {}
        """Results that several rules share."""
        self.threads: frozenset[int] = frozenset()
        """Threads of the process that are older than the first driver."""
        self.before: dict[str, object] = {}
        """The process, as it was before the first driver."""
        self._dirty = False
        self._is_full = False
        """The device has turned away a second driver."""

    def begin(self) -> None:
        """Note what is there before the first driver."""
        self.before = state()
        self.threads = frozenset(threads())

    def measure(self) -> None:
        """What a few calls take: sets `pace`, and `haste` for a device that answers much quicker than the timeout."""
        began = monotonic()
        taken = []
        with self.opened() as probe:
            for call, arguments in self.transfers(probe) * MEASURED:
                call(*arguments)
                taken.append(self.watch.took)
        opening = monotonic() - began - sum(taken)
        self.haste = min(self.subject.timeout, max(HASTE_LEAST, HASTE * max(taken, default=0.0)))
        mean = sum(taken) / max(1, len(taken))
        self.pace = CallTime(opening, mean, self.haste, max(1, len(self.channels)))

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

    @contextmanager
    def second(self, direct: bool = False) -> Iterator[Probe | None]:
        """Another open driver of the device, whose outputs were not initialised; None if there is room for one, which
        is waited for once."""
        if self._is_full:
            yield None
            return
        probe = self.new(direct)
        try:
            try:
                probe.open()
                for each in self.subject.inputs:
                    probe.initialize(each.channel, None)
            except OSError:
                self._is_full = True
                yield None
            else:
                yield probe
        finally:
            self.failure(probe.close)

    def dead(self) -> str:
        """Why the device cannot be used at all; empty if it can."""
        probe, doing = self.new(), ""
        try:
            probe.open()
            for text in self.channels:
                probe.initialize(text, self.default(text))
            for call, arguments in self.transfers(probe):
                call(*arguments)
                doing = self.watch.doing
        except OSError as error:
            missing = self.subject.line.missing if self.subject.line is not None else ""
            what = f"{call_of(error)} failed: {reported(error)}"
            if missing:
                return f"the device is not there: {missing} ({what})"
            return what if doing else f"the device does not answer: {what}"
        finally:
            with suppress(OSError):
                self.leave(probe)
        return ""

    def left_dirty(self) -> None:
        """`restore` has something to do: an output may be left at another level than its default."""
        self._dirty = True

    def hurry(self, probe: Probe) -> None:
        """Its calls have a timeout that is waited for from now on."""
        probe.driver.timeout = self.haste

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

    @property
    def known(self) -> tuple[str, ...]:
        """Channels that read the same as long as the kit changes nothing: steady inputs, and levels of outputs."""
        return tuple(dict.fromkeys((*(self.view(each) for each in self.viewed), *self.steady)))

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

    def remark(self, *more: str) -> str | None:
        """Which outputs the rule could not see, and what else it says."""
        unseen = [each.channel for each in self.subject.outputs if each not in self.visible]
        words = [f"except {some(unseen)}, whose level cannot be seen"] if unseen else []
        return "; ".join((*words, *more)) or None

    def looked(self) -> str | None:
        """As `remark`, at the end of a rule whose calls succeeded; NotTried if it could see none of the outputs."""
        if self.subject.outputs and not self.visible:
            raise NotTried(CONFIRMED)
        return self.remark()

    def spare(self, rule: str, left: Sequence[str]) -> None:
        """Note what a rule left out for want of time."""
        if left:
            self.budget.spent.append(f"{rule}: {'; '.join(left)}")

    # Levels ------------------------------------------------------------------------------------------

    def view(self, output: Output) -> str:
        """The channel that shows the level of an output: its loop-back, or itself."""
        return self.loops.get(output.channel, output.channel)

    @cached_property
    def viewed(self) -> tuple[Output, ...]:
        """Outputs whose level the driver can read."""
        return tuple(each for each in self.subject.outputs if self.view(each) in self.readable)

    def reading(self, probe: Probe, output: Output) -> int:
        """What the driver reads of the level of an output."""
        view = self.view(output)
        if view not in probe.opened:
            probe.initialize(view, self.default(view))
        return probe.read(view)

    def level(self, probe: Probe, output: Output) -> int:
        """The level that the output has now: as the counterpart records it, or else as the driver reads it."""
        if self.subject.levels is not None:
            return self.subject.levels(output.channel)[-1]
        return self.reading(probe, output)

    def comes_to(self, look: Callable[[], int], right: Callable[[int], bool]) -> tuple[bool, int]:
        """Whether the look finds a right level within `settle`, and what it found last."""
        end = monotonic() + self.subject.settle
        while not right(found := look()):
            if monotonic() >= end:
                return False, found
            sleep(LOOK)
        return True, found

    def is_at(self, probe: Probe, output: Output, raw: int) -> bool:
        """Whether the output comes to this level within `settle`; sets `last_level`."""
        there, self.last_level = self.comes_to(
            lambda: self.level(probe, output), lambda level: self.same(output, raw, level)
        )
        return there

    def is_read(self, probe: Probe, output: Output, raw: int) -> bool:
        """As `is_at`, of what the driver reads; sets `last_level`."""
        there, self.last_level = self.comes_to(
            lambda: self.reading(probe, output), lambda level: self.same(output, raw, level)
        )
        return there

    def arrive(self, other: Probe | None, output: Output, raw: int) -> None:
        """Returns when the level has come for sure, seen without the driver under test: by the counterpart's record,
        by another driver; else after `settle`."""
        if self.subject.levels is not None:
            record = self.subject.levels
            self.comes_to(lambda: record(output.channel)[-1], lambda level: self.same(output, raw, level))
        if other is not None:
            self.is_read(other, output, raw)
        elif self.subject.levels is None or self.view(output) != output.channel:
            sleep(self.subject.settle)

    def alike(self, text: str, before: int, now: int) -> bool:
        """Whether two readings of a channel mean one level: they are equal, or those of a loop-back agree with a level
        of its output."""
        if before == now or self.subject.agree is None:
            return before == now
        return any(
            self.same(output, raw, before) and self.same(output, raw, now)
            for output in self.subject.outputs
            if self.view(output) == text
            for raw in (*output.inner, output.default)
        )

    def fallen(self, text: str, found: int) -> bool:
        """Whether the device itself has brought an output to its default, as a watchdog does while a line is silent: a
        new driver, without the line, reads that too."""
        shown = [each for each in self.subject.outputs if self.view(each) == text]
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
        if raw == level or self.subject.agree is None:
            return raw == level
        views = {self.view(output)}
        if self.subject.levels is not None:  # what records them has the output's own scale
            views.add(output.channel)
        return any(self.subject.agree(output.channel, raw, view, level) for view in views)

    def expect(self, probe: Probe, output: Output, raw: int, after: str) -> None:
        """RuleBroken if the output is not at this level, or is not read so."""
        if self.subject.levels is not None and not self.is_at(probe, output, raw):
            text = f"{output.channel} is at {self.last_level} after {after}, not at {raw}"
            raise RuleBroken(text + self._hint(output, raw), f"level of {output.channel}")
        if output in self.viewed and not self.is_read(probe, output, raw):
            view, found = self.view(output), self.last_level
            if self.subject.levels is not None:
                text = f"{view} reads {found}; {output.channel} is at {raw}, as it should be after {after}"
                raise RuleBroken(text + self._hint(output, raw), f"reading of {view}")
            of = "" if view == output.channel else f", which shows {output.channel},"
            text = f"{view}{of} reads {found} after {after}, not {raw}"
            raise RuleBroken(text + self._hint(output, raw), f"level of {output.channel}")

    def _hint(self, output: Output, raw: int) -> str:
        """For a device that has steps."""
        off, width = abs(self.last_level - raw), output.greatest - output.least
        if self.subject.agree is None and width >= 1 / STEPS and off <= max(1.0, STEPS * width):
            return " (if the device has steps or noise, say what agrees: `agree` of the subject, --tolerance)"
        return ""

    @contextmanager
    def observing(self, output: Output, until: int) -> Iterator[list[int]]:
        """The levels that an output had within the block, in the list after its end; the first is the level before.
        A loop-back is watched on, until it shows the level `until`. Empty if only the driver under test can see it."""
        found: list[int] = []
        if self.subject.levels is not None:
            self.subject.levels(output.channel)
            yield found
            found += self.subject.levels(output.channel)
        elif output.channel in self.loops and (self.subject.line is None or self.subject.line.ordered):
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

    def unanswered(self, call: Callable[..., object], *arguments: Any) -> tuple[OSError | None, bool]:
        """A call whose answer gets lost: its error, and whether there was an answer."""
        line = self.line
        before = line.spoiled
        with line.silent():
            error = self.failure(call, *arguments)
            lost = line.await_answer(before) if error is None else line.spoiled > before
        return error, lost

    def spoiled(self, change: Change, hangup: bool, call: Callable[..., Any], *arguments: Any) -> tuple[Any, bool]:
        """A call whose answer is changed: what it returned or raised, and whether there was an answer to change."""
        line = self.line
        before = line.spoiled
        with line.spoiling(change, hangup=hangup):
            try:
                found = call(*arguments)
            except OSError as error:
                found = error
            changed = line.await_answer(before) if not isinstance(found, OSError) else line.spoiled > before
        return found, changed

    def traffic(self, call: Callable[..., object], *arguments: Any) -> Traffic:
        """What a call that succeeds sends and gets."""
        with self.line.counting(answers=True) as traffic:
            call(*arguments)
        return traffic

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
