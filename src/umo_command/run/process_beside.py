"""A process that accompanies a run. It cannot delay the run, because its output is read without waiting."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from typing import IO

from umo.process.start import ONE_THREAD
from umo.system import notify

MAX_BYTES = 1 << 16
"""Largest number of bytes of the process's output that are read at a time. It is the capacity of a pipe."""
KILL_TIMEOUT = 1.0
"""Time in s within which the process must have ended after it was killed."""


class ProcessBeside:
    """One process. `module` is the Python module to run. `command` is another program in its place, for tests."""

    def __init__(self, module: str, command: Sequence[str] = ()) -> None:
        self._command = command or [sys.executable, "-P", "-m", module]
        self._process: subprocess.Popen[bytes] | None = None
        self._rest = b""

    def _begin(
        self, arguments: Sequence[str], path: Sequence[str], stdin: int | IO[bytes], pass_fds: Sequence[int] = ()
    ) -> None:
        """Raise OSError if it cannot be started."""
        environ = dict(os.environ) | {"PYTHONPATH": os.pathsep.join(filter(None, path))} | ONE_THREAD
        notify.without(environ)
        self._process = subprocess.Popen(
            [*self._command, *arguments], stdin=stdin, pass_fds=pass_fds, stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT, env=environ, start_new_session=True,
        )  # fmt: skip
        assert self._process.stdout is not None
        os.set_blocking(self._process.stdout.fileno(), False)

    def _lines(self) -> list[str]:
        """Return the lines that it has printed since the last call."""
        assert self._process is not None and self._process.stdout is not None
        with suppress(OSError):  # nothing new
            *lines, rest = (self._rest + os.read(self._process.stdout.fileno(), MAX_BYTES)).split(b"\n")
            self._rest = rest[:MAX_BYTES]
            return [line.decode(errors="replace") for line in lines]
        return []

    def _forget(self, status: int) -> str:
        """Return as text how the process ended. Call this after the process has ended and its output has been read."""
        assert self._process is not None and self._process.stdout is not None
        self._process.stdout.close()
        self._process, self._rest = None, b""
        return f"signal {-status}" if status < 0 else f"status {status}"

    def _kill(self) -> None:
        assert self._process is not None
        self._process.kill()
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(KILL_TIMEOUT)
