"""Nothing that is logged or printed holds a loop up, or keeps a command from its end: a full pipe, a stopped terminal
(decision 0060)."""

from __future__ import annotations

import fcntl
import json
import logging
import os
import pty
import re
import select
import signal
import socket
import subprocess
import sys
import termios
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest

import umo_command
from umo.system import streams

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="descriptors as Linux has them")
F_SETPIPE_SZ = 1031


MAX_MOVING = 0.1
"""Time in s in which a busy kernel passes on what a terminal was given, which makes room for more."""


def filled(write_end: int) -> int:
    """Fill what leads to a reader that does not read; the number of bytes. It blocks from now on."""
    os.set_blocking(write_end, False)
    room = select.poll()
    room.register(write_end, select.POLLOUT)
    count = 0
    while True:
        for size in (512, 1):
            with suppress(BlockingIOError):
                while True:
                    count += os.write(write_end, bytes(size))
        if not room.poll(MAX_MOVING * 1e3):
            break
    os.set_blocking(write_end, True)
    return count


def pipe() -> tuple[int, int]:
    return os.pipe()


def sockets() -> tuple[int, int]:
    here, there = socket.socketpair()
    return here.detach(), there.detach()


def terminal() -> tuple[int, int]:
    here, there = pty.openpty()
    told = termios.tcgetattr(there)
    told[1] &= ~termios.OPOST
    termios.tcsetattr(there, termios.TCSANOW, told)
    return here, there


@pytest.fixture(params=[pipe, sockets, terminal], ids=["a pipe", "a socket", "a terminal"])
def ends(request: pytest.FixtureRequest) -> Iterator[tuple[int, int]]:
    """A reader and a writer."""
    both = request.param()
    yield both
    for each in both:
        os.close(each)


def kept_open(number: int, patience: float) -> Any:
    """What `keep_open` puts in the place of stdout and stderr, for this descriptor."""
    with pytest.MonkeyPatch.context() as patch:
        for name in ("stdout", "stderr"):
            patch.setattr(sys, name, getattr(sys, name))  # given back
        streams.keep_open()
        kind: Any = type(sys.stdout.buffer.raw)  # type: ignore[attr-defined]
    return kind(number, patience)


def read_all(end: int, count: int) -> bytes:
    """So many bytes, which are there or come at once."""
    data = b""
    while len(data) < count:
        data += os.read(end, count - len(data))
    return data


def test_what_is_not_taken_at_once_waits_and_is_sent_in_order(ends: tuple[int, int]) -> None:
    here, there = ends
    raw = kept_open(there, 0.0)
    taken = filled(there)
    for number in range(3):
        raw.write(f"line {number}\n".encode())
    assert raw.lost == 0
    read_all(here, taken)
    raw.send_waiting()
    assert read_all(here, 21) == b"line 0\nline 1\nline 2\n"


def test_what_has_no_room_is_dropped_and_counted_and_this_is_told(
    ends: tuple[int, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    here, there = ends
    monkeypatch.setattr(streams, "MAX_WAITING", 20)
    raw = kept_open(there, 0.0)
    taken = filled(there)
    for number in range(5):
        raw.write(f"line {number}\n".encode())
    assert raw.lost == 3
    read_all(here, taken)
    raw.write(b"the next\n")
    told = b"\numo: 3 lines were lost: their reader did not accept them in time\n"
    expected = b"line 0\nline 1\n" + told + b"the next\n"
    assert read_all(here, len(expected)) == expected
    assert raw.lost == 0


def test_a_stream_that_nobody_reads_any_more_takes_everything() -> None:
    here, there = os.pipe()
    raw = kept_open(there, 0.0)
    os.close(here)
    assert raw.write(b"lost\n") == 5
    assert raw.write(b"lost\n") == 5
    os.close(there)


def test_a_reader_that_takes_nothing_is_waited_for_once(ends: tuple[int, int], monkeypatch: pytest.MonkeyPatch) -> None:
    here, there = ends
    waits = list[float]()
    is_ready = streams.is_ready
    monkeypatch.setattr(
        streams, "is_ready", lambda number, limit=0.0: (waits.append(limit), is_ready(number, limit))[1]
    )
    raw = kept_open(there, 0.02)
    taken = filled(there)
    for number in range(3):
        raw.write(f"line {number}\n".encode())
    assert len([each for each in waits if each]) == 1
    read_all(here, taken)
    raw.write(b"the next\n")
    assert read_all(here, 30) == b"line 0\nline 1\nline 2\nthe next\n"


def test_a_slow_reader_that_is_waited_for_loses_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    here, there = os.pipe()
    filled(there)
    read = bytearray()

    def take(number: int, limit: float = 0.0) -> bool:
        read.extend(os.read(here, 5000))
        return True

    monkeypatch.setattr(streams, "is_ready", take)
    text = bytes(range(1, 251)) * 1200  # more than is kept
    raw = kept_open(there, 30.0)
    assert raw.write(text) == len(text)
    raw.close()
    os.close(there)
    while data := os.read(here, 1 << 20):
        read += data
    os.close(here)
    assert read.lstrip(b"\0") == text
    assert raw.lost == 0


def test_what_waits_is_not_sent_again_by_a_process_that_is_forked() -> None:
    here, there = os.pipe()
    raw = kept_open(there, 0.0)
    taken = filled(there)
    raw.write(b"once\n")
    read_all(here, taken)
    pid = os.fork()
    if pid == 0:
        raw.send_waiting()
        os._exit(0)
    assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 0
    raw.send_waiting()
    os.close(there)
    assert os.read(here, 100) == b"once\n"
    raw.close()
    os.close(here)


HOLDS = re.compile(r"\b(connect|Started|DeviceClaim|RemoteStation|serve_until_signal)\(|\.lease\(|asyncio\.run\(")
LIMITS = re.compile(r"\b(limit_waits|without_waiting|step_back|leased)\(")
UNLIMITED = {"fleet_authority.py", "listing.py", "record_beside.py"}
"""Commands that hold nothing of the kind for longer than they take."""


def test_a_command_that_holds_a_machine_or_serves_others_limits_its_waits_for_a_reader() -> None:
    files = [file for file in Path(umo_command.__file__).parent.rglob("*.py") if "template" not in file.parts]
    found = [file for file in files if HOLDS.search(file.read_text("utf-8"))]
    assert len(found) > 8
    assert {file.name for file in found if not LIMITS.search(file.read_text("utf-8"))} - UNLIMITED == set()


def test_a_line_of_the_log_is_dropped_and_counted_where_a_handler_would_wait() -> None:
    here, there = os.pipe()
    log = logging.getLogger("umo.test_full")
    log.propagate = False
    with os.fdopen(there, "w") as stream:
        log.addHandler(logging.StreamHandler(stream))
        taken = filled(there)
        for number in range(4):
            streams.log_without_waiting(log, f"line {number}")
        read_all(here, taken)
        streams.log_without_waiting(log, "the next " + "x" * 10_000)
        lines = os.read(here, 10_000).decode().splitlines()
    os.close(here)
    assert lines[0] == "4 lines were lost: their reader did not accept them in time"
    assert (lines[1][:10], lines[1][-3:], len(lines[1])) == ("the next x", "...", streams.MAX_LINE + 3)


RUN = """
import json, os, sys, umo
from umo import Interlock
from umo.control import next_period

class Valves(umo.Compound):
    timer: umo.DigitalSensor
    valves: list[umo.DigitalActuator]
    stopped = False
    def interlocks(self):
        yield Interlock(lambda: self.stopped, list(self.valves), "emergency stop")

def machine():
    valve = lambda: umo.DigitalActuator("V", default=0.0, minimum=0.0, maximum=10.0, resolution=0.01)
    timer = umo.DigitalSensor("sampling_period", minimum=0, maximum=99999, resolution=1, synchronous=False)
    return Valves(timer=timer, valves=[valve() for _ in range(200)])

async def flap(m):
    away = 0
    for _ in range(20):
        for each in m.valves:
            each.write(5.0)
        print("x" * 2000, file=sys.stderr, flush=True)
        m.stopped = True
        await next_period()
        away += sum(each.read() != 0.0 for each in m.valves)
        m.stopped = False
        await next_period()
    return away
"""

IN_ONE_PROCESS = (
    RUN
    + """
machine = machine()
wiring = {"wire": {"timer": {"driver": "simulated", "period": "1 ms"}, "valves.*": {"driver": "simulated"}}}
async def quiet(m):
    away = 0
    for _ in range(20):
        m.stopped = True
        await next_period()
        m.stopped = False
        await next_period()
    return sum(each.read() != 0.0 for each in m.valves)
print(json.dumps({"away": umo.run(machine, wiring, quiet)}), flush=True)
"""
)


def station(folder: Path) -> Path:
    """The valves under one interlock, which comes and goes."""
    place = folder / "valves"
    (place / "wiring").mkdir(parents=True)
    (place / "objects.py").write_text(RUN)
    (place / "application.py").write_text("from .objects import flap as main\n")
    (place / "__init__.py").write_text("")
    (place / "wiring" / "simulated.toml").write_text(
        '[wire]\n"timer" = { driver = "timerfd", period = "20 ms" }\n"valves.*" = { driver = "simulated" }\n'
    )
    return place


STARTED = """
import json, sys, umo
with umo.start(sys.argv[1], "simulated") as run:
    outcome = run.wait(100)
print(json.dumps({"away": outcome.result, "status": outcome.status, "said": str(outcome.failure)}), flush=True)
"""


@contextmanager
def full_pipe() -> Iterator[int]:
    """The end of a pipe that nobody reads, and that takes nothing."""
    here, there = os.pipe()
    fcntl.fcntl(there, F_SETPIPE_SZ, 4096)
    filled(there)
    yield there
    for each in (here, there):
        os.close(each)


def result_with_full_stderr(code: str, *arguments: str) -> dict[str, object]:
    """What a program prints whose stderr is full all the while."""
    command = [sys.executable, "-c", code, *arguments]
    with full_pipe() as full, subprocess.Popen(command, stdout=subprocess.PIPE, stderr=full, text=True) as process:
        try:
            told, _ = process.communicate(timeout=120)
        finally:
            process.kill()
    found: dict[str, object] = json.loads(told.splitlines()[-1])
    return found


@pytest.mark.slow
def test_what_umo_logs_in_one_process_waits_for_nobody() -> None:
    assert result_with_full_stderr(IN_ONE_PROCESS) == {"away": 0}


@pytest.mark.slow
def test_a_run_in_real_time_goes_on_and_resets_with_stderr_full(tmp_path: Path) -> None:
    found = result_with_full_stderr(STARTED, str(station(tmp_path)))
    assert found == {"away": 0, "status": 0, "said": "None"}


COMMAND = """
from umo_command import main
from umo.system import streams
streams.READER_TIMEOUT = 0.2
main()
"""
APPLICATION = """
import os, signal
from umo.control import next_period

async def main(m):
    for number in range(500):
        m.cycle.progress(f"valve {number}")
        await next_period()
    os.kill(os.getpid(), signal.SIGTERM)
    await next_period()
"""


@pytest.mark.slow
@pytest.mark.full
@pytest.mark.parametrize("timer", ["simulated", "timerfd"])
def test_a_command_whose_reader_is_stopped_ends_with_the_status_of_its_run(tmp_path: Path, timer: str) -> None:
    place = station(tmp_path)
    (place / "application.py").write_text(APPLICATION)
    wiring = place / "wiring" / "simulated.toml"
    wiring.write_text(wiring.read_text().replace("timerfd", timer).replace("20 ms", "1 ms"))
    command = [sys.executable, "-c", COMMAND, "run", "valves", "--no-plot"]
    with full_pipe() as full, subprocess.Popen(command, stdout=full, stderr=full, cwd=tmp_path) as process:
        try:
            assert process.wait(60) == 128 + signal.SIGTERM
        finally:
            process.kill()
