"""Answers queries in SQL about the history of a fleet. DuckDB reads the files of a recorder.

The views `values`, `events`, `gaps` and `objects` cover all stations; `umo.recording.tables.value_tables` has their
columns. A query changes nothing, and reads no other files.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import duckdb

from umo.clients.fleet.fleet_record_files import MERGING, hour_files
from umo.errors import OptionError
from umo.recording.tables.value_tables import SCHEMAS
from umo.system.file_locks import lock_within

MERGING_TIMEOUT = 60.0
"""Time in s to wait while the recorder merges the files of an hour."""
READS = (duckdb.StatementType.SELECT, duckdb.StatementType.EXPLAIN)


@contextmanager
def asked(folder: Path, sql: str, last: float | None = None, now: datetime | None = None) -> Iterator[Any]:
    """Return a context with the answer, a cursor of DuckDB. While the context is open, no files of the folder are
    merged. With `last` only the files of the last `last` s are read. Raises OptionError for an error in the query, and
    for a folder without history."""
    if not any((folder / kind).is_dir() for kind in SCHEMAS):
        raise OptionError(f"{folder} has no history of a fleet; `umo recording history {folder}` writes it")
    oldest = "" if last is None else _hour_of((now or datetime.now(UTC)) - timedelta(seconds=last))
    with _unmerged(folder), duckdb.connect(config={"allow_community_extensions": "false"}) as connection:
        try:
            connection.execute("SET TimeZone = 'UTC'")
            connection.execute("SET autoinstall_known_extensions = false")
            for kind in SCHEMAS:
                _show(connection, folder, kind, oldest)
            connection.execute(f"SET allowed_directories = [{_text(folder.resolve())}]")
            connection.execute("SET enable_external_access = false")
            connection.execute("SET lock_configuration = true")
            statements = connection.extract_statements(sql)
            if len(statements) != 1 or statements[0].type not in READS:
                raise OptionError("a query is one SELECT: the history is read-only")
            yield connection.execute(sql)
        except duckdb.Error as error:
            raise OptionError(in_a_line(error)) from None


def _show(connection: Any, folder: Path, kind: str, oldest: str) -> None:
    """Create the view of one kind of data. `oldest`: the first hour to read, or "" for all."""
    place = folder.resolve() / kind
    if oldest and kind != "objects":
        files = [each.path for station in place.glob("site=*/station=*") for each in hour_files(station)
                 if each.hour >= oldest]  # fmt: skip
    else:
        files = [place / "*/*/*.parquet"] if next(place.glob("site=*/station=*/*.parquet"), None) else []
    if not files:
        names = ", ".join(f'NULL AS "{each.name}"' for each in SCHEMAS[kind])
        connection.execute(f'CREATE VIEW "{kind}" AS SELECT NULL AS site, NULL AS station, {names} WHERE false')
        return
    read = f"[{', '.join(map(_text, files))}], hive_partitioning = true, hive_types_autocast = false"
    connection.execute(
        f'CREATE VIEW "{kind}" AS SELECT site, station, * EXCLUDE (site, station) FROM read_parquet({read})'
    )


@contextmanager
def _unmerged(folder: Path) -> Iterator[None]:
    """Return a context in which the recorder merges nothing. A folder that cannot be locked is read without a lock."""
    with ExitStack() as held:
        is_merging = False
        with suppress(OSError):
            is_merging = not lock_within(held.enter_context(open(folder / MERGING)), MERGING_TIMEOUT, shared=True)
        if is_merging:
            raise OptionError(
                f"{folder}: the recorder has been merging files for {MERGING_TIMEOUT:g} s; it may be stopped"
            )
        yield


def in_a_line(error: Exception) -> str:
    """Return an error of DuckDB on one line, such as `SQL: Referenced column "x" not found in FROM clause! Candidate
    bindings: "run"`."""
    lines = []
    for line in str(error).splitlines():
        if line.startswith("LINE "):
            break
        lines.append(line.strip())
    return "SQL: " + " ".join(each for each in lines if each).partition(" Error: ")[2] if lines else "SQL"


def _text(path: Path) -> str:
    return "'" + str(path).replace("'", "''") + "'"


def _hour_of(moment: datetime) -> str:
    return moment.strftime("%Y-%m-%dT%H")
