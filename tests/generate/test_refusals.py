"""What cannot be translated is refused before anything runs, with its line, the reason and the nearest thing that does:
a program for each refusal, a file each in the folder `refusals`."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from helpers.refused_programs import FOLDER, Reached, expected, places, told
from helpers.side_by_side import Rig, connected_rig

FILES = sorted(FOLDER.glob("*.py"))
WITHOUT_A_PROGRAM = 7
"""Places that refuse something that no program of this kind reaches: homing and objects that the rig does not have,
what only compiled laws refuse, and what an earlier refusal forestalls."""


@pytest.fixture(scope="module")
def rig() -> Iterator[Rig]:
    with connected_rig() as (machine, _):
        yield machine


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_it_is_refused_with_line_reason_and_nearest(file: Path, rig: Rig) -> None:
    found = told(file, rig)
    assert found and found == expected(file)


def test_every_refusal_has_a_program(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    reached = Reached(monkeypatch)
    for file in FILES:
        told(file, rig)
    missing = sorted({*places()} - reached.places)
    assert len(missing) == WITHOUT_A_PROGRAM, missing
