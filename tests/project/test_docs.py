"""Every code block of the documentation runs, so that it cannot rot."""

from __future__ import annotations

import re
import shlex
import sys
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from typer.main import get_command
from typer.testing import CliRunner

from helpers.documents import PAGES, ROOT, blocks, write_files
from helpers.patient import patient
from helpers.tiers import some
from umo.process.station import find
from umo_command.app import app
from umo_command.station_options import options_of

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


# Options in the text -------------------------------------------------------------------------------------------

OF_OTHERS = {
    *("--fault-at", "--peak", "--soak", "--model"),  # of stations and of the driver fmu
    *("--umo-certificates", "--shard", "--replay", "--planted", "--tree", "--survivors-of", "--markdown"),
}
"""Options of pytest's plug-in, of make and of tools, and of stations and drivers that are not asked for theirs here."""
OTHER_PROGRAM = re.compile(r"`(python -m (bench|tools)|make )|`--(kills|compiled)`")
OLD = "moving-from-0.1.md"
STATIONS = ("batch", "conveyor", "furnace", "ztheta")


@cache
def options_of_umo() -> set[str]:
    """The options of every command, and of the machines, applications and drivers of the stations that umo has."""
    waiting: list[Any] = [get_command(app)]
    found = set(OF_OTHERS)
    while waiting:
        command = waiting.pop()
        waiting += getattr(command, "commands", {}).values()
        found |= {option for each in command.params for option in (*each.opts, *each.secondary_opts)}
    for station in STATIONS:
        for wiring in (found_station := find(station)).wirings:
            found |= {option.flag for option in options_of(found_station, wiring)}
    return found


@pytest.mark.parametrize("page", [page for page in PAGES if page.name != OLD], ids=lambda page: page.name)
def test_the_options_that_a_page_names_are_options_of_umo(page: Path) -> None:
    text = re.sub(r"^```.*?^```", "", page.read_text("utf-8"), flags=re.M | re.S)
    spans = [span for span in re.findall(r"`[^`\n]*`", text) if not OTHER_PROGRAM.match(span)]
    named = {option for span in spans for option in re.findall(r"(?<![\w-])--[a-z][a-z-]*", span)}
    assert named <= options_of_umo()
