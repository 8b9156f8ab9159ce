"""The newest black box of a run, in words."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

from umo.errors import FramesError
from umo.frames import Reader
from umo.latency import blackbox
from umo.latency.causes import explain_all, sentences

MAX_OCCASIONS = 3
"""The last missed periods of a black box that are told."""
RUN_FACTS = ("pid", "started", "started_monotonic")
"""Facts that a run and its black boxes have in common, and no other run has."""


class BoxInWords(NamedTuple):
    """A black box in words."""

    name: str = ""
    """Name of the file; empty: there is none."""
    text: str = ""
    reason: str = ""
    """Why it was written."""


def newest_box(about: Mapping[str, Any], known: BoxInWords) -> BoxInWords:
    """The newest black box of the run that `about` describes; `known` where nothing is newer. It opens files and may
    compute for some 10 ms: call it in a thread."""
    try:
        found = blackbox.boxes(blackbox.folder())
    except (FramesError, OSError):
        return known
    run = _identity(about)
    for path in reversed(found):
        if path.name == known.name:
            break
        if _run_of(path) == run:
            return _read(path)
    return known


def _identity(about: Mapping[str, Any]) -> tuple[Any, ...]:
    return tuple(about.get(name) for name in RUN_FACTS)


@lru_cache(4 * blackbox.MAX_BOXES)
def _run_of(path: Path) -> tuple[Any, ...] | None:
    """Identity of the run whose black box it is; None if it cannot be read. The file of a name never changes."""
    try:
        with Reader(path) as reader:
            return _identity(reader.about)
    except Exception:  # of a damaged file: whatever json, struct, numpy, mmap raise
        return None


def _read(path: Path) -> BoxInWords:
    """When and why it was written, and the causes of the last missed periods in it."""
    try:
        with Reader(path) as reader:
            frames, about = reader.read(), reader.about
            verdicts = explain_all(frames, reader.layout)
            reason = str(about.get("reason", ""))
            lines = [f"{blackbox.kept_at(about)}: {reason}"]
            lines += sentences(frames, reader.layout, verdicts, MAX_OCCASIONS)
            return BoxInWords(path.name, "\n".join(lines), reason)
    except Exception as error:  # of a damaged file: whatever json, struct, numpy, mmap raise
        return BoxInWords(path.name, f"{path.name} cannot be read ({type(error).__name__})")
