"""Who drives an actuator: the greatest rank that is in force has it (decision 94).

    STOP       the machine ends: no write reaches a driver any more, only resets do; no period follows that shows it
    FAULT      its equipment is in fault; several levels, one for each equipment around it
    INTERLOCK  an interlock that names it holds, or is latched; several may
    CLIENT     one client has taken it
    PROGRAM    the last write of whoever else: laws, sequences, actions, the program's own loop

A write of a lower rank is refused; the default is always taken, but from the program while a client has it. A rank that
ends leaves the default: nothing comes back by itself. Resting (a suspension, a unit that is held) and expiry are no
ranks: they send the default, and every later write overrides them. A rate limits all but resets.
"""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple


class Rank(IntEnum):
    """Who has an actuator. STOP is that of the connection (`umo.cycle.connect`), which writes through no stage."""

    PROGRAM = 0
    CLIENT = 1
    INTERLOCK = 2
    FAULT = 3
    STOP = 4


class Claim(NamedTuple):
    """What is in force for one actuator."""

    rank: Rank
    reason: str = ""
    """Why the program can write no other value than the default; "": it can."""

    @property
    def who(self) -> str:
        """Who drives it, in words."""
        return f"{WHO[self.rank]}: {self.reason.removeprefix(TAKEN)}" if self.reason else WHO[self.rank]

    @property
    def ends(self) -> str:
        """What comes next, in a sentence."""
        return NEXT[self.rank]


TAKEN = "taken by client: "
"""How the reason of one that a client has taken begins."""
WHO = {
    Rank.PROGRAM: "the program",
    Rank.CLIENT: "a client",
    Rank.INTERLOCK: "an interlock",
    Rank.FAULT: "a fault of its equipment",
    Rank.STOP: "the end of the run",
}
NEXT = {
    Rank.PROGRAM: "The last write of laws, sequences and actions counts. A client with the lease may take it in manual "
    "mode.",
    Rank.CLIENT: "Writes of the program are refused. The default is sent when the client lets it go, its lease ends or "
    "the mode changes.",
    Rank.INTERLOCK: "Only the default is sent. When the condition is over, and acknowledged if it latches, the default "
    "stays until somebody writes.",
    Rank.FAULT: "Only the default is sent. When the fault is cleared, it is initialised at its default, which "
    "stays until somebody writes.",
    Rank.STOP: "Only resets reach the device.",
}
