"""The cells: the memory next to the frames that clients write and the machine reads. It contains levels, and the queue
of commands.

The size of this memory is sealed, but its content is not: every process of the user may write anything there. So the
machine checks everything that it reads, and at worst a command is dropped, or a lease or a hold ends.

Layout, little-endian: at `STOP` a request to stop, `STOP_MARK` plus the number of a signal; at `WHO` a text
(`umo.system.shared_cells.SharedText`) with the signal's number and the requesting client, UTF-8, up to `NAME` bytes; at
`HEAD` the number of commands written so far; from `QUEUE` on `SLOTS` commands of `SLOT` bytes each
(`umo.process.frames.command_queue`); from `SIGNS` on the heartbeats, 16 bytes each: the time of the last sign of the
holder of a lease, in ns of CLOCK_MONOTONIC, in the second word; the first word is this time XOR the number of the
lease, so that words of two clients together are not a valid sign. The first sign belongs to the lease itself; then
follow a sign for each object and a sign for each action, in the order of the frames' description.
"""

from __future__ import annotations

import signal

from umo.errors import FramesError
from umo.process.frames.layout import NAME, Layout, cut
from umo.process.frames.memory import mapped
from umo.system.shared_cells import SharedText
from umo.text import printable

STOP, WHO, HEAD, QUEUE = 0, 16, 104, 128
SLOTS, SLOT = 64, 1024
SIGNS = QUEUE + SLOTS * SLOT
STOP_MARK = 0x756D_6F53_746F_7000
"""The number that marks a request to stop, so that memory cannot contain a request by accident."""
SIGNALS = {int(getattr(signal, name)) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)}
LEASE = ""
"""The path of the lease's heartbeat."""


def size_of(layout: Layout) -> int:
    """Return the number of bytes of the cells of a run."""
    return SIGNS + 16 * (1 + len(layout.objects) + len(layout.actions))


class ClientMemory:
    """The cells, for the machine or for a client. Raises FramesError if the memory does not fit the description of the
    frames."""

    def __init__(self, file: int, layout: Layout) -> None:
        self._map = mapped(file, write=True)
        if len(self._map) < size_of(layout):
            self._map.close()
            raise FramesError("the cells of this run do not fit its frames")
        self.memory = memoryview(self._map)
        self.words = self.memory[: len(self._map) & ~7].cast("Q")
        self.asked, self.head = (self.words[at >> 3 : (at >> 3) + 1] for at in (STOP, HEAD))
        """Two arrays of one number each, for the check in each period. The first number is not 0 if a stop is requested
        or the content is invalid. The second is the number of commands written so far."""
        self._who = SharedText(self._map, WHO, HEAD - WHO)
        paths = [LEASE, *(str(entry["path"]) for entry in (*layout.objects, *layout.actions))]
        self._signs = {path: (SIGNS >> 3) + 2 * number for number, path in enumerate(paths)}

    # A stop --------------------------------------------------------------------------------------------

    def ask_to_stop(self, number: int, who: str) -> None:
        """Request the run to end as after this signal. Only the first request counts."""
        if self.stop is None:
            self._who.put(number, cut(who, NAME))
            self.words[STOP >> 3] = STOP_MARK | number

    @property
    def stop(self) -> tuple[int, str] | None:
        """The stop signal that was requested, and the client that requested it, or None if there is no request. The
        client is "" if two clients requested the stop simultaneously."""
        word = self.words[STOP >> 3]
        if not word or word ^ STOP_MARK not in SIGNALS:
            return None
        number, found = word ^ STOP_MARK, self._who.get()
        who = found[1] if found is not None and found[0] == number else b""
        return number, printable(who.decode(errors="replace"))

    # Heartbeats -------------------------------------------------------------------------------------

    def sign(self, path: str, lease: int, now: int) -> None:
        """Send a heartbeat of the holder of this lease, at a time in ns of CLOCK_MONOTONIC, for the hold at this
        path. A path without a cell is ignored."""
        at = self._signs.get(path)
        if at is not None:
            self.words[at], self.words[at + 1] = lease ^ now, now

    def signed(self, path: str, lease: int) -> float:
        """Return the time of the last heartbeat of the holder of this lease for this path, in s of CLOCK_MONOTONIC;
        0 means never. A path without a cell, such as that of an experiment, uses the cell of the lease."""
        at = self._signs.get(path, self._signs[LEASE])
        now = self.words[at + 1]
        return now * 1e-9 if self.words[at] ^ now == lease else 0.0

    def close(self) -> None:
        for view in (self.asked, self.head, self.words):
            view.release()
        self.memory.release()
        self._map.close()
