"""The recorder of a run: which file it writes, and its process, which `umo run` starts before the run and never waits
for until the machine is safe."""

from __future__ import annotations

import json
import os
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
from umo.frames import Reader
from umo.process.start import ONE_THREAD
from umo.system import descriptor_passing, notify
from umo.system.signal_handling import SIGNALS, handling

from .console import say

SUFFIX = ".mcap"
READY, FRAMES = b"ready", b"frames"
"""What the process says, and what is said with the descriptors of the frames."""
START_TIMEOUT = 10.0
"""Timeout in s for the process to be ready: the run begins then, with or without it."""
END_TIMEOUT, KILL_TIMEOUT = 60.0, 1.0
"""Timeouts in s for the process to write the rest after the run, and to die."""
NEEDED = ("google.protobuf", "zstandard")


@dataclass(frozen=True)
class RecordOrder:
    """What is to be recorded: a file, and settings as plain data (`umo.recording.record_settings`)."""

    file: Path
    settings: Mapping[str, Any]


def check_installed() -> None:
    """OptionError with what to install."""
    for each in NEEDED:
        if find_spec(each.partition(".")[0]) is None or find_spec(each) is None:
            raise OptionError(f'recording needs {each}: pip install "umo[record]"')


def settings_in(table: Mapping[str, Any]) -> dict[str, Any]:
    """The settings of the table `[record]` of a wiring as plain data. OptionError for a mistake in it."""
    check_installed()
    from umo.recording.record_settings import settings_of

    return settings_of(table).plain


def order_of(
    file: Path | None, changes: Mapping[str, Any], table: Mapping[str, Any] | None, default: Path
) -> RecordOrder:
    """What the command line and the table `[record]` of the wiring ask for. OptionError for a mistake, for a file that
    is there already, or a folder that is not."""
    check_installed()
    from umo.recording.part_names import part_name
    from umo.recording.record_settings import settings_of

    settings = settings_of(
        {key: value for key, value in changes.items() if value is not None}, settings_of(table or {})
    )
    path = default if file is None else file.with_name(file.name if file.suffix == SUFFIX else file.name + SUFFIX)
    if path.exists():
        raise OptionError(f"--record {path}: there is such a file already; a recording never overwrites one")
    if (second := part_name(path, 2)).exists():
        raise OptionError(f"--record {path}: there is {second} already, where it would go on; give another name")
    if not path.parent.is_dir():
        raise OptionError(f"--record {path}: there is no folder {path.parent}")
    return RecordOrder(path, settings.plain)


class RecordBeside:
    """The process that records a run in real time. Whatever happens to it, the run goes on."""

    def __init__(self, order: RecordOrder | None, command: Sequence[str] = ()) -> None:
        """`order`: None: nothing is started. `command`: the program, for tests."""
        self._order = order
        self._command = command or [sys.executable, "-P", "-m", "umo.cli.record_process"]
        self._process: subprocess.Popen[bytes] | None = None
        self._channel: socket.socket | None = None
        self._rest = b""
        self.complete = True
        """Whether everything was recorded that was to be."""

    def __enter__(self) -> RecordBeside:
        if self._order is not None:
            try:
                self._start(self._order)
            except (OSError, ValueError) as error:
                self._miss(f"nothing is recorded: the recorder cannot be started: {text_of(error)}")
        return self

    def _start(self, order: RecordOrder) -> None:
        environ = dict(os.environ) | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))} | ONE_THREAD
        notify.without(environ)
        self._channel, there = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with there:
            self._process = subprocess.Popen(
                [*self._command, str(there.fileno()), str(order.file), json.dumps(dict(order.settings))],
                pass_fds=[there.fileno()], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                env=environ, start_new_session=True,
            )  # fmt: skip
        assert self._process.stdout is not None
        os.set_blocking(self._process.stdout.fileno(), False)
        self._channel.settimeout(START_TIMEOUT)
        with suppress(OSError):  # taken: what is not read breaks the connection when it is closed
            self._channel.recv(len(READY))

    def attach(self, reader: Reader) -> None:
        """The run has begun: hand its frames over."""
        if self._channel is not None and reader.ends is not None:
            with suppress(OSError):  # it has ended, which is told
                descriptor_passing.send(self._channel, FRAMES, reader.ends)
            self._channel.close()
            self._channel = None

    def look(self) -> None:
        """Tell what the process says, and once that it has ended before the run."""
        self._look(run_is_over=False)

    def _look(self, run_is_over: bool) -> None:
        if self._process is None:
            return
        status = self._process.poll()
        self._tell_lines()
        if status is not None:
            how = f"signal {-status}" if status < 0 else f"status {status}"
            self._process.stdout.close()  # type: ignore[union-attr]
            self._process = None
            if status == ExitStatus.NOT_RECORDED:  # it has said why
                self.complete = False
            elif status:
                self._miss(
                    f"the recorder has ended ({how}); what it had not written is lost"
                    if run_is_over
                    else f"the recorder has ended ({how}); the machine runs on, and is recorded no longer"
                )

    def _miss(self, text: str) -> None:
        self.complete = False
        say(text)

    def _tell_lines(self) -> None:
        assert self._process is not None and self._process.stdout is not None
        with suppress(OSError):  # nothing new
            while text := os.read(self._process.stdout.fileno(), 1 << 16):
                *lines, self._rest = (self._rest + text).split(b"\n")
                for line in lines:
                    say(line.decode(errors="replace"))

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """The run is over: the recorder writes the rest."""
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
                process.kill()
                with suppress(subprocess.TimeoutExpired):
                    process.wait(KILL_TIMEOUT)
            self._look(run_is_over=True)
