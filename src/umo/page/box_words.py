"""The newest black box of a station, in words."""

from __future__ import annotations

from pathlib import Path

from umo.errors import FramesError
from umo.frames import Reader
from umo.latency import blackbox
from umo.latency.causes import explain, missed_rows, sentence, tally

OCCASIONS = 3
"""The last missed periods of a black box that are told."""


def newest_box(name: str) -> Path | None:
    """The newest black box of a station."""
    try:
        found = blackbox.boxes(blackbox.folder())
    except (FramesError, OSError):
        return None
    return next((path for path in reversed(found) if blackbox.station_of(path) == name), None)


def box_in_words(path: Path) -> str:
    """When and why the black box was written, and the causes of the last missed periods in it."""
    try:
        with Reader(path) as reader:
            frames, about = reader.read(), reader.about
            verdicts = [explain(frames, reader.layout, row) for row in missed_rows(frames)]
            lines = [f"{blackbox.kept_at(about)}: {about.get('reason', '')}"]
            lines += [sentence(frames, verdict) for verdict in verdicts[-OCCASIONS:]]
            if len(verdicts) > 1:
                counts = ", ".join(f"{cause} {count}" for cause, count in tally(verdicts).items())
                lines.append(f"all {len(verdicts)} occasions: {counts}")
            return "\n".join(lines)
    except Exception as error:  # of a damaged file: whatever json, struct, numpy, mmap raise
        return f"{path.name} cannot be read ({type(error).__name__})"
