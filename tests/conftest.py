"""What all tests share: hypothesis without deadlines (the machines that run this are shared), both image forms."""

from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

settings.register_profile("umo", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("umo")


@pytest.fixture(params=["lists", "arrays"])
def both_forms(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """The test runs twice, once with each form of the process image."""
    monkeypatch.setattr("umo.cycle.forms.ARRAYS_FROM", 0 if request.param == "arrays" else 10**9)


@pytest.fixture(autouse=True)
def own_folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What umo keeps of runs and shows of running machines goes to a folder of the test, not to the user's."""
    monkeypatch.setenv("UMO_STATE", str(tmp_path / "umo-state"))
    monkeypatch.setenv("UMO_FRAMES", str(tmp_path / "umo-frames"))
