"""What cannot be translated is refused before anything runs, with its line, the reason and the nearest thing that does:
a program for each refusal, a file each in the folder `refusals`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import pytest

from helpers.refused_programs import FOLDER, Reached, Told, expected, places, told
from helpers.side_by_side import connected_rig

FILES = sorted(FOLDER.glob("*.py"))
WITHOUT_A_PROGRAM = 7
"""Places that refuse something that no program of this kind reaches: homing and objects that the rig does not have,
what only compiled laws refuse, and what an earlier refusal forestalls."""


@pytest.fixture(scope="module")
def reached() -> Iterator[Reached]:
    with pytest.MonkeyPatch.context() as patch:
        yield Reached(patch)


@pytest.fixture(scope="module")
def found(reached: Reached) -> Iterator[Callable[[Path], list[Told]]]:
    """What is told of the program of a file, which is translated once."""
    with connected_rig() as (machine, _):
        yield cache(lambda file: told(file, machine))


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_it_is_refused_with_line_reason_and_nearest(file: Path, found: Callable[[Path], list[Told]]) -> None:
    assert found(file) and found(file) == expected(file)


def test_every_refusal_has_a_program(found: Callable[[Path], list[Told]], reached: Reached) -> None:
    for file in FILES:
        found(file)
    missing = sorted({*places()} - reached.places)
    assert len(missing) == WITHOUT_A_PROGRAM, missing
