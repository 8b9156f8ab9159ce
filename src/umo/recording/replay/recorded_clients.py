"""The clients of a recorded run. Their commands arrive in the periods in which the recorded run took them.

Heartbeats are levels in shared memory and are not recorded, but the ends of leases and holds are in the events. A
lease or a hold that ended without an event ends by itself in the replay, too. All other ends have an event.
"""

from __future__ import annotations

import signal
from collections.abc import Iterable, Sequence
from typing import Any

from umo.cycle.events import LET_GO, CommandState
from umo.operation.commands.client_commands import DEAD_MAN_REASON, NOT_RENEWED, ClientCommand
from umo.recording.replay.player import Player

ALL = "*"
"""A path that stands for all holds."""
LONG = 1e6
"""Time in s that is longer than any dead-man time and any lease."""


class TapeInbox:
    """The commands of the recording (`umo.operation.commands.client_commands.Inbox`)."""

    def __init__(self, player: Player) -> None:
        self._player = player
        self.taken = 0
        self.dropped = 0

    def get(self) -> ClientCommand | None:
        period = self._player.period
        while period is not None and self.taken < period.taken:
            self.taken += 1
            data = self._player.commands.pop(self.taken, None)
            try:
                if data is not None:
                    return ClientCommand.parse(self.taken, data)
            except (ValueError, TypeError, AttributeError, RecursionError, OverflowError):
                pass
            self.dropped += 1
        return None


class TapeLevels:
    """The levels of the recording (`umo.operation.commands.client_commands.Levels`), and the clock of the
    heartbeats."""

    def __init__(self, player: Player, inbox: TapeInbox, events: Iterable[Any]) -> None:
        self._player, self._inbox = player, inbox
        self._ends: dict[float, set[str]] = {}
        """The holds that ended because heartbeats were missing: for the time in s of each period, the paths of these
        holds; "" stands for the lease."""
        self._refused: dict[int, float] = {}
        """The commands that were refused because their client sent no heartbeat, each with its time in s."""
        self._stops: dict[float, str] = {}
        """The users who have requested a stop, by the time in s."""
        self._looked = -1.0
        self._clock = LONG
        self.asked: Sequence[int] = _StopRequested(self)
        for event in events:
            self._note(event)

    def _note(self, event: Any) -> None:
        if event.asked == "stop" and event.state is CommandState.DONE:
            self._stops[event.time] = event.who
        elif not event.path and not event.command and event.text.endswith(NOT_RENEWED):
            self._ends.setdefault(event.time, set()).add("")
        elif DEAD_MAN_REASON in event.text and event.state is CommandState.REFUSED:
            self._refused[event.command] = event.time
        elif event.text.startswith(DEAD_MAN_REASON):
            all_of_them = event.asked == LET_GO and not event.command
            self._ends.setdefault(event.time, set()).add(ALL if all_of_them else event.path)

    @property
    def _time(self) -> float:
        return -1.0 if self._player.period is None else self._player.period.time

    @property
    def stop(self) -> tuple[int, str] | None:
        who = self._stops.get(self._time)
        return None if who is None else (signal.SIGTERM, who)

    def now(self) -> float:
        """Return the clock of the heartbeats in s. It jumps before a period in which a lease or a hold ends, and is
        ahead while a command is refused."""
        time = self._time
        if time != self._looked:
            self._looked = time
            self._clock += LONG if time in self._ends else 0.0
        return self._clock + (LONG if self._refuses else 0.0)

    @property
    def _refuses(self) -> bool:
        """True if the command that was taken last is one that was refused in this period."""
        return self._refused.get(self._inbox.taken) == self._time

    def signed(self, path: str, lease: int) -> float:
        now = self.now()
        ends = self._ends.get(self._time, ())
        ended = path in ends or (ALL in ends and path != "") or self._refuses
        return 0.0 if ended else now


class _StopRequested(Sequence[int]):
    """A sequence of one number, which is 1 if a stop is requested in this period, and otherwise 0."""

    def __init__(self, levels: TapeLevels) -> None:
        self._levels = levels

    def __len__(self) -> int:
        return 1

    def __getitem__(self, index: Any) -> Any:
        return int(self._levels.stop is not None)
