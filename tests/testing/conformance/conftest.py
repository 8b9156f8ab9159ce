"""`make test` tries a few rules on each counterpart, `make test-all` every rule."""

from __future__ import annotations

import pytest

from helpers.tiers import first, named

SMOKE = ["channels", "answers", "initialise", "reset", "finalise", "range", "directions", "block read", "block write"]
"""Rules that take little time, with a device in good order."""


@pytest.fixture(params=first(1, named(["smoke", "certificate"], [SMOKE, None])))
def rules(request: pytest.FixtureRequest) -> list[str] | None:
    """The `only` of a trial."""
    chosen: list[str] | None = request.param
    return chosen
