"""The conformance kit in pytest: one test for each rule, and certificates as files.

    import pytest
    from umo.testing.conformance import Output, Subject

    @pytest.fixture(scope="module")
    def subject():
        with my_device() as device:
            yield Subject(name="my driver", make=lambda: MyDriver(port=device.port), outputs=(Output("dac:0"),))

    def test_conformance(conformance):
        conformance.check()

`pytest --certificates DIR` writes each certificate that a test makes, by this fixture or by `conform`, to
DIR/NAME.json.
`--conformance-cycles N` sets the cycles of the search for leaks (default: 1,000).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pytest

from umo.testing.conformance import Certificate, Finding, Judgement, Subject, all_rules, conform, examine

FIXTURE = "conformance"


@dataclass(frozen=True)
class RuleTest:
    """One rule on the subject."""

    finding: Finding
    certificate: Certificate

    def check(self) -> None:
        """Fails if the driver breaks the rule; skips the test if the rule could not be tried."""
        __tracebackhide__ = True
        if self.finding.verdict is Judgement.FAILED:
            pytest.fail(f"{self.certificate.name}: {self.finding.why}\n({self.finding.text})", pytrace=False)
        if self.finding.verdict is Judgement.NOT_TRIED:
            pytest.skip(self.finding.why)


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("umo")
    group.addoption("--certificates", metavar="DIR", help="write the certificates of tested drivers to this folder")
    group.addoption("--conformance-cycles", type=int, default=1000, metavar="N", help="cycles in the search for leaks")


def pytest_configure(config: pytest.Config) -> None:
    folder = config.getoption("--certificates")
    if folder is not None:
        examine.on_certificate.append(lambda certificate: certificate.save(Path(folder)))


def pytest_unconfigure(config: pytest.Config) -> None:
    if config.getoption("--certificates") is not None and examine.on_certificate:
        examine.on_certificate.pop()


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    if FIXTURE in metafunc.fixturenames:
        rules = [rule.id for rule in all_rules()]
        metafunc.parametrize(FIXTURE, rules, indirect=True, ids=[name.replace(" ", "-") for name in rules])


@pytest.fixture(scope="module")
def certificate(subject: Subject, request: pytest.FixtureRequest) -> Certificate:
    """Of the fixture `subject`, which has the scope of the module or of the session."""
    return conform(subject, cycles=request.config.getoption("--conformance-cycles"))


@pytest.fixture
def conformance(request: pytest.FixtureRequest, certificate: Certificate) -> RuleTest:
    return RuleTest(certificate.finding(request.param), certificate)
