"""Determines the order in which the chunks of a file are read and copied. It is the order of their periods."""

from __future__ import annotations

from array import array
from contextlib import suppress

import numpy as np

from umo.errors import text_of
from umo.recording.block import headed
from umo.recording.mcap_reader import McapReader

EXACT, COLUMNS = 1, 2
"""The numbers of these channels. They are the same in every file, because a file's data about channels have no checksum
until the file is closed."""
MAX_FIRST = 1 << 62
"""The limit of frame numbers: the number of every frame is below it."""
REPEATED = "its periods are already in the recording"


def in_order(file: McapReader) -> array[int]:
    """Return the offsets of the chunks in the order of their periods. A file that was not closed may contain chunks in
    any order, or the same chunk twice. Skipped chunks count as damaged."""
    if file.is_whole:
        return file.chunks
    firsts, offsets = array("q"), array("q")
    for at in file.chunks:
        try:
            found = next(iter(file.messages(at, (EXACT,))), None)
        except ValueError as error:
            file.damaged.add(at, damaged(error))
            continue
        if found is not None:
            firsts.append(first_of(found.data))
            offsets.append(at)
    _, places = np.unique(np.frombuffer(firsts, np.int64), return_index=True)
    ordered = np.frombuffer(offsets, np.int64)
    for at in np.delete(ordered, places).tolist():
        file.damaged.add(at, REPEATED)
    return array("q", ordered[places].tobytes())


def damaged(error: Exception) -> str:
    """Return the reason why a chunk that cannot be read is skipped."""
    return f"a chunk is damaged, {error if type(error) is ValueError else text_of(error)}"


def first_of(exact: memoryview) -> int:
    """Return the number of the first frame of a block. For a damaged block, return a number that no block has; the
    damage is reported when the block is read."""
    with suppress(ValueError, LookupError, TypeError, OverflowError):
        first = int(headed(exact)[0]["first"])
        return first if 0 <= first < MAX_FIRST else -1
    return -1
