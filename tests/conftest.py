"""What all tests share: hypothesis without deadlines (the machines that run this are shared), both image forms."""

import pytest
from hypothesis import HealthCheck, settings

settings.register_profile("umo", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("umo")


@pytest.fixture(params=["lists", "arrays"])
def both_forms(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """The test runs twice, once with each form of the process image."""
    monkeypatch.setattr("umo.cycle.forms.ARRAYS_FROM", 0 if request.param == "arrays" else 10**9)
