"""The kit can fail: of each broken driver it names the broken rule, and no other one."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from conformance import broken
from conformance.careful import Careful
from conformance.subjects import careful
from umo.testing.conformance import Judgement, all_rules, conform, examine, leak_rules

ENOUGH_TO_GROW = 300
QUICK = 20


@pytest.fixture(autouse=True)
def nothing_left() -> Iterator[None]:
    """What the broken drivers leak on purpose ends here."""
    yield
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
    monkeypatch.setattr(examine, "HANG", 0.5)
    monkeypatch.setattr(leak_rules, "FADE", 0.5)


@pytest.fixture(autouse=True)
def not_for_the_page(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(examine, "on_certificate", [])


def test_there_are_more_than_twenty_broken_drivers_for_all_rules_that_a_driver_can_break() -> None:
    assert len(broken.BREAKS) >= 20
    unbroken = {rule.id for rule in all_rules()}.difference(*broken.BREAKS.values())
    assert unbroken == {"errors are named", "time"}  # of the first umo takes care, the others are below


def test_the_careful_driver_keeps_every_rule() -> None:
    with careful() as subject:
        certificate = conform(subject, cycles=QUICK)
    assert {each.verdict for each in certificate.findings} == {Judgement.PASSED}, str(certificate)


@pytest.mark.parametrize("driver", broken.BREAKS, ids=lambda driver: driver.__name__)
def test_a_rule_that_is_broken_fails(driver: type[Careful]) -> None:
    """Of several, one may be seen by what the driver does in the trial of others only."""
    rules = broken.BREAKS[driver]
    with careful(driver) as subject:
        certificate = conform(subject, only=rules, cycles=ENOUGH_TO_GROW if driver is broken.Grows else QUICK)
    assert certificate.failed, str(certificate)
    assert {each.rule for each in certificate.failed} <= rules, str(certificate)


@pytest.mark.full
@pytest.mark.parametrize("driver", broken.BREAKS, ids=lambda driver: driver.__name__)
def test_the_kit_names_the_rule_that_is_broken_and_no_other(driver: type[Careful]) -> None:
    with careful(driver) as subject:
        certificate = conform(subject, cycles=ENOUGH_TO_GROW if driver is broken.Grows else QUICK)
    assert {each.rule for each in certificate.failed} == broken.BREAKS[driver], str(certificate)
    assert not certificate.passed
    assert all(each.why for each in certificate.failed)


def test_a_driver_that_hangs_ends_the_trial_and_its_outputs_are_at_their_defaults() -> None:
    with careful(broken.WaitsForEver) as subject:
        certificate = conform(subject, cycles=QUICK)
        assert subject.levels is not None
        assert [subject.levels(output.channel)[-1] for output in subject.outputs] == [5, 0, 0]
    assert "did not end within" in certificate.finding("timeout").why
    assert certificate.finding("range").why.startswith("the driver hangs in read of")
    assert certificate.unreached == ()
