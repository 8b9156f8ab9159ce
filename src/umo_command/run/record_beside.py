"""The recorder of a run, with its file and its process. `umo run` starts the process before the run, and does not wait
for it before the machine is safe."""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from types import TracebackType
from typing import Any

from umo.errors import OptionError, text_of
from umo.exit_status import ExitStatus
from umo.process.frames import Reader
from umo.system import calls
from umo.system.packages import how_to_install
from umo.system.signal_handling import SIGNALS, handling
from umo_command.console import say
from umo_command.run.process_beside import ProcessBeside

SUFFIX = ".mcap"
READY, FRAMES = b"ready", b"frames"
"""The two messages between the processes. The second one carries the descriptors of the frames."""
START_TIMEOUT = 10.0
"""Time in s within which the process must be ready. After that, the run begins without the recorder."""
END_TIMEOUT = 60.0
"""Time in s within which the process must write the remaining data after the run."""
NEEDED = ("google.protobuf", "zstandard")


@dataclass(frozen=True)
class RecordOrder:
    """An order to record: a file, and settings as plain data (`umo.recording.record_settings`)."""

    file: Path
    settings: Mapping[str, Any]


def check_installed() -> None:
    """Raise OptionError, with the package to install, if the recorder is not installed."""
    for each in NEEDED:
        if find_spec(each.partition(".")[0]) is None or find_spec(each) is None:
            raise OptionError(f"recording needs {each}: {how_to_install('record')}")


def order_of(
    file: Path | None,
    changes: Mapping[str, Any],
    table: Mapping[str, Any] | None,
    default: Path,
    wiring: str = "wiring",
) -> RecordOrder:
    """Return the order given by the command line and the table `[record]` of the wiring. Raises OptionError for an
    error in either, for a file that exists, and for a missing folder."""
    check_installed()
    from umo.recording.part_names import part_name
    from umo.recording.record_settings import record_of

    settings = record_of(table or {}, wiring, changes)
    path = default if file is None else file.with_name(file.name if file.suffix == SUFFIX else file.name + SUFFIX)
    if path.exists():
        raise OptionError(f"{path}: this file exists already, and a recording never overwrites a file")
    if (second := part_name(path, 2)).exists():
        raise OptionError(f"{path}: {second}, the name of the second file, exists already; give another name")
    if not path.parent.is_dir():
        raise OptionError(f"{path}: there is no folder {path.parent}")
    return RecordOrder(path, settings.plain)


class RecordBeside(ProcessBeside):
    """The process that records a run in real time. Its failure does not affect the run."""

    def __init__(self, order: RecordOrder | None, command: Sequence[str] = ()) -> None:
        """`order`: None means that nothing is started. `command`: another program, for tests."""
        super().__init__("umo_command.run.record_process", command)
        self._order = order
        self._channel: socket.socket | None = None
        self.complete = True
        """True if everything was recorded that should be."""

    def __enter__(self) -> RecordBeside:
        if self._order is not None:
            try:
                self._start(self._order)
            except (OSError, ValueError) as error:
                self._miss(f"nothing is recorded: the recorder cannot be started: {text_of(error)}")
        return self

    def _start(self, order: RecordOrder) -> None:
        self._channel, there = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with there:
            arguments = [str(there.fileno()), str(order.file), json.dumps(dict(order.settings))]
            self._begin(arguments, sys.path, subprocess.DEVNULL, [there.fileno()])
        self._channel.settimeout(START_TIMEOUT)
        with suppress(OSError):  # data that are not read would break the connection when it is closed
            self._channel.recv(len(READY))

    def attach(self, reader: Reader) -> None:
        """Pass the frames of the run to the recorder. The run has begun."""
        if self._channel is not None and reader.ends is not None:
            with suppress(OSError):  # the recorder has ended; `look` reports this
                calls.send_message(self._channel, FRAMES, reader.ends)
            self._channel.close()
            self._channel = None

    def look(self) -> None:
        """Print the output of the process. If the process has ended before the run, print a notice once."""
        self._look(run_is_over=False)

    def _look(self, run_is_over: bool) -> None:
        if self._process is None:
            return
        status = self._process.poll()
        self._tell_lines()
        if status is not None:
            how = self._forget(status)
            if status == ExitStatus.NOT_RECORDED:  # the recorder has printed the reason
                self.complete = False
            elif status:
                self._miss(
                    f"the recorder has ended ({how}); the data that it had not written are lost"
                    if run_is_over
                    else f"the recorder has ended ({how}); the machine continues, and is no longer recorded"
                )

    def _miss(self, text: str) -> None:
        self.complete = False
        say(text)

    def _tell_lines(self) -> None:
        for line in self._lines():
            say(line)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End the recording after the run: the recorder writes the rest."""
        if self._channel is not None:
            self._channel.close()
        if (process := self._process) is None:
            return
        with handling(signal.SIG_IGN, SIGNALS):
            until = time.monotonic() + END_TIMEOUT
            while process.poll() is None and time.monotonic() < until:
                self._tell_lines()
                with suppress(subprocess.TimeoutExpired):
                    process.wait(0.02)
            if process.returncode is None:
                self._kill()
            self._look(run_is_over=True)
