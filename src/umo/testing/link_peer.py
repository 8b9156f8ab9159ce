"""A host that sends a controller any frame that a rule needs, valid or invalid."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import count
from time import monotonic

from umo.drivers.streams import TimedOut
from umo.drivers.streams.stream import Stream
from umo.generate.split.link_bodies import (
    ControllerState,
    FrameItem,
    FrameKind,
    StateReader,
    Welcome,
    hello,
    item,
    request,
    welcome_of,
)
from umo.generate.split.link_frames import FrameReader, framed
from umo.generate.split.part_plan import PartPlan
from umo.testing.conformance.rules import RuleBroken

TRIES = 5
"""Number of times that a frame is sent before a rule gives up. A line may lose some frames."""


class LinkPeer:
    """Sends frames to a controller over an open stream. Every output of the part is inhibited, so that nothing is
    driven."""

    def __init__(self, stream: Stream, plan: PartPlan, patience: float) -> None:
        """`patience`: the timeout in s for an answer."""
        self._stream, self._plan, self._states = stream, plan, StateReader(plan)
        self._reader = FrameReader(plan.longest)
        self._nonces = count(int(monotonic() * 1e6) & 0xFFFF_0000)
        self.patience = patience
        self.session = 0
        self.number = 0
        """The number of the last frame."""

    # What is said ----------------------------------------------------------------------------------------

    def new_nonce(self) -> int:
        return next(self._nonces) & 0xFFFF_FFFF

    def body(
        self, kind: FrameKind, *, session: int | None = None, number: int | None = None, items: Sequence[bytes] = ()
    ) -> bytes:
        """Return the body of a request, by default the next one of the session."""
        if number is None:
            self.number = number = (self.number + 1) & 0xFFFF
        inhibited = [True] * len(self._plan.model.outputs)
        return request(kind, self.session if session is None else session, number, inhibited, items)

    def fields(self) -> list[bytes]:
        """Return the items of a START frame: the host's values of the part's fields."""
        return [item(FrameItem.FIELD, number, each.live()) for number, each in enumerate(self._plan.fields)]

    def send(self, data: bytes) -> None:
        """Send bytes unchanged."""
        self._stream.send(data, monotonic() + self.patience)

    # What is answered ------------------------------------------------------------------------------------

    def greeted(self, nonce: int | None = None) -> Welcome:
        """Send a greeting and return its answer. Raises RuleBroken if there is no answer."""
        nonce = self.new_nonce() if nonce is None else nonce
        for _ in range(TRIES):
            self.send(framed(hello(nonce)))
            for body in self._bodies():
                if (welcome := welcome_of(body)) is not None and welcome.nonce == nonce:
                    return welcome
        raise RuleBroken("a greeting is not answered", "greeting")

    def asked(self, kind: FrameKind, items: Sequence[bytes] = (), *, session: int | None = None) -> ControllerState:
        """Send a frame that must be carried out, and return its answer. Raises RuleBroken if there is no answer."""
        for _ in range(TRIES):
            self.send(framed(self.body(kind, session=session, items=items)))
            for state in self._told():
                if state.heard == self.number:
                    return state
        raise RuleBroken(f"{kind.name} is not answered", kind.name)

    def refused(self, data: bytes, what: str) -> None:
        """Send these bytes. Raises RuleBroken if they are answered."""
        self.send(data)
        for state in self._told():
            raise RuleBroken(f"{what} is carried out: it is answered, with number {state.heard}")

    def started(self) -> ControllerState:
        """Start a session and return the controller's answer. Raises RuleBroken if the part does not run."""
        self.session = self.greeted().session
        state = self.asked(FrameKind.START, self.fields())
        if state.session != self.session:
            raise RuleBroken(f"START of session {self.session} is answered with session {state.session}")
        return state

    def silent(self, span: float) -> None:
        """Send nothing for a time in s."""
        end = monotonic() + span
        while True:
            try:
                self._stream.receive(end)
            except TimedOut:
                return

    def _told(self) -> list[ControllerState]:
        return [state for body in self._bodies() if (state := self._states.read(body)) is not None]

    def _bodies(self) -> list[bytes]:
        """Return the data received until one frame is complete, and the rest."""
        deadline, found = monotonic() + self.patience, list[bytes]()
        while not found:
            try:
                found = self._reader.take(self._stream.receive(deadline))
            except TimedOut:
                break
        return found
