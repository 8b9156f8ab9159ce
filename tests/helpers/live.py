"""Runs of a station in real time over Modbus, with a plant in another process, recorded as they run."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import umo
from helpers.waiting import until
from umo.process.outcome import Outcome
from umo.process.start import Started
from umo.process.station import find
from umo.recording.recorder import Recorder
from umo.recording.recording_file import RecordingFile

Act = Callable[[Started, int], object]
"""Called while the run goes on, with the number of frames so far."""


@contextmanager
def plant(station: str, folder: Path) -> Iterator[Path]:
    """The plant of a station behind a Modbus box; the wiring for it, with a hang limit that a busy computer keeps."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    text = (find(station).path / "wiring" / "modbus.toml").read_text("utf-8")
    text = re.sub(r"(?m)^port = \d+", f"port = {port}", text)
    text = re.sub(r"(?m)^watchdog.*\n", "", text)
    text = re.sub(r'(?m)^timeout = .*"', 'timeout = "500 ms"', text)
    wiring = folder / "modbus.toml"
    wiring.write_text(f'{text}\n[process]\nhang_timeout = "5 s"\n')
    command = [sys.executable, "-m", "umo_command", "device", "plant", station, "--port", str(port), "--watchdog", "0"]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        until(lambda: _answers(port))
        yield wiring
    finally:
        process.send_signal(signal.SIGTERM)
        process.wait(20)


def _answers(port: int) -> bool:
    with socket.socket() as client:
        return client.connect_ex(("127.0.0.1", port)) == 0


def record_live(
    station: str, wiring: Path | str | None, file: Path, act: Act = lambda started, frames: None, **options: Any
) -> Outcome:
    """Start the station, record it to the file until it has ended; how it ended. `act` is called again and again."""
    started = umo.start(station, wiring, **options)
    until(lambda: started.poll() or started.frames is not None or started.outcome is not None)
    assert started.frames is not None, started.outcome
    reader = started.frames.again()
    with closing(RecordingFile(file, reader.layout)) as target:
        recorder = Recorder(reader, target)
        while not (ended := recorder.has_ended):
            recorder.look()
            act(started, recorder.periods)
            started.poll(recorder.pause)
        assert ended
        recorder.finish()
        recorder.close()
    until(lambda: started.outcome is not None)
    with started:
        assert started.outcome is not None
        return started.outcome


def stopped_and_continued(pid: int, seconds: float) -> None:
    """Suspend a process for a while."""
    os.kill(pid, signal.SIGSTOP)
    time.sleep(seconds)
    os.kill(pid, signal.SIGCONT)
