"""One motion at a time on an axis."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from umo.errors import Busy
from umo.objects import Compound


class Claim:
    """Reserves an axis for one motion: `with self.claim.of("move_to"):`. A second motion raises Busy."""

    def __init__(self, owner: Compound) -> None:
        self._owner = owner
        self.holder: str | None = None

    def busy(self, what: str) -> Busy:
        """The error for a motion that cannot be started now."""
        return Busy(f"{self._owner._path} is busy with {self.holder}; {what} was not started")

    @contextmanager
    def of(self, what: str) -> Iterator[None]:
        if self.holder is not None:
            raise self.busy(what)
        self.holder = what
        try:
            yield
        finally:
            self.holder = None
