"""Runs the rules, each in a separate thread, so that the kit continues if a driver hangs."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Future, wait
from contextlib import suppress
from math import inf
from threading import Thread
from time import monotonic
from typing import Any, TypeVar

from umo.cycle.stopping import raising_signals
from umo.drivers.contract import Driver
from umo.duration import duration
from umo.errors import Failure, StopError, text_of
from umo.testing.conformance.budget import Budget, TimePlan
from umo.testing.conformance.certificate import Certificate, Finding, Judgement, edition
from umo.testing.conformance.probe import Stopped, TimeUp, call_of, disturbed_before, failed
from umo.testing.conformance.process_snapshot import State
from umo.testing.conformance.rule_context import RuleContext
from umo.testing.conformance.rules import ALWAYS, NotTried, Rule, RuleBroken, chosen_rules
from umo.testing.conformance.subject import Subject

T = TypeVar("T")
OnProgress = Callable[[str, float], object]
"""Function that is called ten times a second with the rule and the completed share of the run."""
OnPlan = Callable[[TimePlan], object]
"""Function that is called with the plan of the run, before the first rule."""
LOOK_INTERVAL = 0.1
"""Time in s between two checks of the rule that is tried, for its progress and for a call that hangs."""
MINUTES = 2.0
"""Default time budget of a run in minutes."""
TIME_UP = "left out, because the time was over (`minutes`, --for)"
HANG = 2.0
"""Time in s, in addition to four times its timeout, after which a call counts as hanging."""
LONGEST_TIMEOUT_FACTOR = 1.2
"""Multiple of the longest timeout after which a call counts as hanging. It is large enough for a call that keeps the
longest timeout although a shorter one was set later."""
on_certificate: list[Callable[[Certificate], object]] = []
"""Functions that are called with each new certificate."""


class Hangs(Exception):
    """Raised if a call of the driver does not return."""


def conform(
    subject: Subject,
    *,
    only: Iterable[str] | None = None,
    minutes: float = MINUTES,
    cycles: int | None = None,
    progress: OnProgress | None = None,
    plan: OnPlan | None = None,
    before: State | None = None,
) -> Certificate:
    """Try every rule (or `only` these) on the driver, in at most `minutes`; the certificate lists the parts that were
    left out to save time. `cycles`: length of the search for leaks, by default enough for 70,000 transfers. A cycle
    writes and reads all channels as a block, and one channel alone. `plan` is called before the first rule. `before`:
    the process before the driver was imported (`process_snapshot.state`), if more than `make` must be judged.

    Outputs are driven within the limits of the subject, and are at their defaults at the end, also after an exception
    or a signal. A failed rule does not prevent the others from being tested, unless the driver hangs or the device no
    longer answers. A driver hangs if a call has not returned after four times its timeout plus 2 s, and at least 3.6 s.
    """
    with raising_signals():
        return _conform(subject, chosen_rules(only), minutes, cycles, progress, plan, before)


def _conform(
    subject: Subject,
    rules: Sequence[Rule],
    minutes: float,
    cycles: int | None,
    progress: OnProgress | None,
    plan: OnPlan | None,
    before: State | None,
) -> Certificate:
    context = RuleContext(subject, cycles, Budget(60 * minutes, rules))
    context.begin(before)
    driver = subject.make()
    try:
        examination = _Examination(context, rules, progress)
        examination.prepare(plan)
        examination.run()
    except BaseException as error:
        if unreached := _bring_to_defaults(context):
            failures = [Failure(text, text, "not reset", subject.name) for text in unreached]
            raise StopError("not brought to their defaults", failures) from error
        raise
    unreached = _bring_to_defaults(context)
    certificate = _certificate(context, driver, examination.findings, unreached)
    for call in on_certificate:
        call(certificate)
    return certificate


class _Examination:
    """The trial of the rules on one subject, one after the other."""

    def __init__(self, context: RuleContext, rules: Sequence[Rule], progress: OnProgress | None) -> None:
        self.context, self.rules, self.progress = context, rules, progress
        self._found: dict[str, Finding] = {}
        self.causes: dict[str, str] = {}
        """Rules that were already broken, by the cause."""
        self.hangs = ""
        """The call that hung before the first rule; empty if none did."""
        self.ended = ""
        """The reason why the remaining rules cannot be tried, except the general rules, which are always tried."""
        self._weights = [1.0] * len(rules)

    def prepare(self, on_plan: OnPlan | None) -> None:
        """Measure a few calls, and print how long the run will take."""

        def measure() -> None:
            with suppress(OSError, Stopped):  # the rule "answers" says it
                self.context.measure()
            with suppress(Stopped):
                self.context.restore()

        try:
            _in_thread(self.context, measure)
        except Hangs as error:
            self.hangs = str(error)
        plan = self.context.budget.plan(self.context.pace, self.context.cycles, self.context.subject.line is not None)
        self._weights = [0.1 + plan.shown.get(rule.id, 0.0) for rule in self.rules]
        if on_plan is not None:
            on_plan(plan)

    @property
    def findings(self) -> tuple[Finding, ...]:
        """The findings in the order of the rules."""
        return tuple(self._found[rule.id] for rule in self.rules)

    def run(self) -> None:
        """Try the rules in their order. Those that were left out or shortened to save time are tried again before the
        general rules, as far as time remains."""
        chosen = [(number, rule) for number, rule in enumerate(self.rules) if rule.theme != ALWAYS]
        general = [(number, rule) for number, rule in enumerate(self.rules) if rule.theme == ALWAYS]
        for number, rule in chosen:
            self._found[rule.id] = self._finding(number, rule)
        for _, rule in chosen:
            if self._found[rule.id].verdict is not Judgement.FAILED and not self.ended:
                self._try_again(chosen[-1][0], rule)
        for number, rule in general:
            self._found[rule.id] = self._finding(number, rule)

    def _finding(self, number: int, rule: Rule) -> Finding:
        general = rule.theme == ALWAYS
        if self.ended and not (general and not self.context.watch.over):
            return _finding_on(rule, Judgement.NOT_TRIED, self.ended)
        if not general and not self.context.budget.begin(rule):
            return _finding_on(rule, Judgement.NOT_TRIED, TIME_UP)
        return self._tried(number, rule)

    def _try_again(self, number: int, rule: Rule) -> None:
        """Try a rule again of which something was left out. If the time is over before its end, the finding from before
        stays."""
        budget, before = self.context.budget, self._found[rule.id]
        part = budget.parts.get(rule.id)
        if not budget.begin_again(rule):
            return
        found = self._tried(number, rule)
        if found.verdict is Judgement.NOT_TRIED and part is not None:
            budget.left_out.remove(rule.id)
            budget.parts[rule.id], found = part, before
        self._found[rule.id] = found

    def _tried(self, number: int, rule: Rule) -> Finding:
        """Try a rule. `number`: the place in the progress of the run."""
        part = self._part(number, rule)
        part(0.0)
        try:
            if self.hangs:
                raise Hangs(self.hangs)
            self.context.share = 0.0
            finding = _in_thread(
                self.context, lambda: _tried(self.context, rule, self.causes), lambda: part(self.context.share)
            )
        except Hangs as error:
            self.ended = f"the driver hangs in {self.context.watch.doing}"
            return _finding_on(rule, Judgement.FAILED, str(error))
        if finding.verdict is Judgement.FAILED and not self.ended:
            self._look_whether_it_lives(rule)
        return finding

    def _look_whether_it_lives(self, rule: Rule) -> None:
        """Check, after a rule that failed, whether the device can still be used."""
        if "dead" in self.causes:
            self.ended = f"as above: {self.causes['dead']}"
            return
        try:
            dead = _in_thread(self.context, lambda: self.context.dead() and self.context.dead())
        except Hangs:
            dead = f"the driver hangs in {self.context.watch.doing}"
        if dead:
            self.ended = f"since the rule {rule.id}: {dead}"

    def _part(self, number: int, rule: Rule) -> Callable[[float], object]:
        """Return a function that reports the progress of one rule as progress of the whole run."""
        if self.progress is None:
            return lambda share: None
        progress, whole = self.progress, sum(self._weights)
        before, own = sum(self._weights[:number]) / whole, self._weights[number] / whole
        return lambda share: progress(rule.id, before + share * own)


def _finding_on(rule: Rule, verdict: Judgement, why: str) -> Finding:
    return Finding(rule.id, rule.text, verdict, why, rule.theme)


def _tried(context: RuleContext, rule: Rule, causes: dict[str, str]) -> Finding:
    found: tuple[str, ...] = ()
    context.left_out, context.excuses = [], []
    context.watch.until = inf if rule.theme == ALWAYS else context.budget.latest
    try:
        verdict, remark = Judgement.PASSED, rule.check(context)
        why = "; ".join(filter(None, [remark, *dict.fromkeys(context.excuses), *context.left_out]))
        if context.left_out:
            context.budget.parts[rule.id] = "; ".join(context.left_out)
    except TimeUp:  # its calls took longer than planned
        verdict, why = Judgement.NOT_TRIED, TIME_UP
        context.budget.left_out.append(rule.id)
    except NotTried as reason:
        verdict, why = Judgement.NOT_TRIED, str(reason)
    except RuleBroken as broken:
        verdict, why = Judgement.FAILED, str(broken)
        found = broken.causes or _failure(context, broken.__cause__, causes)
    except OSError as error:
        verdict, why = Judgement.FAILED, failed(error)
        found = _failure(context, error, causes)
    finally:
        context.watch.until = inf
    if first := next((causes[each] for each in found if each in causes), ""):
        verdict, why = Judgement.NOT_TRIED, f"as above ({first}): {why}"
    causes |= {each: rule.id for each in found if each not in causes}
    context.restore()
    return _finding_on(rule, verdict, why)


def _failure(context: RuleContext, error: BaseException | None, causes: Iterable[str]) -> tuple[str, ...]:
    """Return the causes of a failed call: the driver's text without the call and its channel, or a known cause that is
    a part of this text. A timeout does not show its cause, so the cause is the disturbance before it, or else this kind
    of call."""
    if not isinstance(error, OSError):
        return ()
    kind = call_of(error).partition(" ")[0] if isinstance(error, TimeoutError) else ""
    kind = "call after a disturbance" if kind and disturbed_before(error) else kind
    channels = sorted((*context.channels, *context.subject.refused), key=len, reverse=True)
    said = re.sub("|".join(map(re.escape, channels)) or "$^", "a channel", text_of(error))
    text = f"{kind} failed: {re.sub(r'-?[0-9]+', '#', said)}"
    known = (each for each in causes if each.startswith(" failed: ") and each.removeprefix(" failed: ") in text)
    return (next(known, text),)


def _in_thread(context: RuleContext, work: Callable[[], T], look: Callable[[], object] = lambda: None) -> T:
    """Do the work in a thread, and return its result. Raises Hangs if a call of the driver does not return. An
    exception here, such as KeyboardInterrupt, ends the work at its next call of the driver."""
    outcome: Future[T] = Future()  # Thread.join takes a running thread for ended after Ctrl-C (CPython 3.11, 3.12)

    def run() -> None:
        try:
            outcome.set_result(work())
        except BaseException as error:
            outcome.set_exception(error)

    try:
        Thread(target=run, name="umo conformance", daemon=True).start()
        while not outcome.done():
            look()
            wait([outcome], LOOK_INTERVAL)
            _check_hang(context)
    except Hangs:
        raise
    except BaseException:
        context.watch.stopped = True
        ended = wait([outcome], 4 * context.patience + HANG).done
        context.watch.stopped, context.watch.over = False, not ended
        raise
    return outcome.result()


def _check_hang(context: RuleContext) -> None:
    watch = context.watch
    began, limit = watch.began, watch.limit
    if began is not None and (took := monotonic() - began) > max(
        4 * limit + HANG, LONGEST_TIMEOUT_FACTOR * context.patience
    ):
        watch.over = True
        raise Hangs(f"{watch.doing} did not end within {duration(round(took, 1))}; its timeout is {duration(limit)}")


def _bring_to_defaults(context: RuleContext) -> tuple[str, ...]:
    """Bring the outputs to their defaults, and return those that were not reached. If the driver hangs, its trial is
    left to its thread, because the call may return at any time, and a new trial brings the outputs to their
    defaults."""
    if context.watch.over:
        context = RuleContext(context.subject)
    if context.subject.line is not None:
        context.subject.line.heal()
    try:
        _in_thread(context, lambda: context.restore(always=True))
    except Hangs:
        return tuple(output.channel for output in context.subject.outputs)
    return tuple(context.unreached)


def _certificate(
    context: RuleContext, driver: Driver[Any], findings: Iterable[Finding], unreached: tuple[str, ...]
) -> Certificate:
    subject = context.subject
    return Certificate(
        name=subject.name,
        driver=f"{type(driver).__module__}:{type(driver).__qualname__}",
        devices=(subject.device,) if subject.device else tuple(map(str, driver.devices())),
        outputs=tuple(f"{each.channel} {each.least} to {each.greatest}" for each in subject.outputs),
        inputs=tuple(each.channel for each in subject.inputs),
        findings=tuple(findings),
        times=context.times,
        unreached=unreached,
        left_out=(
            *(f"the rule {rule}" for rule in context.budget.left_out),
            *(f"{rule}: {parts}" for rule, parts in context.budget.parts.items()),
        ),
        **edition(),
    )
