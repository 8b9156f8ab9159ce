"""The help of every command, and the page that is made of it."""

from __future__ import annotations

import pytest
import typer
from typer.testing import CliRunner

from tools.command_line import PAGE, page
from umo.cli.app import app
from umo.cli.shared import keep_only
from umo.exit_status import ExitStatus

COMMANDS = typer.main.get_command(app).commands  # type: ignore[attr-defined]


@pytest.mark.parametrize("name", COMMANDS)
def test_the_help_of_a_command_has_examples_and_exit_statuses(name: str) -> None:
    result = CliRunner().invoke(app, [name, "--help"])
    shown = " ".join(result.stdout.split())
    assert result.exit_code == 0
    assert f"Examples: umo {name}" in shown
    assert "Exit status: 0 " in shown


@pytest.mark.parametrize("name", [*COMMANDS, "--help", "runs-of-nobody"])
def test_the_command_that_is_called_is_made_alone_and_all_for_any_other_word(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for kind in ("registered_commands", "registered_groups"):
        monkeypatch.setattr(app, kind, list(getattr(app, kind)))
    keep_only(name)
    made = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    assert list(made) == ([name] if name in COMMANDS else list(COMMANDS))


def test_the_page_of_the_command_line_is_made_of_the_help() -> None:
    assert PAGE.read_text("utf-8") == page(), "the help has changed: python tools/command_line.py"


def test_the_page_names_every_status() -> None:
    rows = [line.split("|")[1].strip() for line in page().splitlines() if line.startswith("| ")]
    for status in ExitStatus:
        assert str(status) in rows
