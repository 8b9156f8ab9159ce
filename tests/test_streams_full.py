"""Nothing that is logged or printed holds a loop up: a full pipe, a stopped terminal (decision 0060)."""

from __future__ import annotations

import fcntl
import json
import logging
import os
import pty
import socket
import subprocess
import sys
import termios
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from umo.system import streams

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="descriptors as Linux has them")
F_SETPIPE_SZ = 1031


def filled(write_end: int) -> int:
    """Fill what leads to a reader that does not read; the number of bytes. It blocks from now on."""
    os.set_blocking(write_end, False)
    count = 0
    with suppress(BlockingIOError):
        while True:
            count += os.write(write_end, bytes(512))
    with suppress(BlockingIOError):
        while True:
            count += os.write(write_end, b"\0")
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


def read_all(end: int, count: int) -> bytes:
    """So many bytes, which are there or come at once."""
    data = b""
    while len(data) < count:
        data += os.read(end, count - len(data))
    return data


def test_what_is_not_taken_at_once_waits_and_is_sent_in_order(ends: tuple[int, int]) -> None:
    here, there = ends
    raw = streams._Unwaiting(there)
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
    raw = streams._Unwaiting(there)
    taken = filled(there)
    for number in range(5):
        raw.write(f"line {number}\n".encode())
    assert raw.lost == 3
    read_all(here, taken)
    raw.write(b"the next\n")
    told = b"\numo: 3 lines were lost: what reads them did not take them in time\n"
    expected = b"line 0\nline 1\n" + told + b"the next\n"
    assert read_all(here, len(expected)) == expected
    assert raw.lost == 0


def test_a_stream_that_nobody_reads_any_more_takes_everything() -> None:
    here, there = os.pipe()
    raw = streams._Unwaiting(there)
    os.close(here)
    assert raw.write(b"lost\n") == 5
    assert raw.write(b"lost\n") == 5
    os.close(there)


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
    assert lines[0] == "4 lines were lost: what reads them did not take them in time"
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
    return Valves(timer=timer, valves=[valve() for _ in range(1000)])

async def flap(m):
    away = 0
    for _ in range(60):
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
    for _ in range(60):
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


def result_with_full_stderr(code: str, *arguments: str) -> dict[str, object]:
    """What a program prints whose stderr is full all the while."""
    here, there = os.pipe()
    fcntl.fcntl(there, F_SETPIPE_SZ, 4096)
    filled(there)
    command = [sys.executable, "-c", code, *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=there, text=True) as process:
        os.close(there)
        try:
            told, _ = process.communicate(timeout=120)
        finally:
            process.kill()
            os.close(here)
    found: dict[str, object] = json.loads(told.splitlines()[-1])
    return found


@pytest.mark.slow
def test_what_umo_logs_in_one_process_waits_for_nobody() -> None:
    assert result_with_full_stderr(IN_ONE_PROCESS) == {"away": 0}


@pytest.mark.slow
def test_a_run_in_real_time_goes_on_and_resets_with_stderr_full(tmp_path: Path) -> None:
    found = result_with_full_stderr(STARTED, str(station(tmp_path)))
    assert found == {"away": 0, "status": 0, "said": "None"}
