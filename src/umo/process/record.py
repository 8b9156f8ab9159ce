"""What became of a machine's last run, on disk: it outlives the processes, and the computer's going down.

A record says "running" from the start of a run to its safe end, when it is removed. One that is still there when
nobody runs the machine tells of an unsafe end; the next start wants that acknowledged.
"""

from __future__ import annotations

import json
import os
import tempfile
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path

from umo.errors import StandsStopped, UmoError

VARIABLE = "UMO_STATE"
"""Environment variable that names another folder, for containers and tests."""


def state_folder() -> Path:
    """Where umo keeps what outlives a run: the XDG state folder, or one for temporary files if there is none."""
    if given := os.environ.get(VARIABLE):
        path = Path(given)
    else:
        path = Path(os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state") / "umo"
    try:
        path.mkdir(parents=True, exist_ok=True)
        if os.access(path, os.W_OK):
            return path
    except OSError:
        pass
    path = Path(tempfile.gettempdir()) / f"umo-state-{os.getuid() if hasattr(os, 'getuid') else 'user'}"
    path.mkdir(mode=0o700, exist_ok=True)
    return path


@dataclass
class Ended:
    """A record's content."""

    station: str
    wiring: str
    state: str
    """running or stopped"""
    when: float
    """s since 1970"""
    what: str = ""
    unreached: list[str] = field(default_factory=list)

    def __str__(self) -> str:
        when = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(self.when))
        name = f"{self.station} ({self.wiring})" if self.wiring else self.station
        if self.state == "running":
            return (
                f"{name} was started at {when}, and all of its processes ended at once, or the computer did; "
                "only the circuits' own watchdogs can have dropped its outputs"
            )
        reached = f"not reached: {', '.join(self.unreached)}" if self.unreached else "every actuator was reset"
        return f"{name} was stopped at {when}: {self.what}; {reached}"


class Record:
    """The record of one machine: of one station and wiring. `lock` is the machine's lock file, which names it."""

    def __init__(self, lock: Path, station: str, wiring: str) -> None:
        self._path = state_folder() / "machines" / f"{lock.stem}.json"
        self._station, self._wiring = station, wiring

    def begin(self, acknowledged: bool) -> None:
        """The machine is about to run; StandsStopped if its last run ended unsafely and nobody acknowledged it.
        UmoError where that cannot be written down: an unsafe end could not be told from a safe one."""
        before = self.standing()
        if before is not None and not acknowledged:
            raise StandsStopped(f"{before}.\nLook at the machine, then start it with --acknowledge")
        try:
            self._write(Ended(self._station, self._wiring, "running", time.time()))
        except OSError as error:
            raise UmoError(f"the start could not be written down in {self._path.parent}: {error.strerror}") from None

    def finish(self) -> None:
        """The run ended safely."""
        self._path.unlink(missing_ok=True)

    def stopped(self, what: str, unreached: list[str]) -> None:
        """The run ended unsafely; the machine stands stopped."""
        self._write(Ended(self._station, self._wiring, "stopped", time.time(), what, unreached))

    def standing(self) -> Ended | None:
        """How the last run ended, if not safely."""
        return read(self._path)

    def _write(self, ended: Ended) -> None:
        self._path.parent.mkdir(parents=True, exist_ok=True)
        new = self._path.with_suffix(".new")
        with new.open("w", encoding="utf-8") as file:
            json.dump(asdict(ended), file)
            file.flush()
            os.fsync(file.fileno())
        new.replace(self._path)


def read(path: Path) -> Ended | None:
    try:
        return Ended(**json.loads(path.read_text(encoding="utf-8")))
    except FileNotFoundError:
        return None
    except (OSError, ValueError, TypeError):
        return Ended(path.stem, "", "stopped", time.time(), "its record cannot be read", [])
