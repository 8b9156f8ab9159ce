"""The files of a fleet's history: Parquet by kind, site, station and hour, in a folder layout that other programs read.

    FOLDER/values/site=cell7/station=press/2026-11-25T14.parquet            an hour that is over
    FOLDER/values/site=cell7/station=press/2026-11-25T15.00000012.parquet   a part of this hour

Every file under its final name is complete: it is first written under another name, synced to the disk, and then
renamed. Parts are merged into larger parts, and into the file of their hour when the hour is over. A file lists the
parts from which it was made. Parts that remain because a recorder has ended are therefore dropped and never counted
twice. The hour of data is that of the recorder's UTC when it wrote them.
"""

from __future__ import annotations

import fcntl
import json
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from umo.clients.fleet.fleet_keys import StationKey
from umo.clients.fleet.fleet_record_run import Recorded
from umo.errors import OptionError
from umo.recording.tables.value_tables import SCHEMAS
from umo.system import folders

KINDS = ("values", "events", "gaps")
ABOUT = b"umo"
"""Key of umo's metadata in a file: its parts, and the first and last number of each run in the file."""
MERGED_PARTS, MERGED_BYTES = 60, 8 << 20
"""Number of parts, or of bytes in parts, that are merged into one larger part."""
GROUP_ROWS = 100_000
"""Number of rows of a row group; smaller groups are merged."""
LOOKED_AT = 24
"""Default number of files of a station that a recorder reads at its start, beginning with the newest."""
LOCK, MERGING = ".recorder", ".merging"
_NAME = re.compile(r"(\d{4}-\d\d-\d\dT\d\d)(?:\.(\d{8}))?\.parquet")

Runs = Mapping[str, tuple[int, int]]
"""First and last number of each run."""


@dataclass(frozen=True)
class HourFile:
    path: Path
    hour: str
    number: int | None
    """The number of the part; None for the file of the hour."""


class RecordFolder:
    """The folder of one recorder. Raises OptionError if another recorder uses it. `say` is called with notices about
    files that cannot be read."""

    def __init__(self, root: Path, say: Callable[[str], object]) -> None:
        root.mkdir(parents=True, exist_ok=True)
        self.root, self._say = root, say
        self.looked_at = LOOKED_AT
        """Largest number of files of a station, beginning with the newest, that are read to find which data are already
        recorded. They are read once for each run."""
        self._lock = open(root / LOCK, "w")  # noqa: SIM115 - held as long as the recorder records
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            self._lock.close()
            raise OptionError(f"another recorder already writes to {root}") from None
        (root / MERGING).touch()
        self._next: dict[Path, tuple[str, int]] = {}
        """Hour and number of the next part of each folder."""
        self._grown: dict[Path, list[int]] = {}
        """Number of parts of this hour in each folder that are not merged yet, and their bytes."""

    def close(self) -> None:
        self._lock.close()

    def place(self, kind: str, key: StationKey) -> Path:
        return self.root / kind / f"site={key.site}" / f"station={key.station}"

    # Writing -------------------------------------------------------------------------------------------

    def write(self, kind: str, key: StationKey, rows: pa.Table, runs: Runs, hour: str) -> None:
        """Add a part to an hour. Raises OSError if the part cannot be written."""
        place = self.place(kind, key)
        number = self._number(place, hour)
        path = place / f"{hour}.{number:08}.parquet"
        about = {"from": number, "until": number, "runs": runs}
        write_whole(path, rows.schema, [rows], about)
        self._next[place] = hour, number + 1
        grown = self._grown.setdefault(place, [0, 0])
        grown[0] += 1
        grown[1] += path.stat().st_size

    def write_objects(self, key: StationKey, run: str, rows: pa.Table) -> None:
        """Write the description of a run's objects, once for each run."""
        path = self.place("objects", key) / f"{run}.parquet"
        if not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            write_whole(path, rows.schema, [rows], {})

    def _number(self, place: Path, hour: str) -> int:
        """Return the number of the next part. Numbers are never used again in a folder."""
        before, number = self._next.get(place, ("", 0))
        if before != hour:
            place.mkdir(parents=True, exist_ok=True)
            self._grown[place] = [0, 0]
            whole = place / f"{hour}.parquet"
            merged = self._about(whole).get("until", 0) + 1 if whole.exists() else 0
            number = max(number, merged, *(1 + (each.number or 0) for each in hour_files(place)), 0)
        return number

    @property
    def grown(self) -> list[Path]:
        """The folders with so many parts or bytes of this hour that they are to be merged."""
        return [place for place, (count, size) in self._grown.items() if count >= MERGED_PARTS or size >= MERGED_BYTES]

    # Merging -------------------------------------------------------------------------------------------

    def tidy(self, place: Path, hour: str, oldest: str) -> None:
        """Delete leftover files and files older than the hour `oldest`; merge the parts of past hours into their files.
        Nothing is merged while a query reads; it is merged the next time."""
        for each in place.glob(".*.tmp"):
            each.unlink(missing_ok=True)
        hours: dict[str, list[HourFile]] = {}
        for file in hour_files(place):
            if file.hour < oldest:
                file.path.unlink(missing_ok=True)
            else:
                hours.setdefault(file.hour, []).append(file)
        for each_hour, files in hours.items():
            if len(files) > 1 or (files[0].number is not None and each_hour < hour):
                with self._merging() as may:
                    if may:
                        self._merge(place, each_hour, files, is_over=each_hour < hour)

    @contextmanager
    def _merging(self) -> Iterator[bool]:
        with open(self.root / MERGING, "r+") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                yield False
                return
            yield True

    def _merge(self, place: Path, hour: str, files: list[HourFile], is_over: bool) -> None:
        abouts = {each.path: about for each in files if (about := self._about(each.path))}
        files = self._without_leftovers([each for each in files if each.path in abouts], abouts)
        parts = [each for each in files if each.number is not None]
        if not parts or (len(parts) == 1 and not is_over):
            return
        merged = files if is_over else parts
        runs: dict[str, tuple[int, int]] = {}
        for each in merged:
            for run, (first, last) in abouts[each.path]["runs"].items():
                before = runs.get(run, (first, last))
                runs[run] = min(first, before[0]), max(last, before[1])
        told = [abouts[each.path] for each in merged]
        about = {"from": min(each["from"] for each in told), "until": max(each["until"] for each in told), "runs": runs}
        target = place / f"{hour}.parquet" if is_over else parts[-1].path
        schema = SCHEMAS[place.relative_to(self.root).parts[0]]
        write_whole(target, schema, _groups([each.path for each in merged]), about)
        folders.sync(place)
        for each in merged:
            if each.path != target:
                each.path.unlink(missing_ok=True)
        self._grown[place] = [0, 0]

    def _without_leftovers(self, files: list[HourFile], abouts: Mapping[Path, Any]) -> list[HourFile]:
        """Return the files of one hour without leftover parts. A leftover part is one whose data another file already
        contains; it is deleted."""
        parts = [each for each in files if each.number is not None]
        whole = max((abouts[each.path]["until"] for each in files if each.number is None), default=-1)
        kept = [each for each in files if each.number is None]
        for each in parts:
            mine = abouts[each.path]["until"]
            is_in = any(mine < until and begin <= mine for begin, until in (
                (abouts[other.path]["from"], abouts[other.path]["until"]) for other in parts
            ))  # fmt: skip
            if mine <= whole or is_in:
                each.path.unlink(missing_ok=True)
            else:
                kept.append(each)
        return kept

    def folders(self) -> Iterator[Path]:
        """Return the folders of all stations."""
        for kind in KINDS:
            yield from sorted(self.root.glob(f"{kind}/site=*/station=*"))

    # Reading -------------------------------------------------------------------------------------------

    def recorded(self, key: StationKey) -> Recorded:
        """Return the contents of the newest files of a station."""
        found = Recorded()
        for kind in ("values", "events"):
            for file in self._newest(self.place(kind, key)):
                for run, (_, last) in self._about(file.path).get("runs", {}).items():
                    found.last[kind, run] = max(last, found.last.get((kind, run), -1))
        for file in self._newest(self.place("gaps", key)):
            for row in self._rows(file.path):
                known = row["of"], row["run"], row["first"]
                found.gaps[known] = max(row["last"], found.gaps.get(known, -1))
        return found

    def _newest(self, place: Path) -> list[HourFile]:
        files = [(folders.modified(each.path), each) for each in hour_files(place)]
        parts = [each for _, each in files if each.number is not None]
        whole = sorted((each for each in files if each[1].number is None), key=lambda each: each[0])
        return parts + [each for _, each in whole[-self.looked_at :]]

    def _about(self, path: Path) -> dict[str, Any]:
        """Return the metadata of a file. A damaged file is set aside and reported."""
        try:
            return dict(json.loads((pq.read_schema(path).metadata or {})[ABOUT]))
        except FileNotFoundError:
            return {}
        except (pa.ArrowException, OSError, ValueError, KeyError) as error:
            self._set_aside(path, error)
            return {}

    def _rows(self, path: Path) -> list[dict[str, Any]]:
        try:
            return list(pq.ParquetFile(path).read().to_pylist())
        except (pa.ArrowException, OSError) as error:
            self._set_aside(path, error)
            return []

    def _set_aside(self, path: Path, error: Exception) -> None:
        aside = path.with_name(f".{path.name}.damaged")
        with suppress(OSError):
            path.rename(aside)
        self._say(f"{path} is damaged, and was renamed {aside.name}: {str(error).splitlines()[0]}")


def hour_files(place: Path) -> list[HourFile]:
    """Return the files of a station, ordered by hour and number. The file of an hour stands before the parts of that
    hour."""
    try:
        found = [(entry.name, match) for entry in os.scandir(place) if (match := _NAME.fullmatch(entry.name))]
    except FileNotFoundError:
        return []
    files = (HourFile(place / name, match[1], int(match[2]) if match[2] else None) for name, match in found)
    return sorted(files, key=lambda each: (each.hour, -1 if each.number is None else each.number))


def write_whole(path: Path, schema: pa.Schema, tables: Iterable[pa.Table], about: Mapping[str, Any]) -> None:
    """Write a file so that an incomplete file never has its name."""
    beside = path.with_name(f".{path.name}.tmp")
    told = schema.with_metadata({ABOUT: json.dumps(about)})
    try:
        with open(beside, "wb") as stream:
            with pq.ParquetWriter(stream, told, compression="zstd") as writer:
                for each in tables:
                    writer.write_table(each.replace_schema_metadata(told.metadata), row_group_size=GROUP_ROWS * 4)
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(beside, path)
    except BaseException:
        beside.unlink(missing_ok=True)
        raise


def _groups(paths: Iterable[Path]) -> Iterator[pa.Table]:
    """Yield the row groups of files one after the other. Small row groups are merged."""
    held: list[pa.Table] = []
    for path in paths:
        with pq.ParquetFile(path) as file:
            for number in range(file.num_row_groups):
                held.append(file.read_row_group(number))
                if sum(map(len, held)) >= GROUP_ROWS:
                    yield _joined(held)
                    held = []
    if held:
        yield _joined(held)


def _joined(tables: list[pa.Table]) -> pa.Table:
    plain = [each.replace_schema_metadata(None) for each in tables]
    return pa.concat_tables(plain).unify_dictionaries().combine_chunks()
