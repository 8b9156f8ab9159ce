"""`umo fleet record` and `umo fleet query`."""

from __future__ import annotations

import csv as csv_files
import json
import signal
import threading
from collections.abc import Iterator, Mapping, Sequence
from datetime import date, datetime
from importlib.util import find_spec
from math import isfinite
from pathlib import Path
from typing import Any

from umo.duration import seconds
from umo.errors import DeclarationError, OptionError, UmoError
from umo.text import printable

from .background import step_back
from .console import out, plain_table, say

BATCH = 10_000
"""Rows that are held at a time."""


def record_history(folder: Path, changes: Mapping[str, Any], stations: Sequence[str], keep: str | None) -> int:
    """Record until Ctrl-C or SIGTERM."""
    _check_installed("zenoh", "pyarrow")
    from umo.fleet import fleet_settings
    from umo.fleet.fleet_record import FleetRecorder, key_pattern
    from umo.fleet.fleet_record_files import RecordFolder
    from umo.fleet.fleet_session import opened_client

    from .fleet_connection import opened_patiently, tell_connection

    kept = None if keep is None else _seconds("--keep", keep)
    for each in stations:
        key_pattern(each)
    network = fleet_settings.load(changes=changes).network
    step_back()
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    files = RecordFolder(folder, say)
    session = opened_patiently(lambda: opened_client(network), stop.is_set)
    if session is None:
        files.close()
        return 0
    try:
        if network.connect:
            tell_connection(session)
        out.print(f"records {', '.join(stations)} to {folder}", soft_wrap=True)
        FleetRecorder(session, files, stations, keep=kept, say=say).run(stop.is_set)
    finally:
        session.close()
        files.close()
    say("the recorder has ended; what came is in its files")
    return 0


def query_history(folder: Path, sql: str, *, last: str | None, rows: int, csv: Path | None, as_json: bool) -> int:
    """Answer one question."""
    _check_installed("duckdb", "pyarrow")
    from umo.fleet.fleet_query import asked

    span = None if last is None else _seconds("--last", last)
    with asked(folder, sql, span) as answer:
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
    """A list, a row to a line; numbers that JSON does not have are null."""
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
        out.print(f"the first {most} rows; --rows shows more, --csv FILE writes all")


def _short(value: Any) -> str:
    if isinstance(value, datetime):
        return value.strftime("%Y-%m-%d %H:%M:%S.%f")[:-3]
    return f"{value:.9g}" if isinstance(value, float) else str(value)


def _check_installed(*modules: str) -> None:
    for each in modules:
        if find_spec(each) is None:
            raise UmoError(f'the history of a fleet needs {each}: pip install "umo[fleet-history]"')


def _seconds(option: str, text: str) -> float:
    """A duration such as `30d`."""
    try:
        return seconds(text)
    except DeclarationError:
        raise OptionError(f"{option} {text!r} is not a duration; write for example 30d or '12 h'") from None
