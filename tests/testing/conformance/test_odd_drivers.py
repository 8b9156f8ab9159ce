"""The kit blames no driver that keeps the contract in an unusual way."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from time import sleep
from typing import Any

import pytest

from conformance.careful import HASTE, Careful
from conformance.odd import (
    LEVELS,
    Beats,
    ChecksWhatItWrote,
    ClosesAtExit,
    Distant,
    EventsOnly,
    GreetsTheDevice,
    HasAWorker,
    Lags,
    LocksItself,
    LogsItsFailures,
    LooksByReading,
    Memory,
    Moving,
    NearItsTimeout,
    NeedsInitialise,
    Noisy,
    OneByOne,
    OutputsOnly,
    ReadsByteByByte,
    ReadsInTwoParts,
    SendsChangesOnly,
    SensorsOnly,
    StartsSlowly,
    Steps,
    SwitchesOnFirst,
    TakesTurns,
    Told,
    ToldSinceTheLastReading,
    WritesTwice,
)
from conformance.plain import Bytes, Scpi, TwoBytes, of_bytes, scpi
from conformance.subjects import careful, plain, without_watchdog
from helpers.tiers import first, some
from umo.drivers.contract import Channel
from umo.errors import DeviceTimeout
from umo.testing.conformance import Input, Judgement, Output, Subject, conform
from umo.testing.conformance.budget import Budget
from umo.testing.conformance.rule_context import RuleContext
from umo.testing.conformance.rules import chosen_rules
from umo.testing.conformance.spoiling import TRIES, Spoilt, _of_a_stream

CYCLES = 20
INPUTS = (Input("in:8"), Input("in:9"))
OUTPUTS = (Output("out:0", 5, 0, 255), Output("out:1", 0, 0, 255))
MOVING = (Input("in:8", steady=False), Input("in:9", steady=False))
NO_OUTPUTS: dict[str, Any] = {"outputs": (), "loopbacks": (), "refused": ("in:40",), "levels": None}
ODD: dict[str, Callable[[], Any]] = {
    "careful": careful,
    "its answers take most of the timeout": lambda: careful(NearItsTimeout),
    "its answers take 5 ms": lambda: careful(Distant),
    "it starts slowly": lambda: careful(StartsSlowly),
    "its timeout is 5 s": lambda: careful(timeout=5.0),
    "its channels must be initialised": lambda: careful(NeedsInitialise),
    "its channels must be initialised, and nobody records levels": lambda: careful(NeedsInitialise, levels=None),
    "it sends changes only": lambda: careful(SendsChangesOnly),
    "it reads back what it wrote": lambda: careful(ChecksWhatItWrote),
    "it switches outputs on first": lambda: careful(SwitchesOnFirst, levels=None),
    "its reset writes twice": lambda: careful(WritesTwice, levels=None),
    "it has no blocks": lambda: careful(OneByOne),
    "it greets the device": lambda: careful(GreetsTheDevice),
    "a thread of it beats": lambda: without_watchdog(Beats),
    "its outputs have steps": lambda: careful(Steps, agree=lambda one, raw, other, seen: 0 <= raw - seen < 4),
    "sensors only": lambda: careful(inputs=INPUTS, **NO_OUTPUTS),
    "sensors that move": lambda: careful(Moving, inputs=MOVING, **NO_OUTPUTS),
    "one sensor": lambda: careful(inputs=INPUTS[:1], **NO_OUTPUTS),
    "outputs only": lambda: careful(
        outputs=(Output("out:0", 5, 0, 255), Output("out:1")), inputs=(), loopbacks=(), refused=(), levels=None
    ),
    "one output": lambda: careful(outputs=(Output("out:0"),), inputs=(), loopbacks=(), refused=()),
    "sensors only, without a write of its own": lambda: careful(SensorsOnly, inputs=INPUTS, **NO_OUTPUTS),
    "outputs only, and one that the device refuses": lambda: careful(
        OutputsOnly, outputs=OUTPUTS, inputs=(), loopbacks=(), refused=("out:40",)
    ),
    "outputs only, without a record": lambda: careful(
        OutputsOnly, outputs=OUTPUTS, inputs=(), loopbacks=(), refused=("out:40",), levels=None
    ),
    "events only": lambda: careful(
        EventsOnly,
        outputs=(Output("out:0"), Output("out:1")),
        inputs=(),
        loopbacks=(),
        refused=("out:40",),
        levels=None,
        checksum=False,
    ),
    "it is told its values": lambda: careful(Told),
    "its readings are as old as the call before": lambda: careful(ToldSinceTheLastReading),
    "it has the device alone from its first call on": lambda: careful(
        TakesTurns, outputs=OUTPUTS, inputs=(), loopbacks=(), refused=("out:40",)
    ),
    "it looks by reading": lambda: careful(LooksByReading),
    "it reads byte by byte": lambda: careful(ReadsByteByByte),
    "it locks itself": lambda: careful(LocksItself),
    "it has a worker": lambda: careful(HasAWorker),
    "the exit of the program closes it": lambda: careful(ClosesAtExit),
    "its blocks are two requests": lambda: careful(ReadsInTwoParts),
    "two channels": lambda: careful(outputs=(Output("out:0"),), inputs=(Input("in:0"),), refused=(), levels=None),
    "its device has a watchdog": lambda: careful(watchdog=0.15, timeout=0.25),
    "no record of levels": lambda: careful(levels=None),
    "no refused channel": lambda: careful(refused=()),
    "answers of one byte": lambda: plain(Bytes, of_bytes(1), 255),
    "answers of two bytes without a frame": lambda: plain(TwoBytes, of_bytes(2), 65535),
    "silence for what is unknown": lambda: plain(Scpi, scpi(), 65535, refused=("unknown",), settle=0.1),
}


@pytest.mark.full
@pytest.mark.parametrize("what", ODD)
def test_a_correct_driver_passes(what: str) -> None:
    with ODD[what]() as subject:
        certificate = conform(subject, cycles=CYCLES)
    assert certificate.passed, str(certificate)
    assert certificate.line_tried


@pytest.mark.parametrize(
    "driver",
    some(
        lambda driver: driver in (SwitchesOnFirst, SendsChangesOnly),
        (SwitchesOnFirst, SendsChangesOnly, WritesTwice, ChecksWhatItWrote, OneByOne, GreetsTheDevice, Beats),
    ),
)
def test_the_requests_of_a_correct_reset_are_not_blamed(driver: type[Careful]) -> None:
    with careful(driver, levels=None) as subject:
        certificate = conform(subject, only=["glitch"])
    assert certificate.finding("glitch").verdict is Judgement.PASSED, str(certificate)
    said = certificate.finding("glitch").why or ""
    if driver is not Beats:  # it depends on when it beats
        assert ("short pulses of" in said) == (driver in (SwitchesOnFirst, WritesTwice)), said


def test_what_a_driver_logs_does_not_count_as_printed() -> None:
    with careful(LogsItsFailures) as subject:
        found = conform(subject, only=["process"]).finding("process")
    assert found.verdict is Judgement.PASSED, found


def wide() -> Subject:
    return Subject("wide", make=Memory, outputs=(Output("wide", -7, -(2**63), 2**63 - 1),))


def switch() -> Subject:
    return Subject("switch", make=Memory, outputs=(Output("switch"),), levels=lambda text: [LEVELS[text]])


@pytest.mark.parametrize("subject", [wide, switch])
def test_a_channel_of_64_bits_and_a_single_binary_output_pass(
    subject: Callable[[], Subject], most_rules: list[str]
) -> None:
    certificate = conform(subject(), cycles=CYCLES, only=most_rules)
    assert certificate.passed, str(certificate)


def lagging() -> Subject:
    return Subject(
        "lags", make=Lags, outputs=(Output("out", 5, 0, 255),), inputs=(Input("in"),), loopbacks=(("out", "in"),),
        refused=("none",), settle=0.3,
    )  # fmt: skip


@pytest.mark.parametrize("rule", ["directions", "block read", "block failures", "glitch"])
def test_an_input_that_comes_slowly_to_its_level_is_not_blamed_for_it(rule: str) -> None:
    """Its output is elsewhere as the rule begins."""
    Lags().write(Lags.CHANNELS["out"], 250)
    certificate = conform(lagging(), only=[rule], cycles=CYCLES)
    assert not certificate.failed, str(certificate)


@pytest.mark.full
def test_a_driver_of_a_slow_loop_back_passes() -> None:
    certificate = conform(lagging(), cycles=CYCLES)
    assert certificate.passed, str(certificate)
    assert "in comes to a level through those in between" in certificate.finding("glitch").why


def test_a_glitch_is_seen_through_a_loop_back_that_comes_slowly_to_its_level() -> None:
    class OverTheTop(Lags):
        """Reset goes over the highest level."""

        def reset(self, channel: Channel, default: int | None) -> None:
            if default is not None:
                self.write(channel, channel.highest)
                sleep(self.TIME)
            super().reset(channel, default)

    found = conform(replace(lagging(), make=OverTheTop), only=["glitch"]).finding("glitch")
    assert found.verdict is Judgement.FAILED, found


@pytest.mark.full
def test_a_loop_back_that_follows_late_and_with_noise_passes() -> None:
    with careful(
        Noisy, wire=0.004, inputs=(Input("in:0"), Input("in:9")), levels=None,
        agree=lambda one, raw, other, seen: 0 <= seen - raw <= 2 if one == "out:0" else raw == seen,
    ) as subject:  # fmt: skip
        lines = ["late answer", "short answer", "garbled answer", "error answer", "answer in pieces", "long run"]
        certificate = conform(subject, only=lines, cycles=100)
    assert {each.verdict for each in certificate.findings} == {Judgement.PASSED}, str(certificate)


def test_a_loop_back_that_takes_longer_than_a_cycle_passes_the_long_run() -> None:
    with careful(wire=0.004) as subject:
        certificate = conform(subject, only=["long run"], cycles=400)
    assert "in:0: compared only sometimes" in certificate.finding("long run").why
    assert certificate.passed, str(certificate)


@pytest.mark.parametrize("driver", first(2, [SensorsOnly, OutputsOnly, EventsOnly]))
def test_a_refused_channel_is_used_in_the_directions_that_the_driver_has(driver: type[Careful]) -> None:
    reads = driver is SensorsOnly
    channels: dict[str, Any] = {"inputs": INPUTS, "outputs": ()} if reads else {"inputs": (), "outputs": OUTPUTS[1:]}
    if driver is EventsOnly:
        channels["outputs"] = (Output("out:1"),)
    refused = ("in:40",) if reads else ("out:40",)
    with careful(driver, loopbacks=(), refused=refused, levels=None, **channels) as subject:
        certificate = conform(subject, only=["process", "memory", "error answer", "retry", "kind of errors"], cycles=20)
    assert not certificate.failed, str(certificate)


def test_an_error_answer_that_comes_too_late_on_a_busy_computer_is_waited_for() -> None:
    class Busy(OutputsOnly):
        """Nothing that the device refuses is read in time, unless there is more than the short timeout."""

        def check(self, channels: Any, answer: Any) -> None:
            if self.timeout <= HASTE and channels[0].text == "out:40":
                raise DeviceTimeout("timed out")
            super().check(channels, answer)

    with careful(Busy, outputs=OUTPUTS, inputs=(), loopbacks=(), refused=("out:40",)) as subject:
        found = conform(subject, only=["error answer"]).finding("error answer")
    assert found.verdict is Judgement.PASSED, found


@pytest.mark.parametrize(("what", "rule"), [
    ("its readings are as old as the call before", "ages"),
    ("it has the device alone from its first call on", "vanish"),
    ("its channels must be initialised", "patience"),
    ("its channels must be initialised", "fresh"),
    ("its channels must be initialised", "levels kept"),
    ("its channels must be initialised", "end"),
])  # fmt: skip
def test_a_rule_that_accused_a_correct_driver_passes(what: str, rule: str) -> None:
    with ODD[what]() as subject:
        found = conform(subject, only=[rule], cycles=CYCLES).finding(rule)
    assert found.verdict is Judgement.PASSED, found


def test_what_is_left_of_a_cut_answer_may_be_whole_frames_where_the_device_sends_by_itself() -> None:
    def half(answer: bytes) -> bytes:
        return answer[: len(answer) // 2]

    cut = _of_a_stream(Spoilt("half", half, blind=True, tries=1))
    assert (cut.blind, cut.tries) == (False, TRIES)
    assert _of_a_stream(Spoilt("nothing", lambda answer: b"", blind=True)).blind
    assert _of_a_stream(Spoilt("noise", lambda answer: b"\x95" * len(answer), blind=True)).blind


def test_a_record_that_jitters_around_the_level_before_is_straight() -> None:
    recorded = iter(([100], [101, 99, 7]))
    subject = Subject(
        "jitters", make=Memory, outputs=(Output("wide", 100, 0, 255),), levels=lambda text: next(recorded),
        agree=lambda one, raw, other, seen: abs(raw - seen) <= 1,
    )  # fmt: skip
    context = RuleContext(subject, CYCLES, Budget(60.0, chosen_rules(None)))
    with context.straight({subject.outputs[0]: 7}, "a write"):
        pass
