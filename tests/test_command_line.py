"""The help of every command, and the page that is made of it."""

from __future__ import annotations

import pytest
import typer
from typer.testing import CliRunner

from tools.command_line import PAGE, page
from umo.cli.app import app
from umo.exit_status import ExitStatus

COMMANDS = typer.main.get_command(app).commands  # type: ignore[attr-defined]


@pytest.mark.parametrize("name", COMMANDS)
def test_the_help_of_a_command_has_examples_and_exit_statuses(name: str) -> None:
    result = CliRunner().invoke(app, [name, "--help"])
    shown = " ".join(result.stdout.split())
    assert result.exit_code == 0
    assert f"Examples: umo {name}" in shown
    assert "Exit status: 0 " in shown


def test_the_page_of_the_command_line_is_made_of_the_help() -> None:
    assert PAGE.read_text("utf-8") == page(), "the help has changed: python tools/command_line.py"


def test_the_page_names_every_status() -> None:
    rows = [line.split("|")[1].strip() for line in page().splitlines() if line.startswith("| ")]
    for status in ExitStatus:
        assert str(status) in rows
