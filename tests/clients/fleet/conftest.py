"""What the tests of a fleet share."""

from __future__ import annotations

from pathlib import Path

import pytest


@pytest.fixture(autouse=True)
def folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Frames, state and settings of a test are its own."""
    for name in ("UMO_FRAMES", "UMO_STATE", "XDG_CONFIG_HOME"):
        monkeypatch.setenv(name, str(tmp_path / name.lower()))
    roles = tmp_path / "xdg_config_home" / "umo" / "roles.toml"
    roles.parent.mkdir(parents=True, exist_ok=True)
    roles.write_text('[unverified]\nfleet = "maintain"\n')
