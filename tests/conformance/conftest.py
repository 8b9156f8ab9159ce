"""Certificates are compared with the page of the docs. `make test` tries a few rules on each
counterpart, `make test-all` every rule."""

from __future__ import annotations

import pytest

from helpers.certificates import the_page_agrees
from helpers.tiers import first

__all__ = ["rules", "the_page_agrees"]
SMOKE = ["channels", "initialise", "reset", "finalise", "range", "directions", "block read", "block write"]
"""Rules that take little time, with a device in good order."""


@pytest.fixture(params=first(1, [SMOKE, None]), ids=["smoke", "certificate"])
def rules(request: pytest.FixtureRequest) -> list[str] | None:
    """The `only` of a trial."""
    chosen: list[str] | None = request.param
    return chosen
