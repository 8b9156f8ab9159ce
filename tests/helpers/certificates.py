"""Every certificate of a driver that docs/certificates.md shows must agree with the page. For conftest.py of the
folders whose tests run the conformance kit."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from umo.testing.conformance import Certificate, all_rules, examine

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture(scope="session")
def certify() -> Any:
    """docs/certify.py as a module."""
    spec = importlib.util.spec_from_file_location("umo_docs_certify", DOCS / "certify.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(autouse=True)
def the_page_agrees(certify: Any, request: pytest.FixtureRequest) -> Iterator[None]:
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
                f"docs/certificates.md (python docs/certify.py DIR makes it): {certificate}"
            )
