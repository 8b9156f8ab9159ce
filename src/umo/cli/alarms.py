"""`umo alarms`: the alarms of a running station, and what an operator does with them."""

from __future__ import annotations

import json
from dataclasses import dataclass, fields
from typing import Any

from umo.alarms import alarm_file
from umo.errors import OptionError
from umo.frames.alarm_list import AlarmRow
from umo.presentation.run_facts import clock_text
from umo.remote import RemoteStation
from umo.remote.search import station_name
from umo.text import printable, time_of_day

from .commanding import leased
from .console import out, plain_table
from .ps import attach
from .values import duration

MAX_SHOWN = 200
"""Changes of the history that are shown, the last ones."""
COMMANDS = {
    "acknowledge": "acknowledge alarm",
    "reset": "reset alarm",
    "shelve": "shelve",
    "unshelve": "unshelve",
    "remove": "remove from service",
    "return_": "return to service",
}
"""The client's command of each option."""


@dataclass(frozen=True)
class AlarmOptions:
    """The paths that the options of `umo alarms` were given."""

    acknowledge: str | None = None
    reset: str | None = None
    shelve: str | None = None
    unshelve: str | None = None
    remove: str | None = None
    return_: str | None = None


@dataclass(frozen=True)
class Listing:
    """How alarms are listed."""

    as_json: bool = False
    raised: bool = False
    """Those too that are normal and were raised."""


def alarms_or_history(
    name: str | None, options: AlarmOptions, lasting: str | None, listing: Listing, over: bool, past: bool
) -> None:
    """`past`: show the history."""
    if not past:
        alarms(name, options, lasting, listing, over)
        return
    if options != AlarmOptions() or lasting is not None or listing != Listing():
        raise OptionError("--history stands alone")
    if name is None or name.isdigit():  # a pid
        with attach(name) as reader:
            name = str(reader.about["station"])
    show_history(name)


def alarms(name: str | None, options: AlarmOptions, lasting: str | None, listing: Listing, over: bool) -> None:
    """List the alarms that are not normal, or carry out what was asked for."""
    asked = {each.name: path for each in fields(options) if (path := getattr(options, each.name)) is not None}
    if (lasting is not None) != ("shelve" in asked):
        raise OptionError("--shelve PATH and --for TIME go together")
    if asked and listing.raised:
        raise OptionError("--raised lists alarms, and the other options change some: give one of them")
    time = None if lasting is None else duration("--for", lasting)
    with RemoteStation(attach(name)) as station:
        if not asked:
            _list(station, listing)
            return
        with leased(station, over):
            for option, path in asked.items():
                more: dict[str, Any] = {"value": time} if option == "shelve" else {}
                out.print(printable(str(station.ask(COMMANDS[option], path, **more))), soft_wrap=True)


def _list(station: RemoteStation, listing: Listing) -> None:
    rows = station.raised_alarms if listing.raised else station.alarms
    if listing.as_json:
        out.print_json(json.dumps([_data(row) for row in rows]), ensure_ascii=True)
        return
    if not station.reader.layout.alarms:
        out.print(f"{station.reader.about['station']} declares no alarms")
        return
    if not rows:
        out.print("no alarm was raised" if listing.raised else "no alarm")
        return
    table = plain_table()
    for heading in ("alarm", "state", "priority", "since", "raised", "text"):
        table.add_column(heading, overflow="fold")
    for row in rows:
        since = "" if row.since is None else clock_text(row.since)
        text = row.text + (f"; {row.note}" if row.note else "") + (f" ({row.who})" if row.who else "")
        style = "red" if row.annunciated and row.priority > 2 else ""
        table.add_row(
            printable(row.path), str(row.state), str(row.priority), since, _raised(row), printable(text), style=style
        )
    out.print(table)


def _raised(row: AlarmRow) -> str:
    """How often, and since when, if it was more than once."""
    first = "" if row.raised < 2 or row.first is None else f" since {clock_text(row.first)}"
    return f"{row.raised}{first}" if row.raised else ""


def show_history(name: str) -> None:
    """Print the changes of a station's alarms that are kept, also of one that does not run."""
    records = alarm_file.read(alarm_file.file_of(station_name(name)))
    if not records:
        out.print(f"no history of alarms of {station_name(name)}")
        return
    table = plain_table()
    for heading in ("time", "alarm", "change", "by"):
        table.add_column(heading, overflow="fold")
    for record in records[-MAX_SHOWN:]:
        texts = map(printable, (record.path, record.text, record.who))
        table.add_row(time_of_day(record.when, "%Y-%m-%d %H:%M:%S"), *texts)
    out.print(table)


def _data(row: AlarmRow) -> dict[str, object]:
    """A row as plain data."""
    return row._asdict() | {"state": str(row.state), "priority": str(row.priority)}
