"""The interface of a running station that tuning needs. `umo.attach` returns one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Protocol

from umo.operation.commands.verb import Verb
from umo.process.frames import Reader


class RunningStation(Protocol):
    """A station whose frames are read and to which commands are sent under the lease of the caller."""

    reader: Reader

    def __getitem__(self, name: str) -> Any:
        """Return the object at this path. Raises PathError if there is none."""

    def __setitem__(self, name: str, value: Any) -> None:
        """Set the tunable number at this path, in its unit. Raises RangeError if the value is outside of the range."""

    def carry_out(
        self,
        verb: Verb,
        path: str = "",
        arguments: Mapping[str, Any] | None = None,
        while_running: Callable[[], object] = lambda: None,
    ) -> Any:
        """Give a command, and return its result. `while_running` is called repeatedly until the command ends. Raises
        the errors of the machine."""
