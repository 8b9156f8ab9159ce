"""The conformance kit of umo in pytest: one test for each rule, and certificates as files.

    import pytest
    from umo.testing.conformance import Output, Subject

    @pytest.fixture(scope="module")
    def umo_subject():
        with my_device() as device:
            yield Subject(name="my driver", make=lambda: MyDriver(port=device.port), outputs=(Output("dac:0"),))

    def test_conformance(umo_conformance):
        umo_conformance.check()

`pytest --umo-certificates DIR` writes each certificate that a test makes, by this fixture or by `conform`, to
DIR/NAME.json. `--umo-minutes N` is the time budget for each subject (default: 0.5).

A second Ctrl-C or SIGTERM ends a test whose machine does not end by itself, and the session with it, with the status of
the signal (130, 143).

The module stands beside the package, and imports umo only where it is used: pytest loads plug-ins in every project of
an environment.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from umo.testing.conformance import Certificate, Finding

FIXTURE = "umo_conformance"


@dataclass(frozen=True)
class RuleTest:
    """One rule on the subject."""

    finding: Finding
    certificate: Certificate

    def check(self) -> None:
        """Fails if the driver breaks the rule; skips the test if the rule could not be tried."""
        __tracebackhide__ = True
        if self.finding.verdict == "failed":
            pytest.fail(f"{self.certificate.name}: {self.finding.why}\n({self.finding.text})", pytrace=False)
        if self.finding.verdict == "not tried":
            pytest.skip(self.finding.why)


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("umo")
    group.addoption("--umo-certificates", metavar="DIR", help="write the certificates of tested drivers to this folder")
    group.addoption("--umo-minutes", type=float, default=0.5, metavar="N", help="time budget of the conformance kit")


def pytest_configure(config: pytest.Config) -> None:
    config.pluginmanager.register(EndedBySignal())
    folder = config.getoption("--umo-certificates")
    if folder is not None:
        from umo.testing.conformance import runner

        runner.on_certificate.append(lambda certificate: certificate.save(Path(folder)))


def pytest_unconfigure(config: pytest.Config) -> None:
    if config.getoption("--umo-certificates") is not None:
        from umo.testing.conformance import runner

        del runner.on_certificate[:1]


class EndedBySignal:
    """A session that a further signal has ended (`umo.errors.Interrupted`) has the exit status of the signal."""

    status: int | None = None

    def pytest_keyboard_interrupt(self, excinfo: pytest.ExceptionInfo[BaseException]) -> None:
        number = getattr(excinfo.value, "number", None)
        if type(excinfo.value).__module__ == "umo.errors" and isinstance(number, int):
            self.status = 128 + number

    @pytest.hookimpl(trylast=True)
    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        if self.status is not None:
            session.exitstatus = self.status


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    if FIXTURE in metafunc.fixturenames:
        from umo.testing.conformance import all_rules

        rules = [rule.id for rule in all_rules()]
        metafunc.parametrize(FIXTURE, rules, indirect=True, ids=[name.replace(" ", "-") for name in rules])


@pytest.fixture(scope="module")
def umo_certificate(umo_subject: Any, request: pytest.FixtureRequest) -> Certificate:
    """Of the fixture `umo_subject`, which has the scope of the module or of the session."""
    from umo.testing.conformance import conform

    return conform(umo_subject, minutes=request.config.getoption("--umo-minutes"))


@pytest.fixture
def umo_conformance(request: pytest.FixtureRequest, umo_certificate: Certificate) -> RuleTest:
    """The finding on one rule; the test that asks for it is repeated for each."""
    return RuleTest(umo_certificate.finding(request.param), umo_certificate)
