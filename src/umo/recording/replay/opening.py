"""Opens a recording for a replay."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from umo.errors import FramesError
from umo.recording.replay.tape import NotReplayable
from umo.system.packages import how_to_install
from umo.system.processes import HASH_SEED
from umo.text import in_a_line, printable

if TYPE_CHECKING:
    from umo.recording.recording import Recording

MAX_HASH_SEED = 4_294_967_295
"""The largest number that Python takes as PYTHONHASHSEED."""


@contextmanager
def opened(path: Path | str) -> Iterator[Recording]:
    """Open a recording. Raises NotReplayable, with a text in one line, if the file is not a recording or cannot be
    replayed."""
    try:
        from umo.recording.recording import Recording
    except ImportError as error:
        raise NotReplayable(f"{path}: {error.name} is not installed ({how_to_install('record')})") from None
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
    """Return the hash seed of a recorded run if this process has a different one. The seed can be set only at the start
    of a process. Raises NotReplayable if Python does not accept the seed."""
    initial = about.get("initial")
    seed = str(initial.get("hash_seed", "")) if isinstance(initial, dict) else ""
    if seed in ("", "random") or seed == os.environ.get(HASH_SEED):
        return None
    is_number = seed.isascii() and seed.isdigit() and len(seed) <= len(str(MAX_HASH_SEED))
    if not is_number or int(seed) > MAX_HASH_SEED:
        raise NotReplayable(f"the hash seed of the recording, {printable(in_a_line(seed))[:50]!r}, is not valid")
    return seed
