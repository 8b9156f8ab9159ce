"""A thread that an application leaves does not hold up the end of a command without a word."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from umo_command.left_threads import left_threads, tell_threads

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="signals and descriptors of Linux")


def test_threads_that_are_left_are_told_by_name_and_place(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    release = threading.Event()
    threads = [
        threading.Thread(target=release.wait, name=name, daemon=name == "a daemon") for name in ("logger", "a daemon")
    ]
    for each in threads:
        each.start()
    try:
        monkeypatch.setattr(threading, "enumerate", lambda: [threading.main_thread(), *threads])  # not of other tests
        assert [*left_threads()] == threads[:1]
        tell_threads(patience=0.0)
        told = capfd.readouterr().err
        assert told.startswith("umo: the command is done, but a thread of the application still runs: ")
        assert "logger" in told
        assert told.endswith("; Ctrl-C ends the command\n")
    finally:
        release.set()
        for each in threads:
            each.join()
    monkeypatch.setattr(threading, "enumerate", lambda: [threading.main_thread()])
    tell_threads(patience=0.0)
    assert "logger" not in capfd.readouterr().err


APPLICATION = """
import threading
from umo.control import wait
from concurrent.futures import ThreadPoolExecutor

idle = ThreadPoolExecutor()

def write_log():
    threading.Event().wait()

async def main(m):
    idle.submit(int).result()
    if {thread}:
        threading.Thread(target=write_log, name="logger").start()
    await wait("5 ms")
"""
OBJECTS = """
import umo

class Press(umo.Compound):
    timer: umo.DigitalSensor

def machine():
    return Press(timer=umo.DigitalSensor("sampling_period", minimum=0, maximum=99999, resolution=1, synchronous=False))
"""
UMO = [sys.executable, "-c", "from umo_command import main; main()"]


def station(folder: Path, thread: bool) -> Path:
    place = folder / "press"
    place.mkdir()
    (place / "__init__.py").write_text("")
    (place / "objects.py").write_text(OBJECTS)
    (place / "application.py").write_text(APPLICATION.format(thread=thread))
    return folder


@pytest.mark.slow
@pytest.mark.full
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_command_that_waits_for_a_thread_says_so_and_is_ended_by_a_signal(tmp_path: Path, number: int) -> None:
    command = [*UMO, "run", "press", "--no-record"]
    with subprocess.Popen(command, cwd=station(tmp_path, True), stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        line = process.stderr.readline()
        os.kill(process.pid, number)
        assert process.wait(60) == 128 + number
        assert line.startswith(
            "umo: the command is done, but a thread of the application still runs: logger (press/application.py:9"
        )
        assert process.stderr.read() == ""


@pytest.mark.slow
@pytest.mark.full
def test_threads_that_python_ends_by_itself_are_not_told(tmp_path: Path) -> None:
    command = [*UMO, "run", "press", "--no-record"]
    done = subprocess.run(command, cwd=station(tmp_path, False), capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stderr) == (0, "")
