"""Rules of the line: devices that do not answer, or not in time, or not what was asked for."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from random import Random
from time import monotonic
from typing import Any

from umo.drivers.contract import Direction
from umo.testing.conformance.probe import Probe
from umo.testing.conformance.rules import NotTried, RuleBroken, rule
from umo.testing.conformance.subject import Output
from umo.testing.conformance.taps import Change, Tap
from umo.testing.conformance.trial import NO_VIEW, Trial

TRIES = 3
"""Calls within which a driver recovers."""
MOST = 2
"""Channels that are tried with each spoiled answer."""
NO_TWO = "no two channels can be read that have different values: wire or name another channel that can be read"
NO_ANSWER = "the device answers neither reads nor writes over the line"


@rule("late answer", "After a timeout, the late answer is never taken for that of a later request.")
def late_answer(trial: Trial) -> str | None:
    tried = False
    with trial.opened() as probe:
        values = apart(trial, probe)
        for behind in (False, True) if trial.line.ordered else (False,):
            for asked in values if len(values) > 1 else ():
                others = {text: raw for text, raw in values.items() if text != asked}
                for call, arguments in _asking(trial, probe, asked):
                    tried |= _comes_late(trial, probe, behind, call, *arguments)
                    recovers(trial, probe, others, f"a timeout of {asked}")
            tried |= _late_level(trial, probe, behind)
    if not tried:
        raise NotTried(f"{NO_TWO}, and {NO_VIEW}")
    return None if trial.line.ordered else "on a serial line: answers that come before the next request"


def _comes_late(trial: Trial, probe: Probe, behind: bool, call: Callable[..., object], *arguments: Any) -> bool:
    """The call times out, its answer comes later. Whether there was an answer."""
    line, before = trial.line, trial.line.spoiled
    trial.hurry(probe)
    with line.late(behind=behind):
        error = trial.failure(call, *arguments)
    probe.driver.timeout = trial.patience
    if error is None and line.spoiled > before:
        raise RuleBroken(f"{trial.watch.doing} succeeded before its answer came")
    return line.spoiled > before


def _late_level(trial: Trial, probe: Probe, behind: bool) -> bool:
    """The late answer has the level that an output had before. Whether this could be tried."""
    views = {each: trial.loops.get(each.channel, each.channel) for each in trial.subject.outputs}
    output = next((each for each, view in views.items() if view in trial.readable), None)
    if output is None:
        return False
    view = views[output]
    probe.write(output.channel, output.default)
    tried = _comes_late(trial, probe, behind, probe.read, view)
    rewrite(trial, probe, output, f"a timeout of {view}")
    end = monotonic() + trial.subject.settle
    while not trial.same(output, output.other(), found := _read_twice(probe, view)):
        if not trial.same(output, output.default, found) or monotonic() > end:
            raise RuleBroken(f"{view} read {found} after a timeout of it; {output.channel} is at {output.other()}")
    return tried


def _read_twice(probe: Probe, text: str) -> int:
    """The second time only if the first fails: with that the driver may find out what it has to."""
    try:
        return probe.read(text)
    except OSError:
        return probe.read(text)


def _asking(trial: Trial, probe: Probe, text: str) -> Iterator[tuple[Callable[..., object], tuple[Any, ...]]]:
    yield probe.read_many, ((text,),)
    if (default := trial.default(text)) is not None:
        yield probe.write, (text, probe.read(text) if text in trial.readable else default)


def apart(trial: Trial, probe: Probe) -> dict[str, int]:
    """Channels that read different values, as far as possible: outputs are brought to different levels, or, if that is
    not enough, every second one stays at its default."""
    for step in (1, 2):
        found: dict[str, int] = {}
        for text, raw in _values(trial, probe, step).items():
            if raw not in found.values() and len(found) < MOST:
                found[text] = raw
        if len(found) == MOST:
            break
    return found


def recovers(trial: Trial, probe: Probe, values: dict[str, int], after: str, tries: int = TRIES) -> None:
    """Each channel reads its value, at the last of the tries at the latest, and no other one before."""
    for text, raw in values.items():
        for left in range(tries - 1, -1, -1):
            try:
                found = probe.read(text)
            except OSError as error:
                if not left:
                    raise RuleBroken(f"read of {text} still fails after {after}: {error}") from error
                continue
            if not (trial.alike(text, raw, found) or trial.fallen(text, found)):
                raise RuleBroken(f"{text} read {found} after {after}; it is at {raw}")
            break


@rule("answer in pieces", "An answer that comes in several pieces is put together.")
def answer_in_pieces(trial: Trial) -> None:
    line = trial.line
    with trial.opened() as probe:
        values, before = _values(trial, probe), line.spoiled
        with line.split():
            recovers(trial, probe, values, "an answer in pieces", tries=1)
            for call, arguments in trial.transfers(probe):
                if (error := trial.failure(call, *arguments)) is not None:
                    raise RuleBroken(f"{trial.watch.doing} failed with an answer in pieces: {error}")
    if line.spoiled == before:
        raise NotTried(NO_ANSWER)


@rule("old answer", "An earlier answer in place of the right one is an error, where requests carry a number.")
def old_answer(trial: Trial) -> None:
    line = trial.line
    with trial.opened() as probe:
        values = apart(trial, probe)
        if len(values) < 2:
            raise NotTried(NO_TWO)
        for asked in values:
            old = _answers(line, probe, asked)
            for text in values:
                if text != asked:
                    _spoiled_read(trial, probe, text, values[text], _replaced(old), "an earlier answer")


def _replaced(old: bytes) -> Change:
    return lambda answer: old


def _answers(line: Tap, probe: Probe, text: str) -> bytes:
    """The answer to a read of the channel; NotTried if two requests for it are alike."""
    line.exchanges.clear()
    for _ in range(4):
        probe.read(text)
    requests = [request for request, _ in line.exchanges]
    if len(requests) < 2:
        raise NotTried(NO_ANSWER)
    if len(set(requests)) < len(requests):
        raise NotTried("requests carry no number, so an earlier answer cannot be told from the right one")
    return line.exchanges[-1][1]


def _spoiled_read(
    trial: Trial, probe: Probe, text: str, raw: int, change: Change, what: str, hangup: bool = False
) -> bool:
    """The read must fail or be right. Whether there was an answer to spoil."""
    line, before = trial.line, trial.line.spoiled
    probe.driver.timeout = trial.patience
    probe.read(text)  # connected, and alive
    trial.hurry(probe)
    with line.spoiling(change, hangup=hangup):
        try:
            found = probe.read(text)
        except OSError:
            found = raw
    probe.driver.timeout = trial.patience
    if line.spoiled > before and not (trial.alike(text, raw, found) or trial.fallen(text, found)):
        raise RuleBroken(f"{text} read {found} from {what}; it is at {raw}")
    recovers(trial, probe, {text: raw}, what)
    return line.spoiled > before


def _spoiled_write(trial: Trial, probe: Probe, change: Change, what: str, hangup: bool = False) -> bool:
    """The write must fail, if it has an answer: it is not known whether it was carried out."""
    line = trial.line
    if not trial.subject.outputs:
        return False
    output, before = trial.subject.outputs[0], trial.line.spoiled
    probe.driver.timeout = trial.patience
    probe.write(output.channel, output.default)
    trial.hurry(probe)
    with line.spoiling(change, hangup=hangup):
        error = trial.failure(probe.write, output.channel, output.other())
    probe.driver.timeout = trial.patience
    if error is None and line.spoiled > before:
        raise RuleBroken(f"{trial.watch.doing} succeeded with {what}")
    rewrite(trial, probe, output, what)
    return line.spoiled > before


def rewrite(trial: Trial, probe: Probe, output: Output, after: str) -> None:
    """The output takes another level, at the third call at the latest."""
    for left in range(TRIES - 1, -1, -1):
        error = trial.failure(probe.write, output.channel, output.other())
        if error is None:
            return
        if not left:
            raise RuleBroken(f"{trial.watch.doing} still fails after {after}: {error}")


def _each_spoiled(trial: Trial, variants: list[tuple[str, Change, bool]]) -> None:
    """All reads and a write with each of the answers: in words, how it is made, and whether the line hangs up."""
    tried = False
    with trial.opened() as probe:
        values = _values(trial, probe)
        for what, change, hangup in variants:
            for text, raw in list(values.items())[:MOST]:
                tried |= _spoiled_read(trial, probe, text, raw, change, what, hangup)
            tried |= _spoiled_write(trial, probe, change, what, hangup)
    if not tried:
        raise NotTried(NO_ANSWER)


def _values(trial: Trial, probe: Probe, step: int = 1) -> dict[str, int]:
    """What the channels read that stay as they are. Every output, or every second one with a step of 2, is brought to
    another level than its default; the inputs that read them are waited for."""
    outputs = trial.subject.outputs
    levels = [each.default if number % step else each.other(number) for number, each in enumerate(outputs)]
    for output, raw in zip(outputs, levels, strict=True):
        probe.write(output.channel, raw)
    for output, raw in zip(outputs, levels, strict=True):
        if output.channel in trial.loops:
            trial.is_read(probe, output, raw)
    texts = (*(output.channel for output in trial.subject.outputs), *trial.loops.values(), *trial.steady)
    return {text: probe.read(text) for text in texts if text in trial.readable}


@rule("short answer", "An answer that is cut short, with or without the end of the connection, is an error.")
def short_answer(trial: Trial) -> None:
    cut: list[tuple[str, Change, bool]] = [
        ("no answer and the end of the connection", lambda answer: b"", True),
        ("half of an answer", lambda answer: answer[: len(answer) // 2], False),
        ("half of an answer and the end of the connection", lambda answer: answer[: len(answer) // 2], True),
        ("the first byte of an answer and the end of the connection", lambda answer: answer[:1], True),
    ]
    _each_spoiled(trial, cut)
    with trial.opened() as probe:
        for text, raw in list(_values(trial, probe).items())[:MOST]:
            for hangup in (False, True):
                _spoiled_read(trial, probe, text, raw, lambda answer: answer[:-1], "an answer without its end", hangup)


@rule(
    "garbled answer",
    "An answer whose structure is garbled (its start, all of it, random bytes) is an error. A changed digit or "
    "register in a sound answer cannot be noticed; it is tried only where answers have a checksum.",
)
def garbled_answer(trial: Trial) -> None:
    random = Random(1998)

    def noise(count: int) -> bytes:
        return bytes(random.randrange(0x80, 0x100) for _ in range(count))

    variants: list[tuple[str, Change, bool]] = [
        ("an answer with another first byte", lambda answer: bytes([answer[0] ^ 0xA5]) + answer[1:], False),
        ("an answer with a garbled first half", lambda a: noise(len(a) // 2 or 1) + a[len(a) // 2 or 1 :], False),
        ("random bytes of the length of an answer", lambda answer: noise(len(answer)), False),
        ("300 random bytes", lambda answer: noise(300), False),
    ]
    if trial.subject.checksum:
        variants += [
            (f"an answer with a changed bit in byte {place}", _flipped(place, place % 8), False)
            for place in (-1, -4, -6)
        ]
    _each_spoiled(trial, variants)


def _flipped(place: int, bit: int) -> Change:
    def change(answer: bytes) -> bytes:
        if -place > len(answer):
            return answer[:-1] + bytes([answer[-1] ^ 1])
        at = len(answer) + place
        return answer[:at] + bytes([answer[at] ^ 1 << bit]) + answer[at + 1 :]

    return change


@rule("error answer", "An error that the device answers is an OSError, not a value and not a timeout.")
def error_answer(trial: Trial) -> None:
    if not trial.subject.refused:
        raise NotTried("no channel is known that the device refuses")
    with trial.opened() as probe:
        values = _values(trial, probe)
        for text in trial.subject.refused:
            for call, arguments in _transfers_of(probe, text):
                error = trial.failure(call, *arguments)
                if error is None:
                    raise RuleBroken(f"{trial.watch.doing} succeeded; the device refuses it")
                if isinstance(error, TimeoutError):
                    raise RuleBroken(f"{trial.watch.doing} timed out; the device answers it with an error")
                recovers(trial, probe, values, "an error answer")


def _transfers_of(probe: Probe, text: str) -> Iterator[tuple[Callable[..., object], tuple[Any, ...]]]:
    direction = probe.channel(text).direction
    if Direction.INPUT in direction:
        yield probe.read, (text,)
        yield probe.read_many, ((text,),)
    if Direction.OUTPUT in direction:
        yield probe.write, (text, 0)
        yield probe.write_many, ((text,), (0,))
