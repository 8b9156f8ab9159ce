"""Every certificate of a driver that docs/certificates.md shows must agree with the page. For conftest.py of the
folders whose tests run the conformance kit."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tools import certify
from umo.testing.conformance import Certificate, all_rules, examine


@pytest.fixture(autouse=True)
def the_page_agrees(request: pytest.FixtureRequest) -> Iterator[None]:
    """A rule that the page calls passed has passed here too, as far as all rules were tried. Nothing is compared while
    certificates for a new page are made."""
    made: list[Certificate] = []
    calls = examine.on_certificate  # a test may put another list in its place
    calls.append(made.append)
    try:
        yield
    finally:
        calls.remove(made.append)
    if request.config.getoption("--certificates", default=None) is not None:
        return
    shown = certify.verdicts(certify.PAGE.read_text("utf-8"))
    for certificate in made:
        if certificate.driver.startswith(certify.OWN) and len(certificate.findings) == len(all_rules()):
            assert certify.marks(certificate) == shown.get(certificate.name), (
                f"docs/certificates.md (python tools/certify.py DIR makes it): {certificate}"
            )
