"""The recorder of the bench: its disk, which can be full, and whether what it has written is what was made."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from bench.fleet.checker import MADE
from bench.fleet.plant import Truth
from bench.fleet.rings import OBJECTS
from bench.report import Target
from umo.clients.fleet.fleet_query import asked

DISK = 1 << 30
"""Bytes."""
BLOCK = 1 << 20
RECORDED = f"""
SELECT site || '/' || station || '/' || run, count(*), count(DISTINCT delta),
       count(*) FILTER (delta <> number OR value IS DISTINCT FROM
                        CASE WHEN place % 2 = 0 THEN number ELSE number // 50 END * 1000.0 + place)
FROM (SELECT *, CAST(substr(path, 7) AS INTEGER) AS place FROM values
      WHERE station LIKE '{MADE}%' AND path LIKE 'cell.o%')
GROUP BY ALL
"""
GAPS = "SELECT why, sum(count)::BIGINT FROM gaps WHERE of = 'values' GROUP BY ALL"


class Disk:
    """A file system of its own in memory."""

    def __init__(self, folder: Path) -> None:
        self.folder, self._filler = folder, folder / "filler"

    def mount(self) -> None:
        self.folder.mkdir()
        subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={DISK}", "tmpfs", self.folder], check=True)

    def fill(self) -> None:
        """No byte is left."""
        file = os.open(self._filler, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
        with suppress(OSError):
            while True:
                os.write(file, bytes(BLOCK))
        os.close(file)

    def empty(self) -> None:
        self._filler.unlink(missing_ok=True)

    def unmount(self) -> None:
        subprocess.run(["umount", "-l", self.folder], capture_output=True)


def compared(folder: Path, truths: list[Truth]) -> Iterator[Target]:
    """What the files have of the stations that do not exist against what these made."""
    with asked(folder, RECORDED) as cursor:
        found = {run: rest for run, *rest in cursor.fetchall()}
    with asked(folder, GAPS) as cursor:
        gaps = ", ".join(f"{count:,} {why}" for why, count in cursor.fetchall()) or "none"
    made = {each.key: each.reader.head for each in truths if f"/{MADE}" in each.key}
    there = sum(deltas for _, deltas, _ in found.values())
    odd = sum(abs(rows - OBJECTS * deltas) for rows, deltas, _ in found.values())
    wrong = sum(each for *_, each in found.values())
    expected = sum(made.values())
    verdict = "met" if there == expected and not odd and not wrong and set(found) == set(made) else "missed"
    shown = f"{there:,}; {odd:,} rows too many or too few, {wrong:,} with other values"
    yield Target(f"deltas in the Parquet files, of {expected:,} that were made", "all", shown, verdict)
    for run, head in made.items():
        if run not in found or found[run][1] != head:
            yield Target(f"    {run}: {head} made, {found.get(run, (0, 0, 0))[1]} recorded", "", "", "")
    yield Target("  gaps that the files tell, deltas", "-", gaps, "")
