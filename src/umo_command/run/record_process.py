"""The program of the recorder that accompanies `umo run`. It receives the descriptors of the frames through an
inherited socket, and records until the run ends. Its notices are lines on stdout."""

from __future__ import annotations

import json
import signal
import socket
import sys
import threading
from pathlib import Path
from typing import Any

from umo.errors import UmoError, text_of
from umo.exit_status import ExitStatus
from umo.process.frames import Reader
from umo.process.frames.memory import RunDescriptors
from umo.recording.record_settings import RecordSettings
from umo.system import calls
from umo.system.processes import name_process
from umo.system.realtime import drop_realtime
from umo_command.run.record_beside import FRAMES, READY
from umo_command.run.record_work import RecordingWork, record_to_the_end

NICENESS = 5
"""Niceness of the process. If the process falls behind by more than the length of a ring, it loses frames."""


def main(file: int, path: Path, settings: dict[str, Any]) -> int:
    name_process("umo record")
    drop_realtime(niceness=NICENESS)
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    with socket.socket(fileno=file) as parent:
        try:
            calls.send_message(parent, READY)
            data, files = calls.receive_message(parent, len(FRAMES), len(RunDescriptors._fields))
        except OSError:  # it was killed
            return 0
    if data != FRAMES or len(files) != len(RunDescriptors._fields):  # there was no run
        return 0
    try:
        with Reader("the run", RunDescriptors(*files)) as reader:
            work = RecordingWork(reader, path, RecordSettings(**settings), tell)
            record_to_the_end(work, stop.is_set, stop.wait)
    except (OSError, UmoError) as error:
        tell(f"nothing is recorded, and the machine continues: {path}: {text_of(error)}")
        return ExitStatus.NOT_RECORDED
    return ExitStatus.NOT_RECORDED if work.failed else 0


def tell(text: str) -> None:
    """Notify the process that has started this process, if it still lives."""
    try:
        print(text, flush=True)
    except OSError:
        sys.stdout = None  # nor at the end


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]), Path(sys.argv[2]), json.loads(sys.argv[3])))
