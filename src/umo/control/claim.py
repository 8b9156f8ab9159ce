"""One motion at a time on an axis."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from umo.errors import Busy
from umo.objects import Compound


class Claim:
    """Held for the length of a motion: `with self.claim.of("move_to"):`; a second one raises Busy."""

    def __init__(self, owner: Compound) -> None:
        self._owner = owner
        self.holder: str | None = None

    @contextmanager
    def of(self, what: str) -> Iterator[None]:
        if self.holder is not None:
            raise Busy(f"{self._owner.path} is busy with {self.holder}; {what} has to wait")
        self.holder = what
        try:
            yield
        finally:
            self.holder = None
