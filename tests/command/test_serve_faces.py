"""`umo connect face`: what it reads, and what it says."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from umo.errors import FramesError
from umo_command.connect import faces as serve_faces


class Running:
    """A station that runs, with a wiring."""

    def __init__(self, folder: Path) -> None:
        self.about = {"place": str(folder), "wiring": "real"}

    def __enter__(self) -> Running:
        return self

    def __exit__(self, *error: object) -> None: ...


@pytest.fixture
def said(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    told: list[str] = []
    monkeypatch.setattr(serve_faces, "say", told.append)
    return told


def station(folder: Path, text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    (folder / "wiring").mkdir()
    (folder / "wiring" / "real.toml").write_text(text)
    monkeypatch.setattr(serve_faces, "find_running", lambda name: Running(folder))


def test_the_table_of_the_wiring_that_runs_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, said: list[str]
) -> None:
    station(tmp_path, "[faces]\ncommands = true\n", monkeypatch)
    assert serve_faces._table("plant")[0] == {"commands": True}
    assert not said


def test_a_face_that_begins_before_its_station_says_that_it_has_no_table(
    monkeypatch: pytest.MonkeyPatch, said: list[str]
) -> None:
    def none(name: str | None) -> Any:
        raise FramesError("no station is running")

    monkeypatch.setattr(serve_faces, "find_running", none)
    assert serve_faces._table("plant")[0] == {}
    assert "no table [faces] is read" in said[0]


def test_a_wiring_that_cannot_be_read_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, said: list[str]) -> None:
    station(tmp_path, "[faces\n", monkeypatch)
    assert serve_faces._table("plant")[0] == {}
    assert "real.toml" in said[0]
