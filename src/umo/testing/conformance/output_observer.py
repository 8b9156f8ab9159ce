"""Observes the levels of the outputs: by the record of a counterpart, through a loop-back, or by reading them back."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import cached_property, partial
from threading import Event, Thread
from time import monotonic, sleep

from umo.testing.conformance.driver_factory import DriverFactory
from umo.testing.conformance.probe import Probe, Watch
from umo.testing.conformance.rules import RECORD, WRITTEN, NotTried, RuleBroken
from umo.testing.conformance.subject import Output
from umo.text import some

LOOK_INTERVAL = 0.001
"""Time in s between two readings of a level that has not arrived yet."""
STEP_SHARE = 0.02
"""Share of a range. A level that differs by no more than this may be a step of the device."""
NO_VIEW = "the level of no output can be seen: it needs a loop-back, or a channel that can be read back"
ONLY_CONFIRMED = (
    "every call succeeded, but no level can be seen: it needs a loop-back, or a channel that can be read back"
)


class OutputObserver(DriverFactory):
    """The levels of the outputs, as far as they can be observed."""

    excuses: list[str]
    """The changes that the present rule attributes to the device itself, as text."""
    last_level = 0
    """The level that `is_at` or `is_read` found last."""

    @cached_property
    def loops(self) -> dict[str, str]:
        return dict(self.subject.loopbacks)

    def view(self, output: Output) -> str:
        """Return the channel that shows the level of an output: its loop-back, or the output itself."""
        return self.loops.get(output.channel, output.channel)

    @cached_property
    def visible(self) -> tuple[Output, ...]:
        """The outputs whose level can be observed."""
        by = self.loops.keys() if self.subject.levels is None else self._defaults.keys()
        return tuple(each for each in self.subject.outputs if each.channel in by or each.channel in self.readable)

    @property
    def required_outputs(self) -> tuple[Output, ...]:
        """The outputs whose level can be observed. Raises NotTried if there is none."""
        if not self.subject.outputs:
            raise NotTried("the driver has no outputs")
        if not self.visible:
            raise NotTried(NO_VIEW)
        return self.visible

    @cached_property
    def viewed(self) -> tuple[Output, ...]:
        """The outputs whose level the driver can read."""
        return tuple(each for each in self.subject.outputs if self.view(each) in self.readable)

    @property
    def steady(self) -> tuple[str, ...]:
        """The inputs that nothing drives and that do not change by themselves."""
        looped = {text for _, text in self.subject.loopbacks}
        return tuple(each.channel for each in self.subject.inputs if each.steady and each.channel not in looped)

    @property
    def known(self) -> tuple[str, ...]:
        """The channels whose reading stays the same as long as the kit changes nothing: steady inputs, and levels of
        outputs."""
        return tuple(dict.fromkeys((*(self.view(each) for each in self.viewed), *self.steady)))

    def remark(self, *more: str) -> str | None:
        """Return a remark about the outputs that the rule could not observe, and the rule's other remarks."""
        unseen = [each.channel for each in self.subject.outputs if each not in self.visible]
        words = [f"except {some(unseen)}, whose level cannot be seen"] if unseen else []
        return "; ".join((*words, *more)) or None

    def looked(self, *more: str) -> str | None:
        """Return the remark at the end of a rule whose calls succeeded. Raises NotTried if the rule could observe none
        of the outputs."""
        if self.subject.outputs and not self.visible:
            raise NotTried(ONLY_CONFIRMED)
        return self.remark(*more)

    # Levels -------------------------------------------------------------------------------------------

    def reading(self, probe: Probe, output: Output) -> int:
        """Return the reading of the level of an output."""
        view = self.view(output)
        self.ready(probe, view)
        return probe.read(view)

    def recorded(self, output: Output) -> Sequence[int]:
        """Return the levels since the last call, as the counterpart has recorded them. Raises RuleBroken if the
        counterpart has recorded none, which is a fault of the subject."""
        assert self.subject.levels is not None
        if not (found := self.subject.levels(output.channel)):
            raise RuleBroken(
                f"`levels` of the subject gave no level of {output.channel}; the first is the level at the last call "
                "of this function, the last is the present level; if the output has not moved, there is only one level",
                RECORD,
            )
        return found

    def level(self, probe: Probe, output: Output) -> int:
        """Return the present level of the output, as recorded by the counterpart, or else as read by the driver."""
        if self.subject.levels is not None:
            return self.recorded(output)[-1]
        return self.reading(probe, output)

    def comes_to(self, look: Callable[[], int], right: Callable[[int], bool]) -> tuple[bool, int]:
        """Return whether `look` finds a right level within `settle`, and the last level that was found."""
        end = monotonic() + self.subject.settle
        while not right(found := look()):
            if monotonic() >= end:
                return False, found
            sleep(LOOK_INTERVAL)
        return True, found

    def is_at(self, probe: Probe, output: Output, raw: int) -> bool:
        """Return True if the output comes to this level within `settle`. Sets `last_level`."""
        return self._comes_to(self.level, probe, output, raw)

    def is_read(self, probe: Probe, output: Output, raw: int) -> bool:
        """True if the driver reads this level within `settle`. Sets `last_level`."""
        return self._comes_to(self.reading, probe, output, raw)

    def _comes_to(self, look: Callable[[Probe, Output], int], probe: Probe, output: Output, raw: int) -> bool:
        there, self.last_level = self.comes_to(lambda: look(probe, output), lambda level: self.same(output, raw, level))
        return there

    def await_levels(self, probe: Probe) -> None:
        """Wait until the levels that this driver wrote last are read, but no longer than `settle`. Readings before that
        may still show earlier levels."""
        for output in self.viewed:
            if output.channel in probe.levels:
                self.is_read(probe, output, probe.levels[output.channel])

    def arrive(self, other: Probe | None, output: Output, raw: int) -> None:
        """Wait until the level has certainly arrived, as observed without the driver under test: by the counterpart's
        record or by another driver. If that is not possible, wait for `settle`."""
        if self.subject.levels is not None:
            self.comes_to(lambda: self.recorded(output)[-1], lambda level: self.same(output, raw, level))
        if other is not None:
            self.is_read(other, output, raw)
        elif self.subject.levels is None or self.view(output) != output.channel:
            sleep(self.subject.settle)

    def expect(self, probe: Probe, output: Output, raw: int, after: str, *causes: str) -> None:
        """Raise RuleBroken if the output is not at this level, or the driver reads another level. `causes`: additional
        causes of the error."""
        if self.subject.levels is not None and not self.is_at(probe, output, raw):
            text = f"{output.channel} is at {self.last_level} after {after}, not at {raw}"
            raise RuleBroken(text + self._hint(output, raw), f"level of {output.channel}", *causes)
        if output in self.viewed and not self.is_read(probe, output, raw):
            view, found = self.view(output), self.last_level
            if self.subject.levels is not None:
                text = f"{view} reads {found}, but {output.channel} is at {raw}, which is right after {after}"
                raise RuleBroken(text + self._hint(output, raw), f"reading of {view}")
            of = "" if view == output.channel else f", which shows {output.channel},"
            text = f"{view}{of} reads {found} after {after}, not {raw}"
            raise RuleBroken(text + self._hint(output, raw), f"level of {output.channel}", *causes)

    def confirm(self, probe: Probe, output: Output, raw: int) -> None:
        """Raise RuleBroken if the output is not at the level that was written last, or the driver reads another level.
        This error takes precedence over other findings of a rule, because it is their cause."""
        probe.timeout = self.patience
        self.expect(probe, output, raw, f"write({raw})", WRITTEN)

    def _hint(self, output: Output, raw: int) -> str:
        """Return a hint for devices that have steps."""
        off, width = abs(self.last_level - raw), output.greatest - output.least
        if self.subject.agree is None and width >= 1 / STEP_SHARE and off <= max(1.0, STEP_SHARE * width):
            return (
                " (if the device has steps or noise, say how far values may differ: `agree` of the subject, "
                "--tolerance)"
            )
        return ""

    # The same level -----------------------------------------------------------------------------------

    def same(self, output: Output, raw: int, level: int) -> bool:
        """True if an observed level equals a raw integer of the output."""
        if raw == level or self.subject.agree is None:
            return raw == level
        views = {self.view(output)}
        if self.subject.levels is not None:  # what records them has the output's own scale
            views.add(output.channel)
        return any(self.subject.agree(output.channel, raw, view, level) for view in views)

    def alike(self, text: str, before: int, now: int) -> bool:
        """True if two readings of a channel mean the same level: they are equal, or they are readings of a loop-back
        that agree with the same level of the output."""
        if before == now or self.subject.agree is None:
            return before == now
        return any(
            self.same(output, raw, before) and self.same(output, raw, now)
            for output in self.subject.outputs
            if self.view(output) == text
            for raw in (*output.inner, output.default)
        )

    def fallen(self, text: str, found: int) -> bool:
        """True if the device itself has brought an output to its default, as a watchdog does while a line is silent. A
        new driver, without the line, must read the default too."""
        shown = [each for each in self.subject.outputs if self.view(each) == text]
        if self.subject.direct is None or not any(self.same(each, each.default, found) for each in shown):
            return False
        probe = self.new(direct=True)
        try:
            probe.open()
            if fell := self.alike(text, found, probe.read(text)):
                self.excuses.append(
                    f"{text} went to its default in the meantime; the kit assumes that the device did this"
                )
            return fell
        except OSError:
            return False
        finally:
            with suppress(OSError):
                probe.close()

    # Levels in between --------------------------------------------------------------------------------

    @contextmanager
    def observing(self, output: Output, left: int, until: int) -> Iterator[list[int]]:
        """Return a context that yields a list. After the context the list contains the levels that an output had during
        the context, beginning with the level before. A loop-back is watched from the time when it shows the level
        `left` to the time when it shows the level `until`. The list is empty if only the driver under test can read the
        output."""
        found: list[int] = []
        if self.subject.levels is not None:
            self.recorded(output)
            yield found
            found += self.recorded(output)
        elif output.channel in self.loops and (self.subject.line is None or self.subject.line.ordered):
            with self._polling(self.loops[output.channel], partial(self.same, output, left), found):
                yield found
                end = monotonic() + self.subject.settle
                while found and not self.same(output, until, found[-1]) and monotonic() < end:
                    sleep(LOOK_INTERVAL)
        else:
            yield found

    @contextmanager
    def straight(self, goals: Mapping[Output, int], doing: str) -> Iterator[None]:
        """Return a context that raises RuleBroken unless the output goes directly to its goal, which may be its present
        level. Without a record of levels this is not checked."""
        seen = goals if self.subject.levels is not None else {}
        for output in seen:
            self.recorded(output)
        yield
        for output, goal in seen.items():
            first, *levels = self.recorded(output)
            if levels and not self.same(output, goal, levels[-1]):
                continue  # that it is not there is told with the level itself
            stood = (level for level in levels if not self.alike(self.view(output), first, level))
            if odd := [level for level in stood if not self.same(output, goal, level)]:
                text = f"{output.channel} went from {first} to {odd[0]} for a short time during {doing}"
                raise RuleBroken(text, f"level of {output.channel}")

    @contextmanager
    def _polling(self, text: str, came: Callable[[int], bool], found: list[int]) -> Iterator[None]:
        """Return a context in which a second driver reads the input as quickly as possible, once a level `came`.
        `found` is empty if the device accepts no second driver."""
        probe, end = self.new(), Event()
        probe.watch = Watch()  # of another thread
        try:
            probe.open()
            probe.initialize(text, None)
            found.append(self.comes_to(lambda: probe.read(text), came)[1])
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
