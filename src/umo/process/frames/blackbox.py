"""The black box: the last periods of a run in a file, which is read like a ring (`umo.process.frames.Reader`)."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from umo.cycle.stage import Stage
from umo.errors import FramesError
from umo.process.frames.layout import DESCRIPTION, ENTRY, Live, arrange
from umo.process.frames.reader import Reader
from umo.process.frames.run_reader import Frames
from umo.system import folders
from umo.text import time_of_day

KEPT_PERIODS = 1000
MAX_BOXES = 10
AFTERMATH = 0.05
"""The time in s after a missed period that the black box also contains."""
AFTERMATH_PERIODS, LONGEST_AFTERMATH = 20, 1.0
"""The number of later periods in the black box, and the longest time in s that these periods may take. Several periods
show a part that is always too slow."""
SUFFIX = ".box"
UNFINISHED_AGE = 3600.0
"""The age in s from which on an unfinished file counts as abandoned."""
MISSED_PERIOD, ON_DEMAND = "a period was missed", "on demand"
"""The reasons for a black box other than the end of a run. Any other reason is that of a failed run."""


def folder() -> Path:
    """Return the folder of this user's black boxes, which only this user may read. Raises FramesError if the folder
    cannot be made. All users may read the outer folder, which has records for them."""
    try:
        return folders.checked(folders.own(folders.lasting(), 0o755) / "blackbox")
    except OSError as error:
        raise FramesError(f"the folder for black boxes cannot be used: {error}") from None


def save(reader: Reader, path: Path, reason: str, periods: int = KEPT_PERIODS) -> None:
    """Write the last `periods` frames of a ring, their entries that are still in its journal, and the reason. Raises
    OSError if this fails; then no file remains."""
    content = _content(reader, reader.last(periods), reason)
    with folders.written(path, 0o600) as stream:
        stream.write(content)


def _content(reader: Reader, frames: Frames, reason: str) -> bytearray:
    """Return the content of a file with exactly the existing frames and entries, each at the place for its number."""
    about = reader.layout.about | {"kept": time.time(), "reason": reason}
    layout = dataclasses.replace(reader.layout, about=about)
    numbers = [int(sequence) // 2 - 1 for sequence in frames["sequence"]]
    head = numbers[-1] + 1 if numbers else 0
    slots = head - numbers[0] if numbers else 1  # those between that could not be copied stay empty
    begin, end = (frames["journal"][0], frames["journal"][-1] + frames["entries"][-1]) if numbers else (0, 0)
    begin, entries = reader.entries(int(begin), int(end))
    start, places = arrange(layout, slots, len(entries), reader.flags)
    content = bytearray(places.size)
    content[: len(start)] = start
    content[8 * Live.EVENT : DESCRIPTION] = reader.live_bytes(8 * Live.EVENT, DESCRIPTION)
    content[places.events :] = reader.told_bytes()
    live = memoryview(content)[:DESCRIPTION].cast("q")
    live[Live.HEAD], live[Live.MISSED], live[Live.STATE] = head, reader.now().missed, Stage.ENDED
    live[Live.JOURNAL] = begin + len(entries)
    size = frames.dtype.itemsize
    for number, frame in zip(numbers, frames, strict=True):
        at = places.first + number % slots * size
        content[at : at + size] = frame.tobytes()
    journal = np.frombuffer(content, ENTRY, len(entries), places.journal)
    journal[np.arange(begin, begin + len(entries)) % max(len(entries), 1)] = entries
    return content


def aftermath(period: float) -> float:
    """Return the time in s after a missed period at which its black box is written."""
    return max(AFTERMATH, min(AFTERMATH_PERIODS * period, LONGEST_AFTERMATH))


def boxes(folder: Path) -> list[Path]:
    """Return the black boxes in a folder, oldest first."""
    return sorted(folder.glob(f"*{SUFFIX}"), key=folders.modified)


def name_for(folder: Path, station: str, now: float) -> Path:
    """Return the path of a new file, named by station and local time."""
    stamp = time.strftime("%Y%m%d-%H%M%S", time.localtime(now))
    return folder / f"{station[:100]}-{stamp}-{int(now * 1000) % 1000:03d}{SUFFIX}"


def station_of(path: Path) -> str:
    """Return the name of the station from the name of a black box."""
    return path.name.rsplit("-", 3)[0]


def kept_at(about: Mapping[str, Any]) -> str:
    """Return the local time at which a black box was written."""
    return time_of_day(about.get("kept", about["started"]))


def thin(folder: Path) -> None:
    """Remove all black boxes except the newest ones, and unfinished files of killed processes."""
    for path in boxes(folder)[:-MAX_BOXES]:
        path.unlink(missing_ok=True)
    for path in folder.glob(f".*{SUFFIX}.*"):
        if time.time() - folders.modified(path) > UNFINISHED_AGE:
            path.unlink(missing_ok=True)
