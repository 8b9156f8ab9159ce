"""`make test` tries a few rules on each counterpart, `make test-all` every rule."""

from __future__ import annotations

import pytest

from helpers.tiers import first, named
from umo.testing.conformance import all_rules

SMOKE = ["channels", "answers", "initialise", "reset", "finalise", "range", "directions", "block read", "block write"]
"""Rules that take little time, with a device in good order."""


WAITING = ["idle", "reopen"]
"""Rules that wait for seconds, whatever the driver."""


@pytest.fixture(params=first(1, named(["without waiting", "certificate"], [WAITING, []])))
def most_rules(request: pytest.FixtureRequest) -> list[str]:
    """The `only` of a trial of a driver without a counterpart: `make test` leaves out what waits."""
    return [rule.id for rule in all_rules() if rule.id not in request.param]


@pytest.fixture(params=first(1, named(["smoke", "certificate"], [SMOKE, None])))
def rules(request: pytest.FixtureRequest) -> list[str] | None:
    """The `only` of a trial."""
    chosen: list[str] | None = request.param
    return chosen
