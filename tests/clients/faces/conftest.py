"""The faces, each with clients of other projects. Of them make test runs those with the mark smoke."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest

from helpers import tiers

HERE = f"{Path(__file__).parent}{os.sep}"


@pytest.hookimpl(tryfirst=True)
def pytest_pycollect_makemodule(module_path: Path, parent: pytest.Collector) -> pytest.Module | None:
    """What OPC UA and EPICS import takes half a second."""
    return tiers.LeftOut.from_parent(parent, path=module_path) if tiers.has_no_smoke(module_path) else None


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if str(item.path).startswith(HERE) and not item.get_closest_marker("smoke"):
            item.add_marker(pytest.mark.full)


@pytest.fixture(autouse=True)
def folders(tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Frames, state and settings of a test are its own."""
    monkeypatch.setenv("UMO_FRAMES", str(tmp_path / "frames"))
    monkeypatch.setenv("UMO_STATE", str(tmp_path / "state"))
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    roles = tmp_path / "config" / "umo" / "roles.toml"
    roles.parent.mkdir(parents=True)
    roles.write_text('[unverified]\nhomeassistant = "maintain"\nsparkplug = "maintain"\n')
