"""The contract of a face: four methods that it implements, and the one object that it is given.

    class Lamp(Face):
        async def begin(self, machine, commands): ...   # the declaration of a run; it has no values yet
        async def frames(self, changes): ...            # what has changed since the last call
        async def events(self, events): ...
        async def end(self, why): ...                   # every value is now stale or bad

The host calls them one after the other, never two at once, from one task of its loop: a face that is slow gets fewer
calls with more in each, and disturbs nobody. What a face raises is told, and the face begins again after a pause.
Between `end` and the next `begin` there is no machine: what a client reads then has no good quality.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import numpy as np
import numpy.typing as npt

from umo.faces.face_declaration import Declaration
from umo.frames.reader import NumberedEvent
from umo.objects import Quality
from umo.objects.scaling import FloatArray


@dataclass(frozen=True)
class Changes:
    """What has changed. The arrays have one row for each item of the declaration; `places` tells which are new."""

    period: int
    """Number of the last frame: order is by run and period, never by UTC."""
    utc: float
    """When its period began, s since 1970."""
    utc_error: float | None
    """Largest error of `utc`, s; None: not known, the clock of the computer is not synchronised."""
    places: npt.NDArray[np.intp]
    values: FloatArray
    """NaN: there is no value."""
    quality: npt.NDArray[np.uint8]
    """`Quality`."""
    times: FloatArray
    """When the device gave each value, UTC as `utc`; NaN: never."""

    def quality_of(self, place: int) -> Quality:
        return Quality(int(self.quality[place]))


@dataclass(frozen=True)
class User:
    """Who gives a command, as far as that is proved."""

    name: str
    proved: bool
    """Whether the name is proved: by a password, a certificate, the account of a process of this computer."""
    is_owner: bool = False
    """Whether it is proved that this is the user who runs the machine (`umo.system.peer_account`), who may give every
    command. Everybody else needs a role."""
    is_alive: Callable[[], bool] | None = None
    """Whether the session of this client lives; None: the protocol does not tell."""


class Commands(Protocol):
    """Gives the commands of a face's users to the machine. Every refusal is an `UmoError` in words."""

    async def ask(self, user: User, do: str, path: str = "", **more: Any) -> Any:
        """Carry out a command of `umo.clients.client_control.COMMANDS`; its result when it has ended. CommandRefused if
        the face only reads or the user may not, and whatever error the machine answers with."""

    def may(self, user: User, do: str, path: str = "") -> bool:
        """Whether the face passes such a command of a user on, as things are: it does not only read, and the user has
        the role."""


class Face(ABC):
    """The translation of one machine into one protocol."""

    proves_users: ClassVar[bool] = False
    """Whether the protocol, or the kernel for it, proves who its users are. Without that they have the role of the face
    in [unverified] (`umo.system.roles`)."""
    takes_commands: ClassVar[bool] = True
    """Whether the protocol has commands at all."""

    address = ""
    """Where clients reach it, once it is open."""

    async def open(self) -> None:
        """Called once, before anything else: open the server, or the connection. UmoError if that cannot be."""
        return

    async def close(self) -> None:
        """Called once, after everything else."""
        return

    @abstractmethod
    async def begin(self, machine: Declaration, commands: Commands) -> None:
        """A run is there."""

    @abstractmethod
    async def frames(self, changes: Changes) -> None:
        """What has changed since the last call; in the first call of a run everything."""

    async def events(self, events: Sequence[NumberedEvent]) -> None:
        """New events, oldest first. Default: they are not told."""
        return

    @abstractmethod
    async def end(self, why: str) -> None:
        """The run is over, or cannot be seen: from now on every value is stale or bad."""
