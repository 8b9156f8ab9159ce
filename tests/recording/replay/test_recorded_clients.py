"""The levels of the clients of a recording: whose heartbeats are missing, and when."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from umo.cycle.events import CommandState, Event
from umo.operation.commands.client_commands import DEAD_MAN_REASON, DEAD_MAN_TIME, Lease
from umo.recording.replay.recorded_clients import TapeLevels

REFUSED = Event(2.0, "heater", f"CommandRefused: heater: {DEAD_MAN_REASON}: no", "a", 3, CommandState.REFUSED, "write")


def test_a_command_that_was_refused_without_a_heartbeat_is_refused_again_and_the_lease_goes_on() -> None:
    inbox: Any = SimpleNamespace(taken=2)
    player: Any = SimpleNamespace(period=SimpleNamespace(time=1.0))
    levels, lease = TapeLevels(player, inbox, [REFUSED]), Lease()
    lease.acquire("a", "key", 60.0, levels.now())
    for time, taken, is_refused in ((1.0, 2, False), (2.0, 2, False), (2.0, 3, True), (3.0, 3, False)):
        player.period.time, inbox.taken = time, taken
        if not is_refused:
            lease.renew(levels.signed("", 1), levels.now())
        signed = max(levels.signed("heater", 1), lease.signed)
        assert (levels.now() - signed > DEAD_MAN_TIME) is is_refused
    assert not lease.expired(levels.now())
