"""Rules of the time that a call takes. They come early: a driver that hangs is found here."""

from __future__ import annotations

from collections.abc import Callable
from time import sleep
from typing import Any

from umo.testing.conformance.probe import Probe
from umo.testing.conformance.rules import RuleBroken, rule
from umo.testing.conformance.trial import Trial

TRIES = 3
"""Calls of which the shortest counts: the computer may have been busy with something else."""


@rule(
    "timeout",
    "A call ends within `timeout`, which it reads, by a TimeoutError; also if bytes come without end, or nothing "
    "answers the request to connect.",
)
def timeout(trial: Trial) -> None:
    line = trial.line
    with trial.opened() as probe:
        trial.hurry(probe)
        with line.silent():
            for call, arguments in trial.transfers(probe):
                before = line.spoiled
                error = in_time(trial, probe, call, *arguments)
                if error is None and line.spoiled > before:
                    raise RuleBroken(f"{trial.watch.doing} succeeded without an answer")
                if error is not None and not isinstance(error, TimeoutError):
                    raise RuleBroken(f"{trial.watch.doing} raised {type(error).__name__}, not a TimeoutError: {error}")
        with line.endless(trial.subject.timeout / 4):
            for call, arguments in trial.transfers(probe)[1::2]:  # the blocks
                in_time(trial, probe, call, *arguments)
    probes = [trial.new() for _ in range(TRIES)]
    with line.silent():
        _open_in_time(trial, probes)
    _without_a_connection(trial)


def _open_in_time(trial: Trial, probes: list[Probe]) -> None:
    """Open, or fail, and close. The quickest of several drivers counts."""
    limit = _allowed(trial.subject.timeout)
    for probe in probes:
        trial.hurry(probe)
        slow = ""
        for call in (probe.open, probe.close):
            trial.failure(call)
            if trial.watch.took > limit:
                slow = _slow(trial, trial.subject.timeout)
        if not slow:
            return
    raise RuleBroken(slow)


def _without_a_connection(trial: Trial) -> None:
    others = [trial.new() for _ in range(TRIES)]
    with trial.opened() as probe:
        trial.hurry(probe)
        with trial.line.unreachable() as possible:
            if possible:
                for call, arguments in trial.transfers(probe, default=False)[1::2]:
                    if in_time(trial, probe, call, *arguments) is None:
                        raise RuleBroken(f"{trial.watch.doing} succeeded without a connection")
                _open_in_time(trial, others)


def in_time(trial: Trial, probe: Probe, call: Callable[..., object], *arguments: Any) -> OSError | None:
    """The error of a call that has to end within its timeout."""
    for _ in range(TRIES):
        error = trial.failure(call, *arguments)
        if trial.watch.took <= _allowed(probe.driver.timeout):
            return error
    raise RuleBroken(_slow(trial, probe.driver.timeout))


def _allowed(timeout: float) -> float:
    """s: half of the timeout more, and 50 ms for the computer."""
    return 1.5 * timeout + 0.05


def _slow(trial: Trial, timeout: float) -> str:
    return f"{trial.watch.doing} took {trial.watch.took * 1e3:.0f} ms, its timeout is {timeout * 1e3:g} ms"


@rule("patience", "A longer `timeout`, set after `open`, holds at once: initialise and reset get one.")
def patience(trial: Trial) -> None:
    line = trial.line
    probe = trial.new()

    def slow(answer: bytes) -> bytes:
        sleep(2 * trial.subject.timeout)
        return answer

    try:
        _open_in_a_hurry(trial, probe)
        probe.driver.timeout = trial.patience
        for text in trial.channels:
            probe.initialize(text, trial.default(text))
        with line.spoiling(slow):
            for call, arguments in trial.transfers(probe)[::-2]:  # the last is a reset
                if (error := trial.failure(call, *arguments)) is not None:
                    raise RuleBroken(f"{trial.watch.doing} failed with a timeout of {trial.patience:g} s: {error}")
    finally:
        with trial.own_error_first():
            trial.leave(probe)


def _open_in_a_hurry(trial: Trial, probe: Probe) -> None:
    """The computer may be busy with something else."""
    trial.hurry(probe)
    for _ in range(TRIES):
        if trial.failure(probe.open) is None:
            return
        probe.close()
    probe.open()
