"""Every code block of the documentation runs, so that it cannot rot."""

from __future__ import annotations

import re
import shlex
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner

from helpers.documents import PAGES, ROOT, blocks, write_files
from helpers.patient import patient
from helpers.tiers import some
from umo_command.app import app

LONG = {"furnace.md", "ztheta.md", "howto-late-periods.md", "howto-inject-faults.md", "howto-write-a-driver.md"}
LONG |= {"howto-command-a-running-machine.md", "batch.md", "conveyor.md", "driver-fmu.md", "howto-tune.md"}
LONG |= {"howto-replay.md", "howto-prove-a-driver.md", "howto-recordings.md", "howto-stop-safely.md"}
"""Pages whose blocks take seconds: whole runs of stations, a whole certificate, real time."""


@pytest.fixture(autouse=True)
def in_an_empty_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[None]:
    """The modules of a page do not stay."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    yield
    for name, module in list(sys.modules.items()):
        if str(getattr(module, "__file__", None)).startswith(str(tmp_path)):
            del sys.modules[name]


@pytest.mark.parametrize("page", some(lambda page: page.name not in LONG, PAGES), ids=lambda page: page.name)
def test_the_python_of_a_page_runs_from_top_to_bottom(page: Path, tmp_path: Path) -> None:
    """A block that names a file imports what it uses; the others of a page share a namespace. Those for a notebook are
    run by tests/clients/remote/test_notebook.py, those for a controller by
    tests/generate/split/test_link_conformance.py."""
    write_files(page, tmp_path)
    namespace: dict[str, object] = {"__name__": page.stem.replace("-", "_")}
    for rest, text in blocks(page, "python"):
        if rest in ("notebook", "controller"):
            continue
        text = text.replace('umo.start("ztheta", ', f'umo.start("ztheta", {str(patient("ztheta", tmp_path))!r}, ')
        own = {"__name__": rest.removesuffix(".py")} if "." in rest else namespace
        exec(compile(text, f"{page.name} {rest}", "exec", dont_inherit=True), own)
        namespace |= own


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_the_toml_of_a_page_is_toml(page: Path) -> None:
    for _, text in blocks(page, "toml"):
        assert tomllib.loads(text)


def test_the_readme_has_at_most_900_words() -> None:
    assert len((ROOT / "README.md").read_text("utf-8").split()) <= 900


def test_contributing_has_every_room() -> None:
    rooms = {each.name for each in (ROOT / "src" / "umo").iterdir() if (each / "__init__.py").is_file()}
    assert set(re.findall(r"^\| `(\w+)` \|", (ROOT / "CONTRIBUTING.md").read_text("utf-8"), re.M)) == rooms


def test_the_index_leads_to_every_page() -> None:
    """The pages of one driver or face are named by `drivers.md` and `howto-faces.md`."""
    docs = ROOT / "docs"
    read = "".join((docs / name).read_text("utf-8") for name in ("README.md", "drivers.md", "howto-faces.md"))
    named = {link.partition("#")[0] for link in re.findall(r"\]\(([^)]+)\)", read)}
    included = {"index.md", "README.md", "security.md", "contributing.md", "changelog.md"}
    assert {page.name for page in docs.glob("*.md")} - included <= named


def test_the_glossary_is_in_alphabetical_order() -> None:
    rows = next(page for page in PAGES if page.name == "glossary.md").read_text("utf-8").splitlines()
    terms = [row.split("|")[1].strip().lower() for row in rows if row.startswith("| ")][2:]
    assert terms == sorted(terms)
    assert len(terms) > 50


@pytest.mark.slow
@pytest.mark.parametrize("page", some(lambda page: page.name not in LONG, PAGES), ids=lambda page: page.name)
def test_the_commands_of_a_page_do_what_they_say(page: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Lines `$ umo ...` of ```console blocks, but for those that run on."""
    write_files(page, tmp_path)
    for _, text in blocks(page, "console"):
        for line in re.findall(r"^\$ umo (.*?)(?:\s+#.*)?$", text, re.M):
            words = shlex.split(line)
            if words[:2] == ["device", "plant"] or "modbus" in words or "--realtime" in words:
                continue
            for name in ("objects", "control", "application", "plant"):
                monkeypatch.delitem(sys.modules, name, raising=False)
            result = CliRunner().invoke(app, words)
            assert result.exit_code == 0, f"{page.name}: umo {line}\n{result.output}{result.stderr}"
