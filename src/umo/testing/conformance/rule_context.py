"""The context of a rule: the subject in use, the remaining time, and calls whose answers are spoiled."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from functools import partial
from math import inf
from time import monotonic
from typing import Any, TypeVar

from umo.drivers.contract import Direction
from umo.drivers.optional import HasWatchdog, Inspects, KnowsAges, KnowsScale, Looks, Reports, ages_of
from umo.errors import text_of
from umo.testing.conformance.budget import Budget, CallTime
from umo.testing.conformance.certificate import TransferTime
from umo.testing.conformance.output_observer import OutputObserver
from umo.testing.conformance.probe import Probe, WrongKind, failed
from umo.testing.conformance.process_snapshot import State, state, threads
from umo.testing.conformance.relay import Change, Traffic
from umo.testing.conformance.rules import NotTried, RuleBroken
from umo.testing.conformance.subject import Subject
from umo.testing.conformance.taps import Tap

DriverCall = Callable[[], object]
T = TypeVar("T")
MEASURED_CALLS = 3
"""Number of calls of each kind from which the time of a call is measured."""
MEASURED_OPENINGS = 2
"""Number of openings that are measured. A device may need some time between two."""
WATCHED_CALLS = 4
"""Number of calls within the time of a watchdog."""
MIN_HASTE = 0.2
"""Shortest timeout in s that the kit chooses by itself."""
HASTE_FACTOR = 10
"""The timeout of a call that must time out, as a multiple of the time of the slowest of a few answers."""
NO_LINE = "there is no line between driver and device that the kit can disturb"


class RuleContext(OutputObserver):
    """The subject in use. `share` is the completed share of the present rule, for a progress line."""

    def __init__(self, subject: Subject, cycles: int | None = None, budget: Budget | None = None) -> None:
        super().__init__(subject)
        self.cycles = cycles
        self.budget = budget if budget is not None else Budget(inf, ())
        self.pace = CallTime()
        self.haste = subject.timeout
        """Timeout in s of calls that must time out."""
        self.share = 0.0
        self.excuses = []
        self._told: bool | None = None
        self.left_out: list[str] = []
        """Parts of the present rule that were left out for lack of time, as text."""
        self.times: dict[str, TransferTime] = {}
        self.threads: frozenset[int] = frozenset()
        """Threads of the process that are older than the first driver."""
        self.before: State = {}
        """The state of the process before the first driver."""

    def begin(self, before: State | None = None) -> None:
        """Record the state of the process before the first driver is made. `before`: an earlier state, if a driver was
        already imported."""
        self.before = before or state()
        self.threads = frozenset(threads())

    def measure(self) -> None:
        """Measure the time of a few calls. Sets `pace`, and `haste` if the device answers much quicker than the
        timeout."""
        opening, taken = 0.0, list[float]()
        for _ in range(MEASURED_OPENINGS):
            began = monotonic()
            with self.opened() as probe:
                used = [self._timed(call) for call in self.transfers(probe) * MEASURED_CALLS]
                self.told(probe)
            opening, taken = max(opening, monotonic() - began - sum(used)), taken + used
        self.haste = min(self.subject.timeout, max(MIN_HASTE, HASTE_FACTOR * max(taken, default=0.0)))
        mean = sum(taken) / max(1, len(taken))
        watchdog = self.subject.watchdog and self.subject.watchdog + WATCHED_CALLS * mean
        self.pace = CallTime(
            opening, mean, self.haste, max(1, len(self.channels)), self._connecting(mean), self._settling(), watchdog
        )

    def _timed(self, call: DriverCall) -> float:
        call()
        return self.watch.took

    def _settling(self) -> float:
        """Return the time in s for the levels of all loop-backs to arrive; 0 if another client can see them arrive."""
        looped = [each for each in self.viewed if self.view(each) != each.channel]
        with self.second() if looped else nullcontext(None) as other:
            return 0.0 if other is not None else len(looped) * self.subject.settle

    def _connecting(self, transfer: float) -> float:
        """Return how much longer a call takes when the connection was lost."""
        if self.subject.line is None:
            return 0.0
        with self.opened() as probe:
            call = self.transfers(probe)[0]
            self.subject.line.drop()
            self.failure(call)
            first = self.watch.took
            self.failure(call)  # the first may only have found the end of the connection
            return max(0.0, first - transfer, self.watch.took - transfer)

    def as_time_allows(self, tasks: Sequence[T], fewest: int, what: str) -> Iterator[T]:
        """Yield the tasks of a rule: `fewest` of them in any case, further ones as long as there is time. `what` is a
        word for the tasks, such as "blocks"; it is used if some are left out."""
        longest = 0.0
        for number, task in enumerate(tasks):
            if number >= fewest and not self.budget.has(longest):
                self.left_out.append(f"{number} of {len(tasks)} {what}")
                return
            self.share, began = number / len(tasks), monotonic()
            yield task
            longest = max(longest, monotonic() - began)

    def transfers(self, probe: Probe, default: bool = True) -> list[DriverCall]:
        """Return one call of each kind. Outputs are written to their defaults, or to other levels."""
        found: list[DriverCall] = []
        if self.readable:
            found += [partial(probe.read, self.readable[0]), partial(probe.read_many, self.readable)]
        if outputs := self.subject.outputs:
            texts = [each.channel for each in outputs]
            raws = [each.default if default else each.other() for each in outputs]
            found += [partial(probe.write, texts[0], raws[0]), partial(probe.write_many, texts, raws)]
            found += [partial(probe.reset, texts[-1], outputs[-1].default)]
        return found

    def enquiries(self, probe: Probe) -> list[DriverCall]:
        """Return one call of each kind, other than transfers, that may access the device. None of them arms the
        watchdog."""
        driver, found = probe.driver, list[DriverCall]()
        if isinstance(driver, Reports):
            found.append(partial(probe.call, "report", driver.report))
        if isinstance(driver, Inspects) and self.readable:
            found.append(partial(probe.call, "inspect", driver.inspect, probe.channel(self.readable[0])))
        if isinstance(driver, KnowsScale) and self.channels:
            found.append(partial(probe.call, "physical_scale", driver.physical_scale, probe.channel(self.channels[0])))
        if isinstance(driver, HasWatchdog) and self.subject.watchdog:
            found.append(partial(probe.call, "watchdog", driver.watchdog, 0.0))
        return found

    def use(self, probe: Probe) -> None:
        """Make one call of each kind. All of them must succeed."""
        for call in self.transfers(probe):
            call()

    def try_out(self, probe: Probe) -> None:
        """Make one call of each kind, which may fail."""
        for call in self.transfers(probe):
            self.failure(call)

    def must_work(self, probe: Probe, since: str, default: bool = True) -> None:
        """Raise RuleBroken if a call of any kind fails."""
        for call in self.transfers(probe, default):
            if (error := self.failure(call)) is not None:
                raise RuleBroken(f"since {since}, {self.watch.doing} fails: {text_of(error)}") from error

    def refused_calls(self, probe: Probe, text: str) -> list[DriverCall]:
        """Return reads and writes of a channel that the device refuses, as far as the direction of the channel allows.
        Outputs that must not be driven are not written."""
        direction = probe.channel(text).direction
        found: list[DriverCall] = []
        if Direction.INPUT in direction:
            found += [partial(probe.read, text), partial(probe.read_many, (text,))]
        if Direction.OUTPUT in direction and self.subject.outputs:
            found += [partial(probe.write, text, 0), partial(probe.write_many, (text,), (0,))]
        return found

    @contextmanager
    def in_haste(self, probe: Probe) -> Iterator[None]:
        """Return a context for calls that may have to time out, such as calls that the device refuses without an
        answer."""
        probe.timeout = self.haste
        yield
        probe.timeout = self.patience

    def told(self, probe: Probe) -> bool:
        """True if the driver receives the values of its inputs instead of requesting them. Such a driver reports ages.
        A separate rule checks them."""
        if self._told is None:
            doing = self.watch.doing
            self._told = bool(self.readable) and isinstance(probe.driver, KnowsAges) and self._gives_ages(probe)
            self.watch.doing = doing
        return self._told

    def _gives_ages(self, probe: Probe) -> bool:
        probe.read_many(self.readable)
        return probe.call("ages", ages_of, probe.driver, tuple(map(probe.channel, self.readable))) is not None

    def made_up(self, probe: Probe) -> bool:
        """True if the last call, which has succeeded without a right answer, invented its result. A driver that
        receives its values may return an earlier reading. The rule "ages" checks its age."""
        if not self.watch.doing.startswith("read") or not self.told(probe):
            return True
        self.excuses.append(
            "the values may be older than the call, because the driver receives its values from elsewhere: see the "
            "rule ages"
        )
        return False

    def insist(self, call: Callable[..., T], *arguments: Any) -> T:
        """Make a call that may fail twice, because the driver may notice the consequences of earlier calls only in this
        call."""
        for _ in range(2):
            with suppress(OSError):
                return call(*arguments)
        return call(*arguments)

    def look(self, probe: Probe) -> bool | None:
        """Return the result of the driver's `look`; True if the driver has no such function, False if it raises an
        OSError. Raises RuleBroken if `look` returns or raises anything else that it must not."""
        driver = probe.driver
        try:
            found = probe.call("look", driver.look if isinstance(driver, Looks) else lambda: True)
        except WrongKind as error:
            raise RuleBroken(f"look raised {text_of(error)}, which is not an OSError") from error
        except OSError:
            return False
        if found is not None and not isinstance(found, bool):
            raise RuleBroken(f"look returned {found!r}, which is neither a bool nor None")
        return found

    def dead(self) -> str:
        """Return the reason why the device cannot be used at all, or an empty text if it can."""
        probe, doing = None, ""
        try:
            probe = self.new()
            self.bring_up(probe)
            for call in self.transfers(probe):
                call()
                doing = self.watch.doing
        except OSError as error:
            missing = self.subject.line.missing if self.subject.line is not None else ""
            what = failed(error)
            if missing:
                return f"the device is missing: {missing} ({what})"
            return what if doing or probe is None else f"the device does not answer: {what}"
        finally:
            if probe is not None:
                with suppress(OSError):
                    self.leave(probe)
        return ""

    # The line -----------------------------------------------------------------------------------------

    @property
    def line(self) -> Tap:
        """The line between driver and device. Raises NotTried if there is none."""
        if self.subject.line is None:
            raise NotTried(NO_LINE)
        return self.subject.line

    @property
    def loss(self) -> Callable[[], Any]:
        """A function that returns a context in which the device is away. Raises NotTried if the kit cannot take the
        device away."""
        return self.subject.gone or self.line.gone

    def unanswered(self, call: Callable[..., object], *arguments: Any) -> tuple[OSError | None, bool]:
        """Make a call whose answer gets lost. Return the call's error, and whether there was an answer."""
        found, lost = self.spoiled(lambda answer: b"", False, call, *arguments)
        return found if isinstance(found, OSError) else None, lost

    def spoiled(
        self, change: Change, hangup: bool, call: Callable[..., Any], *arguments: Any, reset: bool = False
    ) -> tuple[Any, bool]:
        """Make a call whose answer is changed. Return the call's result or error, and whether there was an answer to
        change."""
        line = self.line
        before = line.spoiled
        with line.spoiling(change, hangup=hangup, reset=reset):
            try:
                found = call(*arguments)
            except OSError as error:
                found = error
            changed = line.await_answer(before) if not isinstance(found, OSError) else line.spoiled > before
        return found, changed

    def traffic(self, call: Callable[..., object], *arguments: Any) -> Traffic:
        """Return the traffic of a call that succeeds."""
        with self.line.counting(answers=True) as traffic:
            call(*arguments)
        return traffic

    def counted(self, answers: bool = False) -> AbstractContextManager[Traffic]:
        """Return a context that yields the traffic during it, like `Tap.counting`. Without a line the traffic stays
        empty."""
        line = self.subject.line
        return nullcontext(Traffic()) if line is None else line.counting(answers)

    def fail_some(self, probe: Probe) -> None:
        """Make calls that fail, by any available means. Raises NotTried if there are no such means."""
        if self.subject.refused:
            for call in self.refused_calls(probe, self.subject.refused[0])[::-2]:
                self.failure(call)
        elif self.subject.line is None and self.subject.gone is None:
            raise NotTried(f"no call can be made to fail: {NO_LINE}, and no channel that the device refuses")
        probe.timeout = self.haste
        away = self.subject.gone if self.subject.line is None else self.subject.line.silent
        if away is not None:
            with away():
                for call in self.transfers(probe, default=False)[::3]:  # a read and a write
                    self.failure(call)
