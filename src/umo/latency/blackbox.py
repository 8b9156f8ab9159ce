"""The black box: the last periods of a run in a file, which reads like a ring (`umo.frames.Reader`)."""

from __future__ import annotations

import dataclasses
import mmap
import struct
import time
from pathlib import Path

from umo.frames.layout import DESCRIPTION, HEAD, HEADER, MAGIC, MISSED, STATE, VERSION
from umo.frames.reader import Reader
from umo.frames.ring import State

PERIODS = 1000
KEPT = 10
SUFFIX = ".box"


def save(reader: Reader, path: Path, reason: str, periods: int = PERIODS) -> None:
    """Write the last `periods` frames of a ring, and why they were kept; OSError where that cannot be done."""
    frames = reader.last(periods)
    count = max(len(frames), 1)
    about = reader.layout.about | {"kept": time.time(), "reason": reason}
    description = dataclasses.replace(reader.layout, about=about).describe()
    first = -(-(DESCRIPTION + len(description)) // mmap.PAGESIZE) * mmap.PAGESIZE
    size = frames.dtype.itemsize
    content = bytearray(first + count * size)
    HEADER.pack_into(content, 0, MAGIC, VERSION, 0, first, size, count, len(description))
    content[DESCRIPTION : DESCRIPTION + len(description)] = description
    head = int(frames["sequence"][-1]) // 2 if len(frames) else 0
    for offset, value in ((HEAD, head), (MISSED, reader.missed), (STATE, State.ENDED)):
        struct.pack_into("<q", content, offset, value)
    for frame in frames:
        at = first + (int(frame["sequence"]) // 2 - 1) % count * size
        content[at : at + size] = frame.tobytes()
    new = path.with_suffix(".new")
    new.write_bytes(content)
    new.replace(path)


def boxes(folder: Path) -> list[Path]:
    """The black boxes in a folder, oldest first."""
    return sorted(folder.glob(f"*{SUFFIX}"), key=lambda path: path.stat().st_mtime)


def name_for(folder: Path, station: str, now: float) -> Path:
    """A new file, by station and local time."""
    stamp = time.strftime("%Y%m%d-%H%M%S", time.localtime(now))
    return folder / f"{station}-{stamp}-{int(now * 1000) % 1000:03d}{SUFFIX}"


def thin(folder: Path) -> None:
    """Remove all but the newest."""
    for path in boxes(folder)[:-KEPT]:
        path.unlink(missing_ok=True)
