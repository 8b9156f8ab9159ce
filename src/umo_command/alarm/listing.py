"""`umo alarm list` and `umo alarm history`: the alarms of a station."""

from __future__ import annotations

import json

from umo.objects.presentation.run_facts import clock_text
from umo.operation.alarms import alarm_file
from umo.process.frames import RunReader
from umo.process.frames.alarm_list import AlarmRow
from umo.process.frames.search import station_name
from umo.text import printable, time_of_day
from umo_command.console import out, plain_table
from umo_command.show.stations import attach

COLUMNS = ("alarm", "state", "by", "priority", "since", "raised", "text")
"""The columns of the list. `by`, the client that caused the state, is left out if the machine caused all of them."""
MAX_SHOWN = 200
"""Number of changes of the history that are shown. They are the latest ones."""


def list_alarms(name: str | None, as_json: bool, raised: bool, every: bool) -> None:
    """List the alarms that are not normal. `raised`: also list normal alarms that were raised before. `every`:
    list all alarms."""
    with attach(name) as reader:
        _list(reader, as_json, raised, every)


def _list(reader: RunReader, as_json: bool, raised: bool, every: bool) -> None:
    frame = reader.latest()
    rows, utc = reader.alarms(frame, raised, every), reader.utc(frame)
    if as_json:
        out.print_json(json.dumps([_data(row) for row in rows]), ensure_ascii=True)
        return
    if not reader.layout.alarms:
        out.print(f"{reader.about['station']} declares no alarms")
        return
    if not rows:
        count = len(reader.layout.alarms)
        out.print(f"no alarm {'was raised' if raised else 'is active'}; `umo alarm list --all` lists all {count}")
        return
    table = plain_table()
    columns = [name for name in COLUMNS if name != "by" or any(row.who for row in rows)]
    for heading in columns:
        table.add_column(heading, overflow="fold")
    for row in rows:
        style = "red" if row.annunciated and row.priority > 2 else ""
        texts = _texts(row, utc)
        table.add_row(*(texts[name] for name in columns), style=style)
    out.print(table)


def _texts(row: AlarmRow, utc: float | None) -> dict[str, str]:
    """Return the texts of a row, by column. `utc`: the time of day at which the run's clock was 0, if it is known."""
    since = "" if row.since is None else _moment(row.since, utc)
    end = "" if row.until is None else f"until {_moment(row.until, utc)}"
    text = "; ".join(filter(None, (row.text, row.note, end)))
    texts = (row.path, str(row.state), row.who, str(row.priority), since, _raised(row, utc), text)
    return dict(zip(COLUMNS, map(printable, texts), strict=True))


def _raised(row: AlarmRow, utc: float | None) -> str:
    """Return how often an alarm was raised. If it was raised more than once, also return since when."""
    first = "" if row.raised < 2 or row.first is None else f" since {_moment(row.first, utc)}"
    return f"{row.raised}{first}" if row.raised else ""


def _moment(seconds: float, utc: float | None) -> str:
    """Format a time of the run as in the history, or, in virtual time, on the run's clock."""
    return clock_text(seconds) if utc is None else time_of_day(utc + seconds)


def show_history(name: str | None) -> None:
    """Print the stored changes of a station's alarms. The station need not run. With a pid, print only the changes of
    that run."""
    if name is None or name.isdigit():
        with attach(name) as reader:
            name = str(reader.about["station"])
    records = alarm_file.read(alarm_file.file_of(station_name(name)))
    if not records:
        out.print(f"there is no history of the alarms of {station_name(name)}")
        return
    table = plain_table()
    for heading in ("time", "alarm", "change", "by"):
        table.add_column(heading, overflow="fold")
    for record in records[-MAX_SHOWN:]:
        texts = map(printable, (record.path, record.text, record.who))
        table.add_row(time_of_day(record.when), *texts)
    out.print(table)


def _data(row: AlarmRow) -> dict[str, object]:
    """Return a row as plain data."""
    return row._asdict() | {"state": str(row.state), "priority": str(row.priority)}
