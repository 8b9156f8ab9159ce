"""Makes docs/command-line.md of the command's own help."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import typer

from umo.cli.app import app

PAGE = Path(__file__).parents[1] / "docs" / "command-line.md"
KINDS = {"str": "TEXT", "int": "INTEGER", "float": "NUMBER", "path": "FILE"}
HEAD = """# The command line on one page

`umo COMMAND --help` says the same in the terminal. `python tools/command_line.py` makes this page from it.

## Exit statuses

| status | meaning |
| --- | --- |
| 0 | done; of `umo run`: the application has returned |
| 1 | the machine, a device, or code of a station failed |
| 2 | a mistake, told on stderr in a line or two with the nearest valid choice; nothing was driven |
| 3 | an actuator is not at its default; it is named ([stop safely](howto-stop-safely.md)) |
| 4 | `umo run`: `runs/` cannot be written: nothing ran (`--no-record` needs none), or all but the record went well |
| 124 | `umo run --until` has ended the run, as timeout(1) does |
| 130, 143, 129 | ended by a signal: Ctrl-C (SIGINT), SIGTERM, SIGHUP: 128 and its number |

## Names

A **station** is named by its folder, or by the name of one that ships with umo or is installed. A **running station**
is named by its pid, its folder, or its name, wherever its folder is; `umo ps` lists them. A **wiring** (`-w`) is one of
the station's by name, or a file. A **time** is a number of seconds, or has a unit: `"5 min"`. What follows the name of
a station, such as `--seed 7`, are the station's own options: `umo run STATION --help` shows them.

## What a run leaves behind

`umo run` makes the folder `runs/STATION-DATE-TIME` in the current folder.

| file | |
| --- | --- |
| `run.json` | what is run: station, wiring, options, start; from the beginning |
| `trace.csv` | a row a period, in a long run every 2nd, 4th, ...; `nan`: BAD; it grows during a run in real time |
| `trace-000001.csv`, ... | with `--keep SIZE`: every period of the last time, in parts, of SIZE in all |
| `summary.json` | status, failure, and what the table at the end shows, as data; in real time from the beginning |
| `plot.png` | the trace and the alarms as a picture (`--no-plot` draws none, Ctrl-C leaves it out) |
| `failure.txt` | the whole traceback of a run that failed |

Each file is whole or not there. A run whose `umo run` was killed leaves a trace that ends before the run did, and a
summary with the state "running", written once a minute; one whose frames could not be read to the end leaves such a
trace, with status 4. Nothing in `runs/` is removed, unless `--keep`, `--keep-runs` or `umo runs --prune` ask for it.
"""


def page() -> str:
    """The whole page: the commands by panel, in the order of `umo --help`."""
    commands = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    panels: dict[str, list[str]] = {}
    for name, command in commands.items():
        sections = panels.setdefault(command.rich_help_panel, [])
        sections.extend(_section(*each) for each in _parts(name, command))
    return HEAD + "".join(f"\n## {title}\n{''.join(sections)}" for title, sections in panels.items())


def _parts(name: str, command: Any) -> list[tuple[str, Any]]:
    """The command, or its subcommands, with their whole names: `fleet certificate site`."""
    below = getattr(command, "commands", None)
    if not below:
        return [(name, command)]
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
