"""`umo connect face`: which faces there are, and a face of one's own."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import Result

Umo = Callable[..., Result]
LAMP = '''
from umo.errors import OptionError
from umo.clients.faces.face import Face

class Lamp(Face):
    """It is never made."""

    async def begin(self, machine, commands): ...

    async def frames(self, changes): ...

    async def end(self, why): ...

    def __init__(self, colour: str = "red") -> None:
        raise OptionError(f"there is no {colour} lamp")
'''


@pytest.fixture(autouse=True)
def own_path(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.setenv("UMO_FRAMES", str(tmp_path / "frames"))


def test_a_face_of_the_current_folder_is_served_by_module_and_class(
    umo: Umo, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "lamp_of_a_test.py").write_text(LAMP)
    monkeypatch.chdir(tmp_path)
    name = "lamp_of_a_test:Lamp"
    result = umo("connect", "face", name, "--set", f"{name}.colour=green")
    assert (result.exit_code, result.stderr.splitlines()[-1]) == (
        2,
        f"umo: the command line: faces.{name}: there is no green lamp",
    )


@pytest.mark.parametrize(("name", "near"), [("OPCUA", "opcua"), ("promethues", "prometheus")])
def test_a_name_that_is_no_face_has_the_nearest_one(umo: Umo, name: str, near: str) -> None:
    result = umo("connect", "face", name)
    assert result.exit_code == 2 and f"did you mean {near!r}?" in result.stderr


def test_the_help_names_the_faces(umo: Umo) -> None:
    from umo.clients.faces.face_registry import known_faces

    text = umo("connect", "face", "--help").stdout
    assert set(known_faces()) <= set(text.replace(",", " ").split())
