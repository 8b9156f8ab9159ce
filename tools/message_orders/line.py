"""A line in virtual time that a schedule owns: each message of either end waits until it is due, is left out, comes
twice, or comes damaged. What was sent keeps its order, as on a serial line and in a TCP connection: a message that is
held holds all behind it. Only a copy may come after later messages, as a radio modem makes one."""

from __future__ import annotations

from heapq import heappop, heappush
from itertools import count

WAY = 0.001
"""Time in s that a message takes."""


class Line:
    """`letters` decide over the messages that are sent while it `counts`. `short`, `late`: times in s.

    `.` deliver, `L` lose, `R` repeat in one piece, `S` repeat after `short`, `E` repeat after `late`, `W` hold for
    `short`, `H` hold for `late`, `C` cut: the first half only, `X` change a bit."""

    LETTERS, EACH = ".LRESWHCX", ".LEHX"
    """All letters; and those that all schedules to a depth have: the others do less of the same."""

    def __init__(self, short: float, late: float) -> None:
        self._letters, self._short, self._late = "", short, late
        self.now = 0.0
        self.counts = self.is_dead = False
        """While it does not count, all is delivered; while it is dead, nothing is."""
        self._decided = self.messages = 0
        self._order = count()
        self._under_way: tuple[list[tuple[float, int, bytes]], list[tuple[float, int, bytes]]] = [], []
        """To the controller, and to the host: when it is due, its order, and its bytes."""
        self._new: set[int] = set()
        """The orders of those to the controller that are whole, and no copies."""
        self.heard_at = 0.0
        """When the last of them came."""
        self._held_until = [0.0, 0.0]

    def begin(self, letters: str) -> None:
        """Another schedule begins."""
        self._letters, self._decided, self.counts = letters, 0, False

    @property
    def is_decided(self) -> bool:
        return self._decided >= len(self._letters)

    def send(self, way: int, data: bytes) -> None:
        """A message to the controller (0) or to the host (1)."""
        letter = "."
        self.messages += 1
        if self.counts and self._decided < len(self._letters):
            letter = self._letters[self._decided]
            self._decided += 1
        if self.is_dead or letter == "L":
            return
        if letter == "C":
            data = data[: len(data) // 2]
        elif letter == "X":
            at = 1 + self._decided % (len(data) - 2)
            data = data[:at] + bytes((data[at] ^ 1 << self._decided % 8,)) + data[at + 1 :]
        elif letter == "R":
            data += data
        is_whole = letter not in "CX"
        hold = {"W": self._short, "H": self._late}.get(letter, 0.0)
        due = self._held_until[way] = max(self.now + WAY + hold, self._held_until[way])
        self._put(way, due, data, is_new=is_whole and not way)
        if after := {"E": self._late, "S": self._short}.get(letter):
            self._put(way, due + after, data)

    def _put(self, way: int, due: float, data: bytes, *, is_new: bool = False) -> None:
        number = next(self._order)
        if is_new:
            self._new.add(number)
        heappush(self._under_way[way], (due, number, data))

    def arrived(self, way: int) -> bytes:
        """What has come since the last call; the host takes one message after the other."""
        queue, found = self._under_way[way], b""
        while self.has_come(way) and not (way and found):
            _, number, data = heappop(queue)
            found += data
            if number in self._new:
                self._new.remove(number)
                self.heard_at = self.now
        return found

    def has_come(self, way: int) -> bool:
        return bool(self._under_way[way]) and self._under_way[way][0][0] <= self.now

    def next_due(self, way: int) -> float:
        """When the next message is due; infinity: none is under way."""
        return self._under_way[way][0][0] if self._under_way[way] else float("inf")
