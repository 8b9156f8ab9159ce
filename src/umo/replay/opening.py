"""Opening a recording for a replay."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from umo.errors import FramesError
from umo.replay.tape import NotReplayable
from umo.system.processes import HASH_SEED

if TYPE_CHECKING:
    from umo.recording import Recording


@contextmanager
def opened(path: Path | str) -> Iterator[Recording]:
    """A recording. NotReplayable, in one line, if it is none, or cannot be replayed."""
    try:
        from umo.recording import Recording
    except ImportError as error:
        raise NotReplayable(f'{path}: {error.name} is not installed (pip install "umo[record]")') from None
    try:
        recording = Recording(path)
    except FramesError as error:
        raise NotReplayable(str(error)) from None
    except OSError as error:
        raise NotReplayable(f"{path}: {error.strerror}") from None
    with recording:
        try:
            why = recording.replayable_from
        except FramesError as error:
            raise NotReplayable(str(error)) from None
        if why is not None:
            raise NotReplayable(f"{path}: {why}")
        yield recording


def other_hash_seed(about: Mapping[str, object]) -> str | None:
    """The hash seed of a recorded run, if this process has another one: it can be set only where a process starts."""
    initial = about.get("initial")
    seed = str(initial.get("hash_seed", "")) if isinstance(initial, dict) else ""
    return seed if seed.isdecimal() and seed != os.environ.get(HASH_SEED) else None
