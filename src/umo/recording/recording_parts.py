"""The files of one recording. A new file begins after a size or time. All files keep the data for replay."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from umo.errors import UmoError, text_of
from umo.process.frames.layout import Layout
from umo.recording.block import Block
from umo.recording.copying import thin
from umo.recording.part_names import part_name
from umo.recording.record_settings import DEFAULT, RecordSettings
from umo.recording.recording_file import OtherChannels, RecordingFile
from umo.system.folders import remove

PARTS_OF_LAST = 4
"""Number of files in which a flight recorder keeps its last minutes."""


@dataclass
class _Part:
    path: Path
    size: int
    end: float
    """The time of the last frame of the part, in s on the cycle's clock."""
    is_thin: bool = False


class RecordingParts:
    """Writes blocks to the files of `path`. Raises OSError if the first file cannot be created. `add` raises later
    errors."""

    def __init__(
        self,
        path: Path,
        layout: Layout,
        others: OtherChannels | None = None,
        settings: RecordSettings = DEFAULT,
    ) -> None:
        self.path, self.failed = path, ""
        """`failed`: the reason why an older part could not be reduced; "" if there is none."""
        self._layout, self._others, self._settings = layout, others, settings
        part = settings.rotate if settings.last is None else settings.last / PARTS_OF_LAST
        self._rotate_time = min(part, settings.rotate)
        self._parts: list[_Part] = []
        self._file = RecordingFile(path, layout, others)
        self._worker = ThreadPoolExecutor(1, "umo record")
        self._time = 0.0
        self._thinning: Future[None] | None = None

    @property
    def size(self) -> int:
        """Number of bytes of all files."""
        return self._file.size + sum(part.size for part in self._parts)

    @property
    def paths(self) -> list[Path]:
        """The files, the oldest first."""
        return [*(part.path for part in self._parts), self._file.path]

    def add(self, blocks: Sequence[Block]) -> None:
        """Write blocks as one chunk."""
        if self._file.span and (self._file.span >= self._rotate_time or self._file.size >= self._settings.size):
            self._rotate()
        self._file.add(blocks)
        self._time = float(blocks[-1].frames["time"][-1])
        if self._thinning is None or self._thinning.done():
            self._make_thin()

    def _rotate(self) -> None:
        """Begin the next file. Raises OSError if the disk has no room for the new file, or for the end of the last
        file. In the latter case the new file exists, and is closed like any other."""
        number, last = len(self._parts) + 2, self._file
        self._file = RecordingFile(part_name(self.path, number), self._layout, self._others, part=number)
        self._parts.append(_Part(last.path, last.size, self._time))
        last.close(followed=True)

    def _make_thin(self) -> None:
        """If the full parts are too old or too large together, reduce the oldest of them in a thread. Meanwhile the
        recording continues."""
        full = [part for part in self._parts if not part.is_thin]
        if not full:
            return
        last, keep = self._settings.last, self._settings.keep
        old = last is not None and self._time - full[0].end >= last
        many = keep is not None and self._file.size + sum(part.size for part in full) > keep
        if old or many:
            full[0].is_thin = True
            self._thinning = self._worker.submit(self._thin, full[0])

    def _thin(self, part: _Part) -> None:
        try:
            thin(part.path)
            part.size = part.path.stat().st_size
        except (OSError, UmoError) as error:
            self.failed = f"{part.path} could not be reduced: {text_of(error)}"

    def close(self) -> None:
        """Close the files, after completing the work of threads. No more blocks may follow. Raises OSError if the end
        of the last file cannot be stored. The file then has all its periods, but other readers need `umo recording
        repair`."""
        self._worker.shutdown()
        self._file.close()

    def discard(self) -> None:
        """Remove all files, after `close`."""
        for path in self.paths:
            remove(path)
