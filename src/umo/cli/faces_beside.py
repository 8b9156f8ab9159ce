"""The faces of a station's wiring beside its run: one process, which `umo run` starts, watches and ends."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from time import monotonic
from types import TracebackType
from typing import Any

from umo.errors import Mistake, OptionError, WiringError, text_of
from umo.process.job import Plan
from umo.process.start import ONE_THREAD
from umo.system import notify
from umo.system.signal_handling import SIGNALS, handling

from .console import say

FIRST_PAUSE, MAX_PAUSE = 1.0, 60.0
"""Time in s after which a process that has ended is started again: it doubles, until one has lived for the longest."""
NICENESS = 15
"""Of the process, from its first moment on."""
END_TIMEOUT, KILL_TIMEOUT = 5.0, 1.0
"""Times in s that the process has to end, and to die."""
MAX_TOLD = 50
"""Lines of the process that are not repeated."""
MAX_BYTES = 1 << 16
"""Bytes of its text that are taken at each look."""


def faces_of(wiring: str, table: Mapping[str, Any], tell: Callable[[str], object] = say) -> dict[str, Any]:
    """The table `[faces]` of a wiring without the faces that are not installed, which are told with what to install;
    empty without any face. WiringError for a mistake in it."""
    if not table:
        return {}
    from umo.faces.face_settings import KEYS, faces_present, settings_of

    try:
        present, missing = faces_present(settings_of(table, wiring))
    except OptionError as error:
        mistake = Mistake(wiring, "faces", str(error).removeprefix("faces: "))
        raise WiringError("1 mistake in the wiring", [mistake]) from None
    for line in missing:
        tell(line)
    kept = {key: value for key, value in table.items() if key in KEYS or key in present.options}
    return kept if present.options else {}


def wiring_of(plan: Plan) -> str:
    """The file of a run's wiring."""
    return str(plan.wiring) if plan.wiring_name else "wiring"


def names_in(table: Mapping[str, Any]) -> list[str]:
    """The faces of a table from `faces_of`."""
    return [name for name, value in table.items() if isinstance(value, Mapping) and name != "dead_bands"]


class FacesBeside:
    """The process that serves the faces of a run. It cannot hold up the run: it is asked, not waited for, until the
    machine is safe at the end of the block."""

    def __init__(
        self,
        wiring: str,
        table: Mapping[str, Any],
        *,
        command: Sequence[str] = (),
        clock: Callable[[], float] = monotonic,
    ) -> None:
        """`table`: as from `faces_of` with this wiring; empty: nothing is started. `command`: the program, for
        tests."""
        self._wiring, self._table = wiring, table
        self._command = command or [sys.executable, "-P", "-m", "umo.cli.serve_faces"]
        self._clock = clock
        self._process: subprocess.Popen[bytes] | None = None
        self._begun, self._pause, self._next = 0.0, FIRST_PAUSE, 0.0
        self._told: deque[str] = deque(maxlen=MAX_TOLD)
        self._rest = b""
        self.is_ending = False
        """Whether the run is to end: a process that ends now is not missed."""

    def look(self, pid: int | None, path: Sequence[str]) -> None:
        """Tell what the process says, start it, or start it again. `pid`: the control process; None: not yet."""
        if not self._table or pid is None:
            return
        if self._process is not None:
            status = self._process.poll()  # before its text: the last of it is told too
            self._tell_lines()
            if status is None:
                return
            self._note_end(status)
        if not self.is_ending and self._clock() >= self._next:
            self._start(pid, path)

    def _start(self, pid: int, path: Sequence[str]) -> None:
        environ = dict(os.environ) | {"PYTHONPATH": os.pathsep.join(filter(None, path))} | ONE_THREAD
        notify.without(environ)
        self._begun = self._clock()
        try:
            with tempfile.TemporaryFile() as table:
                table.write(json.dumps(self._table, default=str).encode())
                table.seek(0)
                self._process = subprocess.Popen(
                    [*self._command, str(os.getpid()), str(pid), self._wiring], stdin=table, stdout=subprocess.PIPE,
                    stderr=subprocess.STDOUT, env=environ, start_new_session=True,
                )  # fmt: skip
        except Exception as error:  # a full disk, too many processes: none of it ends the run
            self._missed(f"the faces cannot be started: {text_of(error)}; it is tried again")
            return
        with suppress(OSError):  # it has ended
            os.setpriority(os.PRIO_PROCESS, self._process.pid, NICENESS)
        assert self._process.stdout is not None
        os.set_blocking(self._process.stdout.fileno(), False)

    def _note_end(self, status: int) -> None:
        assert self._process is not None and self._process.stdout is not None
        self._process.stdout.close()
        self._process, self._rest = None, b""
        if self.is_ending:
            return
        if self._clock() - self._begun >= MAX_PAUSE:
            self._pause = FIRST_PAUSE
            self._told.clear()
        how = f"signal {-status}" if status < 0 else f"status {status}"
        self._missed(f"the faces have ended ({how}); the machine runs on, and they are started again")

    def _missed(self, line: str) -> None:
        self._tell(line)
        self._next = self._clock() + self._pause
        self._pause = min(2 * self._pause, MAX_PAUSE)

    def _tell_lines(self) -> None:
        assert self._process is not None and self._process.stdout is not None
        try:
            text = os.read(self._process.stdout.fileno(), MAX_BYTES)
        except OSError:  # nothing new
            return
        *lines, rest = (self._rest + text).split(b"\n")
        self._rest = rest[:MAX_BYTES]
        for line in lines[:MAX_TOLD]:
            self._tell(f"faces: {line.decode(errors='replace')}")

    def _tell(self, line: str) -> None:
        """Once, until a process has lived for long."""
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
        with handling(signal.SIG_IGN, SIGNALS), self._process.stdout, suppress(subprocess.TimeoutExpired):
            self._process.terminate()
            try:
                self._process.wait(END_TIMEOUT)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait(KILL_TIMEOUT)
