"""The order in which the chunks of a file are read and copied: that of their periods."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress

from umo.recording.block import headed
from umo.recording.mcap_reader import McapReader

EXACT, COLUMNS = 1, 2
"""The numbers of these channels, in every file: what a file says of channels has no checksum until it is closed."""
REPEATED = "its periods were there before"


def in_order(file: McapReader, note: Callable[[int, str], None]) -> list[int]:
    """Offsets of the chunks in the order of their periods. A file that is not closed may have them in any, or twice;
    `note` is told the offset of each that is passed over, and why."""
    if file.is_whole:
        return list(file.chunks)
    firsts: dict[int, int] = {}
    for at in file.chunks:
        try:
            found = next(iter(file.messages(at, (EXACT,))), None)
        except ValueError as error:
            note(at, damaged(error))
            continue
        if found is not None and firsts.setdefault(first_of(found.data), at) != at:
            note(at, REPEATED)
    return [firsts[first] for first in sorted(firsts)]


def damaged(error: ValueError) -> str:
    """Why a chunk is passed over that cannot be read."""
    return f"a chunk is damaged, {error}"


def first_of(exact: memoryview) -> int:
    """The number of the first frame of a block; that of no block if it is damaged, which is told when it is read."""
    with suppress(ValueError, LookupError, TypeError, OverflowError):
        return int(headed(exact)[0]["first"])
    return -1
