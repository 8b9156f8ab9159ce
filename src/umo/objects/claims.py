"""Who drives an actuator: the highest rank in force (decision 94).

    STOP       the machine ends: only resets still reach a driver, no write does; no later period shows this rank
    FAULT      the equipment of the actuator is in fault; several levels, one for each equipment around the actuator
    INTERLOCK  an interlock that names the actuator holds, or is latched; there may be several
    CLIENT     one client has taken the actuator
    PROGRAM    the last write of anything else: laws, sequences, actions, the program's loop

A write of a lower rank is refused. The default is always accepted, except from the program while a client has the
actuator. When a rank ends, the actuator stays at its default: no earlier value comes back by itself. Rest (in a
suspension, or while a unit is held) and expiry are not ranks: they send the default, and every later write overrides
it. A slew rate limits everything except resets.
"""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple


class Rank(IntEnum):
    """The owner of an actuator. STOP is the rank of the connection (`umo.cycle.connect`), whose writes do not pass the
    command stage."""

    PROGRAM = 0
    CLIENT = 1
    INTERLOCK = 2
    FAULT = 3
    STOP = 4


class Claim(NamedTuple):
    """The claim in force for one actuator."""

    rank: Rank
    reason: str = ""
    """The reason why the program can write no value except the default; "" if it can."""

    @property
    def who(self) -> str:
        """The name of the owner that drives the actuator, as text."""
        return f"{WHO[self.rank]}: {self.reason.removeprefix(TAKEN)}" if self.reason else WHO[self.rank]

    @property
    def ends(self) -> str:
        """The sentence that says what comes next."""
        return NEXT[self.rank]


TAKEN = "taken by client: "
"""Beginning of the reason for an actuator that a client has taken."""
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
    Rank.CLIENT: "Writes of the program are refused. The default is sent when the client releases the actuator, its "
    "lease ends or the mode changes.",
    Rank.INTERLOCK: "Only the default is sent. When the condition is over, and acknowledged if the interlock is "
    "latched, the actuator stays at its default until it is written.",
    Rank.FAULT: "Only the default is sent. When the fault is cleared, the actuator is initialised at its default and "
    "stays there until it is written.",
    Rank.STOP: "Only resets reach the device.",
}
