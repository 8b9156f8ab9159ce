"""Rules of block transfers."""

from __future__ import annotations

import numpy as np

from umo.errors import ChannelsFailed
from umo.testing.conformance.probe import Probe
from umo.testing.conformance.rules import NotTried, RuleBroken, rule
from umo.testing.conformance.subject import Output
from umo.testing.conformance.trial import Trial

LOOKS = 5


@rule("block read", "read_many reads what read reads, in any order of the channels.")
def block_read(trial: Trial) -> None:
    texts = trial.readable
    if not texts:
        raise NotTried("the driver has no inputs")
    with trial.opened() as probe:
        for number, output in enumerate(trial.subject.outputs):
            probe.write(output.channel, output.other(number))
        for order in dict.fromkeys((texts, texts[::-1], texts[1:] + texts[:1], texts[:1])):
            _compare(probe, order)
        probe.read_many(())


def _compare(probe: Probe, texts: tuple[str, ...]) -> None:
    """Of channels that change meanwhile nothing is known."""
    for look in range(LOOKS):
        before = [probe.read(text) for text in texts]
        block = probe.read_many(texts)
        after = [probe.read(text) for text in texts]
        wrong = [i for i, raw in enumerate(block) if raw != before[i] == after[i]]
        if not wrong:
            return
        if look == LOOKS - 1:
            i = wrong[0]
            raise RuleBroken(f"read_many read {block[i]} of {texts[i]}, read before and after it {before[i]}")


@rule("block write", "write_many brings each output to its own level, in any order of the channels.")
def block_write(trial: Trial) -> str | None:
    with trial.opened() as probe:
        for shift in range(3):
            for step in (1, -1):
                outputs = trial.seen[::step]
                raws = [output.other(number + shift) for number, output in enumerate(outputs)]
                probe.write_many([output.channel for output in outputs], raws)
                _check(trial, probe, outputs, raws, "write_many")
        probe.write_many([], [])
    return trial.remark


def _check(trial: Trial, probe: Probe, outputs: tuple[Output, ...], raws: list[int], after: str) -> None:
    for output, raw in zip(outputs, raws, strict=True):
        trial.expect(probe, output, raw, f"{after} of {raw}")


@rule("block buffers", "The arrays of a block belong to the caller: none is kept, and `raws` is not changed.")
def block_buffers(trial: Trial) -> str | None:
    with trial.opened() as probe:
        _raws(trial, probe)
        if trial.readable:
            _outs(probe, trial.readable)
    return trial.remark


def _raws(trial: Trial, probe: Probe) -> None:
    """As the image uses it: one array, of which a part is handed over, with other levels in every period."""
    outputs = trial.seen
    texts = [output.channel for output in outputs]
    whole = np.zeros(len(outputs) + 2, np.int64)
    part = whole[1:-1]
    for number in range(4):
        raws = [output.other(number) if number % 2 else output.default for output in outputs]
        part[:] = raws
        probe.write_many(texts, part)
        if part.tolist() != raws:
            raise RuleBroken(f"write_many changed its array from {raws} to {part.tolist()}")
        part[:] = [output.other(number + 1) for output in outputs]  # for the next period; not sent yet
        _check(trial, probe, outputs, raws, "write_many, whose array was changed later,")


def _outs(probe: Probe, texts: tuple[str, ...]) -> None:
    whole = np.full(len(texts) + 2, -77, np.int64)
    part = whole[1:-1]
    probe.read_many(texts, part)
    if whole[0] != -77 or whole[-1] != -77:
        raise RuleBroken("read_many wrote beyond its array")
    part[:] = -77
    probe.read_many(texts)
    probe.read(texts[0])
    if part.tolist() != [-77] * len(texts):
        raise RuleBroken("read_many wrote into the array of an earlier call")


@rule("block failures", "If a channel of a block fails, the others are transferred, or the error names them too.")
def block_failures(trial: Trial) -> str | None:
    if not trial.subject.refused:
        raise NotTried("no channel is known that the device refuses")
    bad = trial.subject.refused[0]
    with trial.opened() as probe:
        if trial.readable:
            _read_with(trial, probe, bad)
        if trial.subject.outputs:
            _write_with(trial, probe, bad)
    return trial.remark if trial.subject.outputs else None


def _read_with(trial: Trial, probe: Probe, bad: str) -> None:
    expected = {text: probe.read(text) for text in trial.readable}
    texts = list(trial.readable)
    for place in (0, len(texts) // 2, len(texts)):
        block = [*texts[:place], bad, *texts[place:]]
        out = np.full(len(block), -1 << 40, np.int64)
        named = _named(trial.failure(probe.read_many, block, out), block, bad, "read_many")
        for text, raw in zip(block, out.tolist(), strict=True):
            if text not in named and text in trial.steady and raw != expected[text]:
                raise RuleBroken(
                    f"read_many failed for {', '.join(named)}; {text} is {raw} in place of {expected[text]}"
                )


def _write_with(trial: Trial, probe: Probe, bad: str) -> None:
    outputs = trial.seen
    for place in (0, len(outputs) // 2, len(outputs)):
        for output in outputs:
            probe.write(output.channel, output.default)
        raws = [output.other(place) for output in outputs]
        texts = [output.channel for output in outputs]
        block = [*texts[:place], bad, *texts[place:]]
        values = [*raws[:place], 0, *raws[place:]]
        named = _named(trial.failure(probe.write_many, block, values), block, bad, "write_many")
        for output, raw in zip(outputs, raws, strict=True):
            if output.channel not in named:
                trial.expect(probe, output, raw, f"a write_many that failed for {', '.join(named)} only")


def _named(error: OSError | None, block: list[str], bad: str, what: str) -> list[str]:
    """The channels for which the block failed."""
    if error is None:
        raise RuleBroken(f"{what} succeeded with {bad}, which the device refuses")
    if not isinstance(error, ChannelsFailed):
        return block
    if unknown := sorted(set(error.causes) - set(block)):
        raise RuleBroken(f"ChannelsFailed of {what} names {unknown[0]}, which is not a channel of the block")
    if bad not in error.causes:
        raise RuleBroken(f"ChannelsFailed of {what} does not name {bad}")
    return list(error.causes)
