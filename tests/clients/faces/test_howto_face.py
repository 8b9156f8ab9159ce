"""`umo new face`, and the face of docs/howto-write-a-face.md: it keeps the contract of faces."""

from __future__ import annotations

import asyncio
import importlib
import sys
from collections.abc import Callable, Iterator
from importlib.resources import files
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from typer.testing import Result

from helpers.documents import ROOT, blocks
from umo.clients.faces.conformance import RULES, try_rule
from umo_command.new.templates import make_face

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="frames need Linux")


@pytest.fixture(autouse=True)
def folders(tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("UMO_FRAMES", str(tmp_path / "frames"))
    monkeypatch.setenv("UMO_STATE", str(tmp_path / "state"))


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ModuleType]:
    """The tests that `umo new face` has written, with the face."""
    folder = tmp_path_factory.mktemp("face")
    make_face("my_lines", folder)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(folder))
        yield importlib.import_module("test_my_lines")
        for name in ("my_lines", "test_my_lines"):
            sys.modules.pop(name, None)


QUICK = ("kinds", "refusals", "users")


@pytest.mark.parametrize(
    "name", [each if each in QUICK else pytest.param(each, marks=pytest.mark.full) for each in RULES]
)
def test_a_new_face_keeps_the_contract(made: ModuleType, name: str) -> None:
    assert asyncio.run(try_rule(made.TRIED, RULES[name])) in (None, "")


def test_the_face_of_the_page_is_the_one_that_is_made() -> None:
    page = dict(blocks(ROOT / "docs" / "howto-write-a-face.md", "python"))["json_lines.py"].replace(
        "JsonLines", "MyFace"
    )
    template = (files("umo_command") / "template" / "face" / "my_face.py").read_text("utf-8")
    assert template.partition("from __future__ import annotations\n")[2].strip() == page.strip()


def test_a_face_is_not_written_over_another_file(umo: Callable[..., Result], tmp_path: Path) -> None:
    assert umo("new", "face", "some_lines").exit_code == 0
    result = umo("new", "face", "some_lines")
    assert (result.exit_code, "some_lines.py exists; nothing was written" in result.stderr) == (2, True)
    assert "try json_face" in umo("new", "face", "json").stderr
