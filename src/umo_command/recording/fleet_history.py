"""`umo recording history` and `umo recording query`: record the history of a fleet, and answer queries about it."""

from __future__ import annotations

import csv as csv_files
import json
import signal
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from datetime import date, datetime
from importlib.util import find_spec
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

from umo.errors import OptionError, UmoError
from umo.system.packages import how_to_install
from umo.text import printable
from umo_command.background import step_back
from umo_command.console import out, plain_table, say

if TYPE_CHECKING:
    from umo.clients.fleet.fleet_record_files import RecordFolder
    from umo.clients.fleet.fleet_record_source import RecordSource
    from umo.clients.fleet.fleet_settings import FleetSettings
    from umo.clients.fleet.jetstream_server import JetStreamServer

BATCH = 10_000
"""Number of rows that are held in memory at a time."""


def record_history(
    folder: Path, changes: Mapping[str, Any], stations: Sequence[str], keep: float | None, jetstream: str | None = None
) -> int:
    """Record until Ctrl-C or SIGTERM."""
    _check_installed("zenoh", "pyarrow")
    from umo.clients.fleet import fleet_settings
    from umo.clients.fleet.fleet_record import FleetRecorder
    from umo.clients.fleet.fleet_record_files import RecordFolder
    from umo.clients.fleet.fleet_record_source import key_pattern
    from umo_command.connect.fleet_connection import jetstream_server

    for each in stations:
        key_pattern(each)
    settings = fleet_settings.load(changes=changes)
    if jetstream is not None and changes.get("connect"):
        raise OptionError("give --jetstream or --connect, not both: a recorder reads from one source")
    server = None if jetstream is None else jetstream_server(jetstream, settings)
    step_back()
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    files = RecordFolder(folder, say)
    try:
        with _source(settings, server, files, stations, stop.is_set) as source:
            if source is None:
                return 0
            out.print(f"records {', '.join(stations)} to {folder}", soft_wrap=True)
            FleetRecorder(source, files, keep=keep, say=say).run(stop.is_set)
    finally:
        files.close()
    say("the recorder has ended; the received data are in its files")
    return 0


@contextmanager
def _source(
    settings: FleetSettings,
    server: JetStreamServer | None,
    files: RecordFolder,
    stations: Sequence[str],
    stopped: Callable[[], bool],
) -> Iterator[RecordSource | None]:
    """Yield the source of the messages; None if it was stopped before a station answered."""
    from umo.clients.fleet.fleet_record_source import FleetSource
    from umo.clients.fleet.fleet_session import opened_client
    from umo_command.connect.fleet_connection import opened_patiently, tell_connection

    if server is not None:
        from umo.clients.fleet.jetstream_source import JetStreamSource

        with closing(JetStreamSource(server, files, stations, say)) as source:
            yield source
        return
    session = opened_patiently(lambda: opened_client(settings.network), stopped)
    if session is None:
        yield None
        return
    try:
        if settings.network.connect:
            tell_connection(session)
        yield FleetSource(session, stations)
    finally:
        session.close()


def query_history(folder: Path, sql: str, *, last: float | None, rows: int, csv: Path | None, as_json: bool) -> int:
    """Answer one query."""
    _check_installed("duckdb", "pyarrow")
    from umo.clients.fleet.fleet_query import asked

    with asked(folder, sql, last) as answer:
        names = [each[0] for each in answer.description]
        if csv is not None:
            _write_csv(csv, names, _rows(answer))
        elif as_json:
            _print_json(names, _rows(answer))
        else:
            _print_table(names, answer.fetchmany(rows + 1), rows)
    return 0


def _rows(answer: Any) -> Iterator[Sequence[Any]]:
    while batch := answer.fetchmany(BATCH):
        yield from batch


def _write_csv(file: Path, names: Sequence[str], rows: Iterator[Sequence[Any]]) -> None:
    with open(file, "w", newline="") as stream:
        writer = csv_files.writer(stream)
        writer.writerow(names)
        writer.writerows([_plain(each) for each in row] for row in rows)


def _print_json(names: Sequence[str], rows: Iterator[Sequence[Any]]) -> None:
    """Print a JSON list with one row on each line. Numbers that JSON cannot express are null."""
    end = "["
    for row in rows:
        told = {name: _plain(each) for name, each in zip(names, row, strict=True)}
        out.file.write(f"{end}\n{json.dumps(told, default=str)}")
        end = ","
    out.file.write("[]\n" if end == "[" else "\n]\n")


def _plain(value: Any) -> Any:
    if isinstance(value, datetime | date):
        return value.isoformat()
    return None if isinstance(value, float) and not isfinite(value) else value


def _print_table(names: Sequence[str], rows: Sequence[Sequence[Any]], most: int) -> None:
    table = plain_table()
    for name in names:
        table.add_column(printable(name), overflow="fold")
    for row in rows[:most]:
        table.add_row(*("" if each is None else printable(_short(each)) for each in row))
    out.print(table)
    if len(rows) > most:
        out.print(f"these are the first {most} rows; --rows shows more, --out FILE.csv writes all")


def _short(value: Any) -> str:
    if isinstance(value, datetime):
        return value.strftime("%Y-%m-%d %H:%M:%S.%f")[:-3]
    return f"{value:.9g}" if isinstance(value, float) else str(value)


def _check_installed(*modules: str) -> None:
    for each in modules:
        if find_spec(each) is None:
            raise UmoError(f"the history of a fleet needs {each}: {how_to_install('fleet-history')}")
