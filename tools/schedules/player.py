"""Plays schedules, one after the other, in a process that has imported umo on the clock of a world.

    python -m tools.schedules.player          a line of JSON for each line with a schedule

Its processes are the player's: it adopts those whose parents have ended.
"""

from __future__ import annotations

import json
import os
import shutil
import sys
import tempfile
from pathlib import Path
from resource import RUSAGE_CHILDREN, RUSAGE_SELF, getrusage
from typing import Any

from tools.schedules import virtual_time
from tools.schedules.faults import Schedule, parsed
from tools.schedules.shared import START, Memory

MAX_TOLD = 4000
"""Characters of what the processes of a world have printed, at most."""


class Player:
    """`folder`: of what a run leaves behind."""

    def __init__(self, folder: Path) -> None:
        from tools.schedules.world import World  # imports umo, on the clock of the memory

        self._folder = folder
        self._log = (folder / "log").open("w+b")
        self._memory = MEMORY
        self._recording = folder / "run.mcap"
        self._world = World(MEMORY, f"schedules {os.getpid()} ", self._recording)

    def play(self, schedule: Schedule, *, trace: bool = False) -> dict[str, Any]:
        """What came of it, as plain data."""
        from tools.schedules import client_promises
        from tools.schedules.due import Due
        from tools.schedules.promises import End, broken, outcome_of
        from tools.schedules.scheduler import Scheduler, WorldError
        from umo.system.device_record import all_standing

        before = _processor_time()
        shutil.rmtree(self._folder / "state", ignore_errors=True)
        self._recording.unlink(missing_ok=True)
        self._log.seek(0)
        self._log.truncate()
        self._memory.clear()
        scheduler = Scheduler(self._memory, schedule)
        self._world.begin(self._log.fileno(), schedule)
        wrong, outcome = [], None
        try:
            scheduler.play()
            outcome = outcome_of(self._memory.outcome)
            wrong = broken(End(scheduler, outcome, all_standing()))
            if schedule.clients:
                wrong += client_promises.broken(client_promises.ClientsEnd(scheduler, self._recording))
        except (WorldError, OSError) as error:
            wrong = [f"harness: {error!r}"]
        finally:
            scheduler.end()
        due = Due(scheduler)
        found: dict[str, Any] = {
            "schedule": str(schedule),
            "wrong": wrong,
            "steps": scheduler.steps,
            "hash": scheduler.hash,
            "ms": (scheduler.clock - START) / 1e6,
            "gates": {process.name: process.gates for process in scheduler.processes},
            "driven": {"told": self._memory.driven, "asked": scheduler.driven_when_asked},
            "due": str(due),
            "took": due.took,
            "limit": due.limit,
            "outcome": None if outcome is None else _in_short(outcome),
            "levels": self._memory.levels,
            "cpu": _processor_time() - before,
        }
        if trace or wrong:
            found["trace"] = scheduler.lines
            self._log.seek(0)
            found["printed"] = self._log.read().decode(errors="replace")[-MAX_TOLD:]
        return found


def _in_short(outcome: Any) -> str:
    failure = outcome.failure
    told = "" if failure is None else f" {failure.name}: {failure.message}"
    return f"status {outcome.status}{' unsafe' if outcome.unsafe else ''} unreached {outcome.unreached}{told}"


def _processor_time() -> float:
    """s, with that of the children that were waited for."""
    used = [getrusage(who) for who in (RUSAGE_SELF, RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in used)


def _sleep(seconds: float) -> None:
    from umo.system import calls

    if calls.sleep is _sleep:
        raise RuntimeError("a player does not sleep")
    calls.sleep(seconds)


MEMORY = Memory()


def main() -> int:
    virtual_time.install(lambda: MEMORY.clock, _sleep)
    with tempfile.TemporaryDirectory(prefix="umo-schedules-", dir="/dev/shm") as name:
        os.environ |= {"UMO_STATE": f"{name}/state", "UMO_FRAMES": f"{name}/frames"}
        player = Player(Path(name))
        from umo.system.realtime import adopt_orphans

        adopt_orphans(True)
        for line in sys.stdin:
            request = json.loads(line)
            answer = player.play(parsed(request["schedule"]), trace=request.get("trace", False))
            print(json.dumps(answer), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
