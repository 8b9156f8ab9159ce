"""The guardian's view of the control process: whether the process lives, at which line its code is, and how it has
ended."""

from __future__ import annotations

import os
import re
import signal
from contextlib import suppress

from umo.process.reset import DEATH_TIMEOUT
from umo.process.run_state import RunState
from umo.system import calls
from umo.system.processes import Child
from umo.system.signal_handling import SIGNALS, signal_name
from umo.text import in_brackets, place_among

WHERE_SIGNAL = signal.SIGUSR2
"""The signal at which the control process writes the present place of its Python code to a file."""
UNABLE_STATES = "TtDX"
"""The states in which a process cannot react to this signal: stopped, in an uninterruptible call of the kernel,
ended."""
WHERE_TIMEOUT = 0.05
"""The timeout in s for the text of this place. A running process needs 0.1 ms. The machine is reset afterwards."""


class ControlWatch:
    """The watch over the control process from its fork to its end. `traces` is the file to which the control process
    writes its present line."""

    def __init__(self, pid: int, run_state: RunState, traces: int) -> None:
        self.process = Child(pid)
        self._run_state = run_state
        self._traces = traces
        self._unkillable_from = 0.0
        """The time at which the wait for a process that cannot be killed ends."""

    def is_dead(self, within: float = 0.0) -> bool:
        """Return True if the control process has ended, so that its connections are closed. A process that is blocked
        in the kernel, in a call of its device, counts as dead after some time, because its end cannot be awaited. The
        guardian gives its heartbeats during the wait."""
        self._unkillable_from = self._unkillable_from or calls.now() + DEATH_TIMEOUT
        self._run_state.watch()
        return self._run_state.wait(lambda: self.process.ended, within) or calls.now() >= self._unkillable_from

    def ending(self) -> str:
        """Return as text how the control process has ended. Call this after the process was killed; the function waits
        for the end."""
        self.is_dead(DEATH_TIMEOUT)
        status = self.process.status
        if status is None:
            return "has ended" if self.process.ended else "cannot be killed: it is blocked in a kernel call"
        if os.WIFSIGNALED(status):
            number = os.WTERMSIG(status)
            what = "was killed" if number in (signal.SIGKILL, *SIGNALS) else "crashed"
            return f"{what} ({signal_name(number)})"
        return f"ended with status {os.WEXITSTATUS(status)} without resetting the machine"

    def silent(self, how: str, moment: str) -> str:
        """Return as text that the control process hangs or was kept from running (`how`), with place and time."""
        stopped = " (it was stopped by a signal)" if self.process.is_stopped else ""
        return f"the control process {how}{stopped}{in_brackets(moment, self._where())}"

    def _where(self) -> str:
        """Return the line of the process's Python code as text; "" if the process cannot report it."""
        if self.process.state in UNABLE_STATES:
            return ""
        with suppress(OSError):
            self.process.send(WHERE_SIGNAL)
            frames = re.findall(
                r'^  File "(.+)", line (\d+) in (.+)$', self._traceback(), re.MULTILINE
            )  # innermost first
            return place_among((file, int(line), function) for file, line, function in reversed(frames))
        return ""

    def _traceback(self) -> str:
        """Return the traceback that the process writes, when the text no longer grows between two looks."""
        text, until = b"", calls.now() + WHERE_TIMEOUT
        while calls.now() < until:
            calls.sleep(0.0005)
            before, text = text, os.pread(self._traces, 1 << 16, 0)
            if text and text == before:
                break
        return text.decode(errors="replace")
