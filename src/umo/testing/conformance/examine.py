"""Runs the rules, each in a thread of its own, so that a driver that hangs does not hang the kit."""

from __future__ import annotations

import platform
from collections.abc import Callable, Iterable
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from threading import Event, Thread
from time import monotonic
from typing import Any

from umo.drivers.contract import Driver
from umo.errors import Failure, StopError
from umo.testing.conformance.certificate import Certificate, Finding, Judgement
from umo.testing.conformance.probe import call_of
from umo.testing.conformance.rules import NotTried, Rule, RuleBroken, chosen_rules
from umo.testing.conformance.subject import Subject
from umo.testing.conformance.trial import Trial
from umo.text import reported

OnProgress = Callable[[str, float], object]
"""Called with the rule and the share of the whole that is done, ten times a second."""
INTERVAL = 0.1
HANG = 2.0
"""s, and four times its timeout, after which a call counts as hanging."""
on_certificate: list[Callable[[Certificate], object]] = []
"""Called with each certificate."""


class Hangs(Exception):
    """A call of the driver does not return."""


def conform(
    subject: Subject, *, only: Iterable[str] | None = None, cycles: int = 10_000, progress: OnProgress | None = None
) -> Certificate:
    """Try every rule (or `only` these) on the driver. Takes about a second and the time of `cycles` transfers, each
    with one read and one write of every channel.

    Outputs are driven within the limits of the subject, and are at their defaults at the end, also after an exception
    or Ctrl-C. A rule that fails does not keep the others from being tried, unless the driver hangs: a call that
    does not return within four times its timeout and 2 s.
    """
    rules = chosen_rules(only)
    driver = subject.make()
    trial = Trial(subject, cycles)
    findings: list[Finding] = []
    hangs = ""
    try:
        for number, rule in enumerate(rules):
            if hangs:
                findings.append(Finding(rule.id, rule.text, Judgement.NOT_TRIED, f"the driver hangs in {hangs}"))
                continue
            try:
                findings.append(_supervised(trial, rule, _part(progress, rule, number, len(rules))))
            except Hangs as error:
                hangs = trial.watch.doing
                findings.append(Finding(rule.id, rule.text, Judgement.FAILED, str(error)))
    except BaseException as error:
        if unreached := _bring_to_defaults(trial):
            raise _stop_error(subject, unreached) from error
        raise
    unreached = _bring_to_defaults(trial)
    certificate = _certificate(trial, driver, findings, unreached)
    for call in on_certificate:
        call(certificate)
    return certificate


def _stop_error(subject: Subject, unreached: Iterable[str]) -> StopError:
    failures = [Failure(text, text, "not reset", subject.name) for text in unreached]
    return StopError("not brought to their defaults", failures)


def _supervised(trial: Trial, rule: Rule, progress: Callable[[float], object]) -> Finding:
    """The finding on one rule. Hangs if a call does not return."""
    found: list[Finding] = []
    errors: list[BaseException] = []

    def work() -> None:
        try:
            found.append(_tried(trial, rule))
        except BaseException as error:
            errors.append(error)

    trial.share = 0.0
    _in_thread(trial, work, lambda: progress(trial.share))
    if errors:
        raise errors[0]
    return found[0]


def _tried(trial: Trial, rule: Rule) -> Finding:
    try:
        verdict, why = Judgement.PASSED, rule.check(trial) or ""
    except NotTried as reason:
        verdict, why = Judgement.NOT_TRIED, str(reason)
    except RuleBroken as broken:
        verdict, why = Judgement.FAILED, str(broken)
    except OSError as error:
        verdict, why = Judgement.FAILED, f"{call_of(error)} failed: {reported(error)}"
    trial.restore()
    return Finding(rule.id, rule.text, verdict, why)


def _in_thread(trial: Trial, work: Callable[[], None], look: Callable[[], object]) -> None:
    """Carry out the work. Hangs if a call of the driver does not return. An exception here, such as KeyboardInterrupt,
    ends the work at its next call of the driver."""
    ended = Event()  # Thread.join that Ctrl-C interrupts takes a running thread for ended (CPython 3.11, 3.12)

    def run() -> None:
        try:
            work()
        finally:
            ended.set()

    try:
        Thread(target=run, name="umo conformance", daemon=True).start()
        while not ended.is_set():
            look()
            ended.wait(INTERVAL)
            _check_hang(trial)
    except Hangs:
        raise
    except BaseException:
        trial.watch.stopped = True
        over = not ended.wait(4 * trial.patience + HANG)
        trial.watch.stopped, trial.watch.over = False, over
        raise


def _check_hang(trial: Trial) -> None:
    watch = trial.watch
    began, limit = watch.began, watch.limit
    if began is not None and (took := monotonic() - began) > 4 * limit + HANG:
        watch.over = True
        raise Hangs(f"{watch.doing} did not end within {took:.1f} s; its timeout is {limit * 1e3:g} ms")


def _bring_to_defaults(trial: Trial) -> tuple[str, ...]:
    """The outputs that were not brought to their defaults. If the driver hangs, its trial is left to its thread, and a
    new one brings them there: the call that hangs may return at any time."""
    if trial.watch.over:
        trial = Trial(trial.subject, trial.cycles)
    if trial.subject.line is not None:
        trial.subject.line.heal()
    try:
        _in_thread(trial, lambda: trial.restore(always=True), lambda: None)
    except Hangs:
        return tuple(output.channel for output in trial.subject.outputs)
    return tuple(trial.unreached)


def _part(progress: OnProgress | None, rule: Rule, number: int, count: int) -> Callable[[float], object]:
    """The progress of one rule as that of the whole."""
    if progress is None:
        return lambda share: None
    return lambda share: progress(rule.id, (number + share) / count)


def _certificate(
    trial: Trial, driver: Driver[Any], findings: Iterable[Finding], unreached: tuple[str, ...]
) -> Certificate:
    subject = trial.subject
    return Certificate(
        name=subject.name,
        driver=f"{type(driver).__module__}:{type(driver).__qualname__}",
        devices=(subject.device,) if subject.device else tuple(map(str, driver.devices())),
        outputs=tuple(f"{each.channel} {each.least} to {each.greatest}" for each in subject.outputs),
        inputs=tuple(each.channel for each in subject.inputs),
        findings=tuple(findings),
        times=trial.times,
        unreached=unreached,
        cycles=trial.cycles,
        date=datetime.now(UTC).strftime("%Y-%m-%d"),
        versions={"umo": _version(), "Python": platform.python_version()},
        platform=f"{platform.system()} {platform.machine()}",
    )


def _version() -> str:
    try:
        return version("umo")
    except PackageNotFoundError:  # run from its sources
        return "?"
