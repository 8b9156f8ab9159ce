"""Calls whose answers are changed: they must fail, or be right."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from umo.testing.conformance.probe import Probe
from umo.testing.conformance.recovery import recovers, rewrite
from umo.testing.conformance.rules import NotTried, RuleBroken
from umo.testing.conformance.subject import Output
from umo.testing.conformance.traffic import Change
from umo.testing.conformance.trial import Trial

MAX_CHANNELS = 2
"""Channels that are tried with each spoiled answer."""
NO_ANSWER = "the device answers neither reads nor writes over the line"
ENVELOPE_SIZE = 2
"""Bytes by which an answer is longer than its value where it has a structure."""


@dataclass(frozen=True)
class Spoilt:
    """A way to change an answer."""

    words: str
    change: Change
    hangup: bool = False
    blind: bool = False
    """Nothing is left of the answer by which the driver could know a value: a call that succeeds made it up."""


def each_spoiled(trial: Trial, ways: list[Spoilt], structured: bool = False) -> str | None:
    """Reads and a write with each of the answers; `structured`: only answers that have a structure."""
    tried, plain = set(), set()
    with trial.opened() as probe:
        texts = [trial.view(each) for each in trial.viewed[:MAX_CHANNELS]]
        texts += [text for text in trial.readable if text not in texts and trial.default(text) is None]
        texts = texts[:MAX_CHANNELS]
        if structured:
            plain = {text for text in texts if not _has_structure(trial, probe, text)}
        for way in ways:
            for text in texts:
                if text not in plain and spoiled_read(trial, probe, text, way):
                    tried.add("reads")
            if trial.subject.outputs and "writes" not in plain:
                if structured and not _acknowledged(trial, probe):
                    plain.add("writes")
                elif _spoiled_write(trial, probe, way):
                    tried.add("writes")
    if not tried:
        raise NotTried("answers have no structure by which garbage is noticed" if plain else NO_ANSWER)
    return f"without {' and '.join(sorted(plain))}, whose answers have no structure" if plain else None


def _has_structure(trial: Trial, probe: Probe, text: str) -> bool:
    """Whether an answer to a read has more than the value: a line of text, or some bytes more."""
    answer = _answer(trial, probe, probe.read, text)
    if not trial.subject.structured or not answer:
        return trial.subject.structured
    if answer[-1:] in b"\r\n;>" and answer.isascii() and len(answer) > 1:
        return True
    return trial.subject.checksum or len(answer) >= -(-probe.channel(text).bits // 8) + ENVELOPE_SIZE


def _acknowledged(trial: Trial, probe: Probe) -> bool:
    """Whether the answer to a write is more than one or two bytes."""
    output = trial.subject.outputs[0]
    probe.timeout = trial.patience
    probe.write(output.channel, output.other())
    answer = _answer(trial, probe, probe.write, output.channel, output.default)
    return trial.subject.structured and (not answer or trial.subject.checksum or len(answer) > ENVELOPE_SIZE)


def _answer(trial: Trial, probe: Probe, call: Callable[..., object], *arguments: Any) -> bytes:
    """The answer to a call that succeeds; nothing if there was none."""
    probe.timeout = trial.patience
    return trial.traffic(call, *arguments).answer


def spoiled_read(trial: Trial, probe: Probe, text: str, way: Spoilt) -> bool:
    """The read must fail or be right. Its level is moved between a good reading and this one, where an output drives
    it. Whether there was an answer to change."""
    probe.timeout = trial.patience
    output = next((each for each in trial.viewed if trial.view(each) == text), None)
    known = _moved(trial, probe, output) if output is not None else probe.read(text)
    trial.hurry(probe)
    found, changed = trial.spoiled(way.change, way.hangup, probe.read, text)
    probe.timeout = trial.patience
    if changed and not isinstance(found, OSError):
        if way.blind:
            raise RuleBroken(f"{text} read {found} from {way.words}: that is no reading of now")
        right = output is not None and trial.same(output, known, found)
        if not (right or trial.alike(text, known, found) or trial.fallen(text, found)) and text in trial.known:
            raise RuleBroken(f"{text} read {found} from {way.words}; it is at {known}")
    recovers(trial, probe, {text: known} if text in trial.known else {text: None}, way.words)
    return changed


def _moved(trial: Trial, probe: Probe, output: Output) -> int:
    """The level to which an output has come since it was read for the last time."""
    before, now = output.other(1), output.other(2)
    if before == now:
        before, now = output.default, output.other()
    probe.write(output.channel, before)
    trial.is_read(probe, output, before)
    probe.write(output.channel, now)
    if trial.view(output) != output.channel:
        with trial.second(direct=True) as watcher:
            trial.arrive(watcher, output, now)
    return now


def _spoiled_write(trial: Trial, probe: Probe, way: Spoilt) -> bool:
    """The write must fail, if it has an answer: it is not known whether it was carried out."""
    output = trial.subject.outputs[0]
    probe.timeout = trial.patience
    probe.write(output.channel, output.default)
    trial.hurry(probe)
    found, changed = trial.spoiled(way.change, way.hangup, probe.write, output.channel, output.other())
    probe.timeout = trial.patience
    if changed and not isinstance(found, OSError):
        raise RuleBroken(f"{trial.watch.doing} succeeded with {way.words}")
    rewrite(trial, probe, output, output.other(), way.words)
    return changed
