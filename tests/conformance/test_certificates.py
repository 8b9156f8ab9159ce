"""Drivers without a counterpart under the kit, and the page of all certificates."""

from __future__ import annotations

import re
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from conformance.subjects import simulated
from tools import certify
from umo.drivers import registry
from umo.drivers.timerfd import TimerFd
from umo.testing.conformance import Certificate, Input, Judgement, Subject, all_rules, conform


@pytest.fixture
def cycles(request: pytest.FixtureRequest) -> int:
    """Few, unless certificates are asked for."""
    return 10_000 if request.config.getoption("--certificates", default=None) else 100


def test_the_simulated_circuit(cycles: int) -> None:
    certificate = conform(simulated(), cycles=cycles)
    assert certificate.passed, str(certificate)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="timerfd is a part of Linux")
def test_the_timer(cycles: int) -> None:
    subject = Subject("timerfd", make=TimerFd, inputs=(Input("tick", steady=False),), device="the clock of Linux")
    certificate = conform(subject, cycles=min(cycles, 1000))
    assert certificate.passed, str(certificate)


# The page ---------------------------------------------------------------------------------------------


def test_the_page_states_the_rules_as_they_are() -> None:
    text = certify.PAGE.read_text("utf-8")
    for rule in all_rules():
        assert f"| {rule.id} | {rule.text} |" in text


def test_the_page_shows_whole_certificates_of_drivers_of_umo_alone(tmp_path: Path) -> None:
    whole = conform(simulated(), cycles=10)
    whole.save(tmp_path)
    conform(replace(simulated(), name="part"), only=["range"]).save(tmp_path)
    replace(whole, name="card", driver="card:Card").save(tmp_path)
    assert certify.read([tmp_path]).keys() == {"simulated"}


def test_the_page_has_a_verdict_on_every_rule_for_every_driver() -> None:
    shown = certify.verdicts(certify.PAGE.read_text("utf-8"))
    assert {re.split("[ ,]", name)[0] for name in shown} == set(registry.known()) - {"ztheta"}
    for name, marks in shown.items():
        assert marks.keys() == {rule.id for rule in all_rules()}, name
        assert set(marks.values()) <= {"passed", "-"}, name


def test_a_page_shows_what_failed_and_why_something_was_not_tried() -> None:
    certificate = conform(simulated(), cycles=10)
    text = certificate.to_json().replace('"passed"', '"failed"', 1)
    made = certify.page({"simulated": Certificate.from_json(text)})
    assert "| channels | **failed** |" in made
    assert "| late answer | - |" in made
    assert "- Not tried: timeout, patience, " in made
    assert certify.verdicts(made)["simulated"]["channels"] == "**failed**"


def test_a_reason_that_is_not_that_of_all_certificates_of_a_driver_names_them() -> None:
    certificate = conform(simulated(), cycles=10)
    quiet = "no channel is known that the device refuses"
    other = replace(certificate, name="simulated, other", findings=tuple(
        replace(each, why="", verdict=Judgement.PASSED) if each.why == quiet else each for each in certificate.findings
    ))  # fmt: skip
    made = certify.page({each.name: each for each in (certificate, other)})
    assert f"- Not tried: block failures, error answer (simulated): {quiet}." in made
    assert certify.verdicts(made) == {each.name: certify.marks(each) for each in (certificate, other)}


def test_without_certificates_the_page_is_left_alone(tmp_path: Path, capsys: Any) -> None:
    before = certify.PAGE.read_text("utf-8")
    assert certify.main([str(tmp_path)]) == 2
    assert "there are no certificates" in capsys.readouterr().err
    assert certify.PAGE.read_text("utf-8") == before
