"""The kit can fail: of each broken driver it names the broken rule."""

from __future__ import annotations

import gc
import logging
import os
import socket
import sys
from collections.abc import Iterator
from typing import Any

import pytest

from conformance import broken, mutants
from conformance.careful import Careful
from conformance.mutants import MUTANTS, Mutant
from conformance.subjects import careful
from umo.testing.conformance import (
    Certificate,
    Judgement,
    all_rules,
    conform,
    driver_factory,
    leak_rules,
    runner,
    timing_rules,
)

ENOUGH_TO_GROW = 300
HANGING = 1.0
"""s after which a call counts as hanging: it costs this time only where it hangs."""
HEARTBEATS = (
    "two channels of a block are exchanged",
    "readings above 127 are negative",
    "a refused write to an input is what it reads from then on",
    "the environment has another value",
    "the last good reading for a garbled answer",
    "a garbled write is tried again",
    "header and rest have a deadline each",
    "Ctrl-C is a failure",
    "every reading makes a cycle of references",
    "readings are kept for 200 ms",
    "a look takes a connection for an answer",
    "a look never decides that a device is away",
    "the answer to a look is taken for that of the next call",
    "blocks give the readings of the same block before",
    "connecting again writes the last levels",
    "opened again it goes over the highest level",
    "a greeting of the device hides a retry of writes",
    "a thread of all drivers spins once one is closed",
    "the multiplexer is where the last single reading left it",
    "the watchdog is armed once only",
    "ages of readings that are kept are zero",
    "the scale of an input is that of ten times the range",
    "the report switches an output off",
    "the watchdog takes any time",
    "an answer without its last byte is taken for whole",
    "the devices are one text",
    "reset of an input writes zero to an output",
    "it replaces the sockets of the process",
    "a block of two requests succeeds if the first is answered: writes",
    "a block stores numbers with a fraction",
    "a block names all of its channels while the device is away",
    "reading strobes an output",
    "the gaps of a block of writes are zero",
    "an initialise that failed is not made again",
    "only changes are sent, also over a new connection",
    "a connection that is reset gives the reading before",
    "stop_waiting closes it before its outputs were reset",
    "its socket is inherited by child processes",
    "inspect has a timeout of its own",
    "a block of writes is not sent if it equals the one kept, which is the caller's own",
    "the checksum of an answer that says failed is not verified",
    "a report empties what it counts",
    "the garbage collector of the process is switched off",
    "a block of writes leaves out what the last one has confirmed, also on a new connection",
    "a block of writes leaves out the levels of the last one, whether that succeeded or not",
    "a thread asks the device ten times within the time of its watchdog",
    "an answer with a sound head and a wrong checksum is asked for once more",
    "the block before is given for as long as the device is silent, with an age of zero",
    "the first reading on a new connection is that of the channel before",
    "the start of an answer that was cut short stays in the buffer of the driver",
    "the context of decimal numbers gets five digits",
    "it puts its folder in front of the places of modules",
    "a lock is still held after a call that failed",
    "Ctrl-C is a failure while the answer is waited for",
    "a report is that of the call before",
    "it takes its channel for still selected, and another client has selected another",
    "ages of readings that are kept are zero",
    "ages hang on the clock of the day, and none is below 0",
    "a call while a look is under way leaves the connection of that open",
    "a number with a zero in front is another channel",
    "a report that has failed once is empty for ever",
    "close says goodbye, and a failure of that leaves the socket",
)
"""Those that `make test` tries, with their rule alone. What closes a number that another thread of the process may have
got is tried in make test-all."""


@pytest.fixture(autouse=True)
def nothing_left(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """What the broken drivers leave behind on purpose ends here."""
    monkeypatch.setenv("UMO_BROKEN", "not yet")
    folder, handlers, places = os.getcwd(), logging.root.handlers[:], sys.path[:]
    yield
    os.chdir(folder)
    sys.path[:] = places
    logging.root.handlers[:] = handlers
    socket.setdefaulttimeout(None)
    gc.enable()
    broken.LeaksThreads.end.set()
    broken.LeaksThreads.end.clear()
    for leaky in (broken.LeaksSockets, broken.LeaksWhenItCannotConnect):
        while leaky.left_open:
            leaky.left_open.pop().close()
    for connection in broken.SharesItsConnection.shared.values():
        if connection is not None:
            connection.close()
    broken.SharesItsConnection.shared.clear()


@pytest.fixture(autouse=True)
def what_is_broken_is_found_soon(monkeypatch: pytest.MonkeyPatch) -> None:
    """What hangs, and what is not closed: no driver here has to be waited for that long."""
    monkeypatch.setattr(runner, "HANG", HANGING)
    monkeypatch.setattr(leak_rules, "MAX_CLOSING_TIME", 0.5)


ENOUGH_TO_GREET = 0.4
"""s for another connection, a greeting, and the request that is sent again, also on a busy computer."""


def tried(driver: type[Careful], cycles: int, only: list[str] | None = None, **changes: Any) -> Certificate:
    with careful(driver, **changes) as subject:
        return conform(subject, cycles=cycles, only=only)


def test_there_are_more_than_a_hundred_broken_drivers_for_all_rules_that_a_driver_can_break() -> None:
    found = {*broken.BREAKS.values(), *(each.rule for each in MUTANTS.values())}
    assert len(broken.BREAKS) + len(MUTANTS) > 100
    assert {rule.id for rule in all_rules()} - found == {"errors are named"}  # umo takes care of them


@pytest.mark.filterwarnings("ignore:unclosed:ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("words", HEARTBEATS)
def test_a_rule_that_is_broken_fails(words: str) -> None:
    mutant = MUTANTS[words]
    changes = {"timeout": ENOUGH_TO_GREET} if "greeting" in words else {}
    certificate = tried(mutant.driver(), mutant.cycles, [mutant.rule], **changes)
    assert certificate.finding(mutant.rule).verdict is Judgement.FAILED, str(certificate)
    assert certificate.finding(mutant.rule).why


def test_a_missing_last_answer_is_found_although_a_call_before_was_answered_once_more(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    further, right = iter([0, 1, 0, 1]), timing_rules._answers
    monkeypatch.setattr(timing_rules, "_answers", lambda context, call: right(context, call) + next(further, 0))
    mutant = MUTANTS["a block of two requests succeeds if the first is answered: writes"]
    assert tried(mutant.driver(), mutant.cycles, ["timeout"]).finding("timeout").verdict is Judgement.FAILED


@pytest.mark.parametrize(
    "driver",
    (
        broken.ReadsItsOwnCopyOfOutputs,
        broken.PrintsItsFailures,
        broken.PulsesWhenItIsReset,
        broken.TimesOutAsWhenItWasOpened,
    ),
)
def test_a_rule_is_broken_also_where_no_record_shows_a_pulse(
    driver: type[Careful], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(driver_factory, "UNCONTROLLED_TIMEOUT", 0.5)  # the timeout of one that keeps its first one
    rule = broken.BREAKS[driver]
    with careful(driver, **({"levels": None} if rule == "glitch" else {})) as subject:
        found = conform(subject, only=[rule]).finding(rule)
    assert found.verdict is Judgement.FAILED, found


def is_named(rule: str, certificate: Certificate) -> bool:
    """Whether the rule is one that failed, or is said to fail as one that did, from the same cause. A driver that hangs
    has failed the rule that was tried then."""
    finding, failed = certificate.finding(rule), certificate.failed
    told = finding.why.startswith(tuple(f"as above ({each.rule})" for each in failed))
    hangs = finding.why.startswith("the driver hangs") and any("did not end within" in each.why for each in failed)
    return finding.verdict is Judgement.FAILED or told or hangs


@pytest.mark.full
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # a destructor that fails on purpose
@pytest.mark.parametrize("mutant", MUTANTS.values(), ids=lambda mutant: mutant.words.replace(" ", "-"))
def test_the_kit_names_the_rule_that_a_mutant_breaks(mutant: Mutant) -> None:
    certificate = tried(mutant.driver(), mutant.cycles)
    assert is_named(mutant.rule, certificate), str(certificate)
    assert certificate.status == "FAILED"


@pytest.mark.full
@pytest.mark.filterwarnings("ignore:unclosed:ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("driver", broken.BREAKS)
def test_the_kit_names_the_rule_that_a_broken_driver_breaks(driver: type[Careful]) -> None:
    cycles = ENOUGH_TO_GROW if driver is broken.Grows else mutants.QUICK
    certificate = tried(driver, cycles)
    assert is_named(broken.BREAKS[driver], certificate), str(certificate)


def test_a_driver_that_hangs_ends_the_trial_and_its_outputs_are_at_their_defaults() -> None:
    with careful(broken.WaitsForEver) as subject:
        certificate = conform(subject, cycles=20, only=["timeout", "patience", "end"])
        assert subject.levels is not None
        assert [subject.levels(output.channel)[-1] for output in subject.outputs] == [5, 0, 0]
    assert "did not end within" in certificate.finding("timeout").why
    assert certificate.finding("patience").why.startswith("the driver hangs in ")
    assert certificate.unreached == ()
