"""Makes docs/command-line.md of the command's own help."""

from __future__ import annotations

import argparse
from functools import cache
from pathlib import Path
from typing import Any

import typer

from umo_command.app import app
from umo_command.shared import COMMANDS, CommandLine

DOCS = Path(__file__).parents[1] / "docs"
PAGE, EXIT_STATUS = DOCS / "command-line.md", DOCS / "exit-status.md"
KINDS = {"str": "TEXT", "int": "INTEGER", "float": "NUMBER", "path": "FILE"}
HEAD = """# The command line on one page

`umo COMMAND --help` prints the same texts in the terminal; `python tools/command_line.py` makes this page from them.
`umo` alone shows the running stations and the next commands. [exit-status.md](exit-status.md) explains the exit
statuses.

## Names

A **station** is named by its folder, or by its name if it ships with umo or is installed. A **running station** is
named by its pid, its folder or its name; `umo` lists the running stations. A **wiring** (`-w`) is the name of one of
the station's wirings, or a TOML file. A **time** is a number of seconds, or a number with a unit: `"5 min"`, `500us`. A
**size** is a number with a unit: `"200 MB"`. Options of the station itself, such as `--seed 7`, follow its name;
`umo run STATION --help` shows them.

An option has one meaning everywhere:

| | |
| --- | --- |
| `--out`, `-o` | the file or folder to write |
| `--json` | print JSON |
| `--for TIME` | a duration |
| `--from TIME`, `--to TIME` | a part of a run, on the machine's clock |
| `--last TIME` | only the newest data, for this length of time |
| `--keep SIZE`, `--keep-runs NUMBER` | the size, or the number of runs, to keep: older parts or runs are removed |
| `--set NAME=VALUE` | change a value or option |
| `--wiring`, `-w` | a wiring |
| `--take` | take the lease over from another client |
| `--acknowledge` | start even if the last run on a device ended unsafely |

## Completion

`umo --install-completion` makes the shell (bash, zsh, fish) complete commands, options, stations, wirings, paths,
actions, alarms and recordings. `umo --show-completion` shows what it would install.

## What a run leaves behind

`umo run` makes the folder `runs/STATION-DATE-TIME` in the current folder.

| file | |
| --- | --- |
| `run.json` | station, wiring, options and start of the run; written at the start |
| `trace.csv` | a row for each period (of a long run each 2nd, 4th, ...), units, states; `not_good`: what is not GOOD |
| `trace-000001.csv`, ... | with `--keep SIZE`: one row for each of the latest periods, with at most SIZE in total |
| `summary.json` | status, failure, and the table printed at the end, as data; in real time written from the start |
| `plot.png` | the trace and the alarms as a picture; not drawn with `--no-plot` and after Ctrl-C |
| `failure.txt` | the whole traceback of a run that failed |

Each file is either complete or missing. If `umo run` was killed, the trace ends before the run did, and the summary,
which is written once a minute, has the state "running". If the frames could not be read to the end, the trace is
incomplete too, and the status is 4. Nothing in `runs/` is removed, except by `--keep` and `--keep-runs`.
"""


def page() -> str:
    """The whole page: the commands by panel, in the order of `umo --help`."""
    panels: dict[str, list[str]] = {}
    for name, command in leaves():
        panels.setdefault(_panel_of(name), []).append(_section(name, command))
    return HEAD + "".join(f"\n## {title}\n{''.join(sections)}" for title, sections in panels.items())


def leaves() -> list[tuple[str, Any]]:
    """Each command that does something, with its whole name: `connect certificate site`."""
    return [part for name in COMMANDS for part in _parts(name, _root().commands[name])]


@cache
def _root() -> Any:
    """Made once: typer takes 0.1 s for it."""
    return typer.main.get_command(app)


def _panel_of(name: str) -> str:
    return str(_root().commands[name.split()[0]].rich_help_panel)


def _parts(name: str, command: Any) -> list[tuple[str, Any]]:
    """The command, or its subcommands, with their whole names."""
    if not isinstance(command, CommandLine):
        return [(name, command)]
    context = typer.Context(command, parent=typer.Context(_root()))
    below = {each: command.get_command(context, each) for each in command.list_commands(context)}
    return [part for each, sub in below.items() for part in _parts(f"{name} {each}", sub)]


def _section(name: str, command: Any) -> str:
    arguments = [each for each in command.params if each.param_type_name == "argument"]
    options = [each for each in command.params if each.param_type_name == "option" and each.name != "help_"]
    title = " ".join(["umo", name, *(each.metavar or each.name.upper() for each in arguments)])
    examples, _, status = command.epilog.partition("\n\n")
    listed = [f"- `{each.strip()}`" for each in examples.removeprefix("Examples: ").split("  |  ")]
    paragraphs = [" ".join(text.split()) for text in command.help.split("\n\n")]
    rows = [_row(f"`{each.metavar or each.name.upper()}`", each) for each in arguments if each.help]
    rows += [_row(_flags(each), each) for each in options]
    table = ["| | |", "| --- | --- |", *rows, ""] if rows else []
    parts = ["", f"### `{title}`", "", "\n\n".join(paragraphs), "", *table, *listed, "", f"{status}.", ""]
    return "\n".join(parts)


def _flags(option: Any) -> str:
    flags = ", ".join(option.opts)
    return f"`{flags}`" if option.is_flag else f"`{flags} {option.metavar or KINDS[option.bare_type()]}`"


def _row(what: str, parameter: Any) -> str:
    text = " ".join((parameter.help or "").split()).replace("\\[", "[")
    cells = (each.replace("|", "\\|") for each in (what, text))
    return f"| {' | '.join(cells)} |"


if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__).parse_args()
    PAGE.write_text(page(), encoding="utf-8")
