"""Rules of answers that are late, old, cut short or garbled."""

from __future__ import annotations

from functools import partial
from random import Random

from umo.testing.conformance.probe import Probe
from umo.testing.conformance.recovery import recovers, rewrite, values
from umo.testing.conformance.rules import Cost, NotTried, RuleBroken, rule
from umo.testing.conformance.spoiling import MAX_CHANNELS, NO_ANSWER, Spoilt, each_spoiled, spoiled_read
from umo.testing.conformance.traffic import Change
from umo.testing.conformance.trial import DriverCall, Trial

UNSTEADY = (
    "whether answers to reads carry a number is not seen, as nothing says that an input stays the same "
    "(`steady` of an Input, --steady)"
)


@rule(
    "late answer",
    "After a timeout, the late answer is never taken for that of a later request.",
    Cost(each=16, waits=24),
)
def late_answer(trial: Trial) -> str | None:
    """The answer to the later request gets lost: if the call succeeds, it took the late one."""
    tried = False
    with trial.opened() as probe:
        for behind in (False, True) if trial.line.ordered else (False,):
            for asked in _calls(trial, probe):
                for later in _calls(trial, probe):
                    tried |= _comes_late(trial, probe, behind, asked, later)
            tried |= _late_level(trial, probe, behind)
        recovers(trial, probe, values(trial, probe), "late answers")
    if not tried:
        raise NotTried(NO_ANSWER)
    return None if trial.line.ordered else "on a serial line: answers that come before the next request"


def _writes(trial: Trial, probe: Probe) -> list[DriverCall]:
    return [partial(probe.write, each.channel, each.other()) for each in trial.subject.outputs[:1]]


def _calls(trial: Trial, probe: Probe) -> list[DriverCall]:
    """Reads of two channels, and a write."""
    return [*(partial(probe.read, text) for text in trial.readable[:MAX_CHANNELS]), *_writes(trial, probe)]


def _comes_late(trial: Trial, probe: Probe, behind: bool, asked: DriverCall, later: DriverCall) -> bool:
    """Whether the first call had an answer, which came after its timeout."""
    line = trial.line
    _alive(trial, probe)
    before = line.spoiled
    with line.late(behind=behind):
        error = trial.failure(asked)
    first = trial.watch.doing
    if line.spoiled == before:
        return False
    if error is None:
        raise RuleBroken(f"{first} succeeded before its answer came")
    error, lost = trial.unanswered(later)
    if error is None and lost:
        raise RuleBroken(f"{trial.watch.doing} took the late answer to the {first}")
    return True


def _late_level(trial: Trial, probe: Probe, behind: bool) -> bool:
    """The late answer has the level that an output had before; it comes with the right one. Whether there was one."""
    output = next(iter(trial.viewed), None)
    if output is None:
        return False
    view, line = trial.view(output), trial.line
    old, new = output.default, output.other()
    probe.timeout = trial.patience
    probe.write(output.channel, old)
    trial.is_read(probe, output, old)
    trial.hurry(probe)
    before = line.spoiled
    with line.late(behind=behind):
        trial.failure(probe.read, view)
    probe.timeout = trial.patience
    rewrite(trial, probe, output, new, f"a timeout of {view}")
    there, found = trial.comes_to(lambda: trial.insist(probe.read, view), lambda level: trial.same(output, new, level))
    if not there and not trial.fallen(view, found):
        raise RuleBroken(f"{view} read {found} after a timeout of it; {output.channel} is at {new}")
    return line.spoiled > before


def _alive(trial: Trial, probe: Probe) -> None:
    """A call that succeeds, so that the driver is connected; then the short timeout. After a failure it may fail."""
    probe.timeout = trial.patience
    trial.insist(trial.transfers(probe)[0])
    trial.hurry(probe)


@rule("answer in pieces", "An answer that comes in several pieces is put together.", Cost(each=8))
def answer_in_pieces(trial: Trial) -> None:
    line = trial.line
    with trial.opened() as probe:
        expected, before = values(trial, probe), line.spoiled
        with line.split():
            recovers(trial, probe, expected, "an answer in pieces", tries=1)
            trial.must_work(probe, "answers come in pieces")
    if line.spoiled == before:
        raise NotTried(NO_ANSWER)


@rule(
    "old answer",
    "An earlier answer in place of the right one is an error, where answers carry a number.",
    Cost(each=14, waits=6),
)
def old_answer(trial: Trial) -> None:
    """The number shows: two answers to one call, while nothing changes, are not alike."""
    with trial.opened() as probe:
        tried = False
        why = [] if trial.known or not trial.readable else [UNSTEADY]
        steady: list[DriverCall] = [partial(probe.read, text) for text in trial.known[:1]]
        for call in [*steady, *_writes(trial, probe)]:
            _alive(trial, probe)
            old = _numbered(trial, probe, call)
            if isinstance(old, str):
                why.append(old)
                continue
            for later in _calls(trial, probe):
                _alive(trial, probe)
                found, changed = trial.spoiled(lambda answer: old, False, later)  # noqa: B023
                if changed and not isinstance(found, OSError):
                    raise RuleBroken(f"{trial.watch.doing} succeeded with an earlier answer")
                tried |= changed
        recovers(trial, probe, values(trial, probe), "an earlier answer")
    if not tried:
        raise NotTried("; ".join(why) or NO_ANSWER)


def _numbered(trial: Trial, probe: Probe, call: DriverCall) -> bytes | str:
    """An answer to the call, which has a number in it, or why it is not known to have one."""
    probe.timeout = trial.patience
    line = trial.line
    line.exchanges.clear()
    for _ in range(4):
        call()
    doing = trial.watch.doing
    line.settle()
    trial.hurry(probe)
    exchanges = list(line.exchanges)[-3:]
    if len(exchanges) < 3:
        return f"{doing} has no answer of its own on the line"
    requests, answers = zip(*exchanges, strict=True)
    for what, each in (("requests of", requests), ("answers to", answers)):
        if len(set(each)) < 3:
            return f"{what} {doing} carry no number: an earlier one is the same"
        if len(set(map(len, each))) > 1:
            return f"{what} {doing} are not of one length"
    return bytes(answers[-1])


@rule(
    "short answer",
    "An answer that is cut short, with or without the end of the connection, is an error.",
    Cost(opens=2, each=40, waits=18),
)
def short_answer(trial: Trial) -> str | None:
    def half(answer: bytes) -> bytes:
        return answer[: len(answer) // 2]

    whole = each_spoiled(
        trial,
        [
            Spoilt("no answer and the end of the connection", lambda answer: b"", hangup=True, blind=True),
            Spoilt("half of an answer", half, blind=True),
            Spoilt("half of an answer and the end of the connection", half, hangup=True, blind=True),
            Spoilt("the first byte of an answer and the end of the connection", lambda a: a[:1], hangup=True),
        ],
    )
    with trial.opened() as probe:
        for text in trial.known[:MAX_CHANNELS]:
            for hangup in (False, True):
                spoiled_read(trial, probe, text, Spoilt("an answer without its end", lambda a: a[:-1], hangup))
    return whole


@rule(
    "garbled answer",
    "An answer whose structure is garbled (its start, all of it, random bytes) is an error. A changed digit or "
    "register in a sound answer cannot be noticed; it is tried only where answers have a checksum.",
    Cost(each=50, waits=20),
)
def garbled_answer(trial: Trial) -> str | None:
    random = Random(1998)

    def noise(count: int) -> bytes:
        return bytes(random.randrange(0x80, 0x100) for _ in range(count))

    def half(answer: bytes) -> bytes:
        return noise(len(answer) // 2 or 1) + answer[len(answer) // 2 or 1 :]

    ways = [
        Spoilt("an answer with another first byte", lambda answer: bytes([answer[0] ^ 0xA5]) + answer[1:]),
        Spoilt("an answer with a garbled first half", half),
        Spoilt("random bytes of the length of an answer", lambda answer: noise(len(answer)), blind=True),
        Spoilt("300 random bytes", lambda answer: noise(300), blind=True),
    ]
    if trial.subject.checksum:
        ways += [
            Spoilt(f"an answer with a changed bit in byte {place}", _flipped(place, bit))
            for place, bit in ((-1, 7), (-2, 0), (-4, 4), (-6, 2), (0, 6), (1, 1), (2, 3))
        ]
    return each_spoiled(trial, ways, structured=True)


def _flipped(place: int, bit: int) -> Change:
    def change(answer: bytes) -> bytes:
        at = place if place >= 0 else len(answer) + place
        if not 0 <= at < len(answer):
            return answer[:-1] + bytes([answer[-1] ^ 1])
        return answer[:at] + bytes([answer[at] ^ 1 << bit]) + answer[at + 1 :]

    return change
