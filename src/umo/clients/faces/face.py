"""The contract of a face: four methods that it implements, and the one object that it receives.

    class Lamp(Face):
        async def begin(self, machine, commands): ...   # the declaration of a run; it has no values yet
        async def frames(self, changes): ...            # what has changed since the last call
        async def events(self, events): ...
        async def end(self, why): ...                   # every value is now stale or bad

The host calls these methods one after the other, never two simultaneously, from one task of its loop. A slow face gets
fewer calls with more changes in each, and does not delay other faces. An error of a face is reported, and the face
starts again after a pause. Between `end` and the next `begin` there is no machine: what a client reads then has no good
quality.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import numpy as np
import numpy.typing as npt

from umo.objects import Quality
from umo.objects.scaling import FloatArray
from umo.process.frames.machine_items import Declaration
from umo.process.frames.run_reader import NumberedEvent


@dataclass(frozen=True)
class Changes:
    """The changes since the last call. The arrays have one row for each item of the declaration; `places` are the
    indices of the changed items."""

    period: int
    """Number of the last frame. Changes are ordered by run and period, never by UTC."""
    utc: float
    """Time in s since 1970 at which the last frame's period began."""
    utc_error: float | None
    """Largest error of `utc` in s, or None if the clock of the computer is not synchronised."""
    places: npt.NDArray[np.intp]
    values: FloatArray
    """The values of the items; NaN if there is none."""
    quality: npt.NDArray[np.uint8]
    """The quality of each value, a `Quality`."""
    times: FloatArray
    """Time at which the device returned each value, in UTC like `utc`; NaN if it never did."""

    def quality_of(self, place: int) -> Quality:
        return Quality(int(self.quality[place]))


@dataclass(frozen=True)
class User:
    """The user who gives a command, and how far the protocol proves who it is."""

    name: str
    proved: bool
    """True if the name is proved: by a password, a certificate, or the account of a process on this computer."""
    is_owner: bool = False
    """True if it is proved that this is the user who runs the machine (`umo.system.peer_account`). That user may give
    every command; everybody else needs a role."""
    is_alive: Callable[[], bool] | None = None
    """Function that returns True while the session of this client lives. None if the protocol does not report that."""


class Commands(Protocol):
    """Passes the commands of a face's users to the machine. Every refusal is raised as an `UmoError` with its reason as
    text."""

    async def ask(self, user: User, do: str, path: str = "", **more: Any) -> Any:
        """Carry out a verb of `umo.operation.commands.verbs`, and return its result when it has ended. Raises
        CommandRefused if the face only reads or the user lacks the role. An error with which the machine answers is
        raised, too."""

    def may(self, user: User, do: str, path: str = "") -> bool:
        """True if the face would now pass on this command of a user: the face accepts commands, and the user has the
        role."""


class Face(ABC):
    """The translation of one machine into one protocol."""

    proves_users: ClassVar[bool] = False
    """True if the protocol, or the kernel on its behalf, proves who its users are. If False, the users have the role of
    the face in [unverified] (`umo.operation.commands.roles`)."""
    takes_commands: ClassVar[bool] = True
    """True if the protocol has commands at all."""

    address = ""
    """The address for clients, once the face is open."""

    async def open(self) -> None:
        """Called once, before anything else: open the server, or the connection. Raises UmoError if that fails."""
        return

    async def close(self) -> None:
        """Called once, after everything else."""
        return

    @abstractmethod
    async def begin(self, machine: Declaration, commands: Commands) -> None:
        """Called when a run begins."""

    @abstractmethod
    async def frames(self, changes: Changes) -> None:
        """Called with the changes since the last call. The first call of a run contains all values."""

    async def events(self, events: Sequence[NumberedEvent]) -> None:
        """Called with new events, oldest first. By default they are ignored."""
        return

    @abstractmethod
    async def end(self, why: str) -> None:
        """Called when the run is over, or can no longer be read. From then on every value is stale or bad."""
