"""Serves the faces of a station's wiring during a run, in one separate process, which `umo run` starts, watches and
ends."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import tempfile
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from time import monotonic
from types import TracebackType
from typing import Any

from umo.errors import Mistake, OptionError, WiringError, text_of
from umo.process.job import Plan
from umo.system.signal_handling import SIGNALS, handling
from umo.text import count_of
from umo.wiring.settings import SettingsError
from umo_command.console import say
from umo_command.run.process_beside import ProcessBeside

FIRST_PAUSE, MAX_PAUSE = 1.0, 60.0
"""Time in s after which a process that has ended is started again. The time doubles with each start, up to the maximum,
until a process has lived for the maximum time."""
NICENESS = 15
"""Niceness of the process, from its start on."""
END_TIMEOUT = 5.0
"""Time in s within which the process must end."""
MAX_TOLD = 50
"""Largest number of lines of the process that are remembered. Remembered lines are not printed again."""


def faces_of(wiring: str, table: Mapping[str, Any], tell: Callable[[str], object] = say) -> dict[str, Any]:
    """Return the table `[faces]` of a wiring without the faces that are not installed. For these, print what to
    install. The table is empty if there is no face. Raises WiringError for an error in the table."""
    if not table:
        return {}
    from umo.clients.faces.face_settings import KEYS, faces_present, faces_settings

    try:
        present, missing = faces_present(faces_settings(table, wiring))
    except SettingsError as error:
        raise WiringError(f"{count_of(len(error.mistakes), 'error')} in the wiring", error.mistakes) from None
    except OptionError as error:
        mistake = Mistake(wiring, "faces", str(error))
        raise WiringError("1 error in the wiring", [mistake]) from None
    for line in missing:
        tell(line)
    kept = {key: value for key, value in table.items() if key in KEYS or key in present.options}
    return kept if present.options else {}


def wiring_of(plan: Plan) -> str:
    """Return the file of a run's wiring."""
    return str(plan.wiring) if plan.wiring_name else "wiring"


def names_in(table: Mapping[str, Any]) -> list[str]:
    """Return the names of the faces in a table that `faces_of` has returned."""
    return [name for name, value in table.items() if isinstance(value, Mapping) and name != "dead_bands"]


class FacesBeside(ProcessBeside):
    """The process that serves the faces of a run. It cannot delay the run: `umo run` does not wait for it before the
    machine is safe at the end of the block."""

    def __init__(
        self,
        wiring: str,
        table: Mapping[str, Any],
        *,
        command: Sequence[str] = (),
        clock: Callable[[], float] = monotonic,
    ) -> None:
        """`table`: the result of `faces_of` for this wiring; if it is empty, nothing is started. `command`: the
        program, for tests."""
        super().__init__("umo_command.connect.faces", command)
        self._wiring, self._table = wiring, table
        self._clock = clock
        self._begun, self._pause, self._next = 0.0, FIRST_PAUSE, 0.0
        self._told: deque[str] = deque(maxlen=MAX_TOLD)
        self.is_ending = False
        """True if the run is ending, so that a process that ends now is not started again."""

    def look(self, pid: int | None, path: Sequence[str]) -> None:
        """Print the output of the process, start it, or start it again. `pid`: the control process, or None before it
        exists."""
        if not self._table or pid is None:
            return
        if self._process is not None:
            status = self._process.poll()  # read before the text, so that the last lines are printed, too
            for line in self._lines()[:MAX_TOLD]:
                self._tell(f"faces: {line}")
            if status is None:
                return
            self._note_end(status)
        if not self.is_ending and self._clock() >= self._next:
            self._start(pid, path)

    def _start(self, pid: int, path: Sequence[str]) -> None:
        self._begun = self._clock()
        try:
            with tempfile.TemporaryFile() as table:
                table.write(json.dumps(self._table, default=str).encode())
                table.seek(0)
                self._begin([str(os.getpid()), str(pid), self._wiring], path, table)
        except Exception as error:  # such as a full disk or too many processes: this must not end the run
            self._missed(f"the faces cannot be started: {text_of(error)}; umo tries again")
            return
        assert self._process is not None
        with suppress(OSError):  # it has ended
            os.setpriority(os.PRIO_PROCESS, self._process.pid, NICENESS)

    def _note_end(self, status: int) -> None:
        how = self._forget(status)
        if self.is_ending:
            return
        if self._clock() - self._begun >= MAX_PAUSE:
            self._pause = FIRST_PAUSE
            self._told.clear()
        self._missed(f"the faces have ended ({how}); the machine continues, and the faces are started again")

    def _missed(self, line: str) -> None:
        self._tell(line)
        self._next = self._clock() + self._pause
        self._pause = min(2 * self._pause, MAX_PAUSE)

    def _tell(self, line: str) -> None:
        """Print a line once. It can be printed again when a process has lived for a long time."""
        if line not in self._told:
            self._told.append(line)
            say(line)

    def __enter__(self) -> FacesBeside:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._process is None:
            return
        assert self._process.stdout is not None
        with handling(signal.SIG_IGN, SIGNALS), self._process.stdout:
            self._process.terminate()
            try:
                self._process.wait(END_TIMEOUT)
            except subprocess.TimeoutExpired:
                self._kill()
