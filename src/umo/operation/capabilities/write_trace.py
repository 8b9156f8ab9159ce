"""A record of the last writes of each actuator and their writers."""

from __future__ import annotations

from collections import deque
from typing import Annotated, Any

from umo.cycle.two_writers import control_of
from umo.cycle.writes import CalledAction
from umo.errors import PathError
from umo.objects import Number, Range, action, described
from umo.objects.claims import WHO, Rank
from umo.operation.capabilities.attached_part import AttachedPart
from umo.text import did_you_mean


class WriteTrace(AttachedPart):
    """The last writes of each actuator of the machine. Write `writes: WriteTrace` in the class of the machine, and
    `writes=WriteTrace()` where the machine is made. `umo do STATION call writes.last path=tank.inlet` shows the writes.

    The trace also has refused writes, and each default that an interlock, a fault, a reset or an expiry has sent. While
    the trace is attached, every write passes the command stage, like the writes of guarded actuators.
    """

    length: Annotated[int, Number("", 1, 10_000)] = 100
    """The number of writes that are kept for each actuator."""

    def setup(self) -> None:
        self._writes: dict[str, deque[dict[str, Any]]] = {}

    def attach(self, machine: Any) -> None:
        self._writes, items, length = {}, machine.image.items, self.length
        about = [described(item) for item in items]

        def note(slot: int, value: float, source: str, taken: bool) -> None:
            item = items[slot]
            entry = {
                "time": round(machine.clock.now, 6),
                "value": about[slot].value(value),
                "who": _who(machine, slot, source),
                "taken": taken,
            }
            self._writes.setdefault(item.path, deque(maxlen=length)).append(entry)

        machine.commands.watch(note)

    @action(harmless=True, count=Range("", 1, 10_000))
    def last(self, path: str, count: int = 10) -> list[dict[str, Any]]:
        """Return the last writes of an actuator, the newest last: time in s, value, writer, and whether the write was
        accepted."""
        if path not in self._writes:
            raise PathError(f"nothing has been written to {path!r}{did_you_mean(path, self._writes)}")
        return list(self._writes[path])[-count:]


def _who(machine: Any, slot: int, source: str) -> str:
    """Return the writer as text."""
    if source == "client":
        return f"client {machine.claims.client_of(slot)}"
    if source == "default":
        rank = machine.claims.claim(slot).rank
        return "default" if rank is Rank.PROGRAM else f"default: {WHO[rank]}"
    turn = machine.sequences.current
    if turn.task is not None:
        return str(turn.task.shown.name)
    if isinstance(turn.law, CalledAction):
        return str(turn.law)
    if turn.law is not None:
        return control_of(turn.law.__self__)
    return "the program"
