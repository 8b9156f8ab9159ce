"""The interface of a client from another project that the conformance kit for faces uses."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Any


class RefusedByFace(Exception):
    """The error that a client received in place of a result, with the text that its user sees."""


class Grade(Enum):
    """The quality of a value in the protocol."""

    GOOD = "good"
    DOUBTFUL = "doubtful"
    """There is a value, and the protocol says that it is not good."""
    NONE = "none"
    """There is no value, or the protocol marks it as bad."""


@dataclass(frozen=True)
class Seen:
    """The value, quality and time of one item as a client sees them."""

    value: float | str | None
    """A number, or the name of a state, or None if the item has no value."""
    grade: Grade
    time: float | None = None
    """The time in s since 1970, or None if the protocol has no times, or no time was sent."""
    unit: str | None = None
    minimum: float | None = None
    maximum: float | None = None
    states: Mapping[int, str] = field(default_factory=dict)
    """The names of the states; empty for a number, or if the protocol does not show them."""


class ForeignClient(ABC):
    """A client from another project, connected to the server of the face. Items have the names of
    `umo.process.frames.machine_items.MachineItem.name`: `cell.level`, `tunable:cell.gain`, `alarm:cell.full`."""

    has_times = True
    """True if values have times."""
    has_words = True
    """True if a refusal reaches the client's user as text."""

    @abstractmethod
    async def read(self, name: str) -> Seen:
        """Return the client's present view of an item. An item that the client does not see is `Seen(None,
        Grade.NONE)`."""

    async def tune(self, path: str, value: Any) -> None:
        """Set a tunable number. Raises RefusedByFace if it is refused."""
        raise NotImplementedError

    async def write(self, path: str, value: Any) -> None:
        """Write an actuator, and hold it while this client lives. Raises RefusedByFace if it is refused."""
        raise NotImplementedError

    async def call(self, path: str, arguments: Mapping[str, Any]) -> Any:
        """Call an action, and wait for its result. Raises RefusedByFace if it is refused."""
        raise NotImplementedError

    async def mode(self, mode: str) -> None:
        """Change the mode. Raises RefusedByFace if it is refused."""
        raise NotImplementedError

    @abstractmethod
    async def close(self) -> None:
        """Disconnect properly."""

    async def kill(self) -> None:
        """Disconnect without closing the session first. Default: `close`."""
        await self.close()
