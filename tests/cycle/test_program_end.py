"""The end of a program, and a signal, while a machine is connected in another thread than the main one."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from helpers.machines import Bench, Board, bench, on, wired
from helpers.waiting import until
from umo import connect, run
from umo.cycle import program_end
from umo.cycle.program_end import end_machines
from umo.cycle.stopping import connected, request_stop
from umo.errors import DeclarationError
from umo.states import OnOff
from umo.testing import Scripted

LONG = 30.0
"""Seconds after which a thread is given up."""


class Driven(Bench):
    """Its valve is on. Its control code does what the test wants."""

    def setup(self) -> None:
        self.act: Callable[[], object] = lambda: None

    def control(self) -> None:
        self.valve.write(OnOff.ON)
        self.act()


@contextmanager
def in_a_thread(machine: Any, box: Scripted) -> Iterator[list[BaseException]]:
    """The machine runs in a daemon thread, and its valve is on. The errors of the run."""
    errors: list[BaseException] = []

    def work() -> None:
        try:
            run(machine, wired(machine, box))
        except BaseException as error:
            errors.append(error)

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    until(lambda: box.get("valve") == 1)
    yield errors
    thread.join(LONG)
    assert not thread.is_alive()


def test_a_machine_in_a_thread_leaves_before_the_program_ends() -> None:
    machine, box = bench(Driven), Scripted()
    with in_a_thread(machine, box) as errors:
        end_machines()
        assert box.get("valve") == 0
        assert connected() == ()
    assert errors == []


def test_a_run_in_a_thread_that_a_signal_ends_returns_none() -> None:
    machine, box = bench(Driven), Scripted()
    with in_a_thread(machine, box) as errors:
        request_stop(signal.SIGTERM)
    assert errors == []
    assert box.get("valve") == 0


def test_one_that_does_not_leave_in_time_is_reset_by_the_main_thread(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(program_end, "STOPPING_TIMEOUT", -10.0)
    machine, box, stuck, release = bench(Driven), Scripted(), threading.Event(), threading.Event()

    def wait() -> None:
        stuck.set()
        assert release.wait(LONG)
        machine.valve.write(OnOff.ON)

    machine.act = wait
    with _stuck(machine, box, stuck, release):
        end_machines()
        assert box.get("valve") == 0
        release.set()
    assert box.get("valve") == 0
    told = capfd.readouterr().err
    assert told.startswith("umo: the program has ended while Driven was connected; every actuator is at its default")


@contextmanager
def _stuck(machine: Any, box: Scripted, stuck: threading.Event, release: threading.Event) -> Iterator[None]:
    """It is in its control code, its valve is on."""
    act, machine.act = machine.act, lambda: None
    with in_a_thread(machine, box):  # what is raised in it afterwards is of no interest
        machine.act = act
        assert stuck.wait(LONG)
        yield
        assert release.is_set()


def test_one_that_the_main_thread_has_left_connected_is_reset() -> None:
    machine, box = bench(Driven), Scripted()
    left = connect(machine, wired(machine, box))
    m = left.__enter__()
    m.valve.write(OnOff.ON)
    m.update()
    assert box.get("valve") == 1
    end_machines()
    assert box.get("valve") == 0
    left.__exit__(None, None, None)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="a process is forked")
def test_a_process_that_was_forked_leaves_the_machine_alone_at_its_end() -> None:
    machine, box = bench(), Scripted()
    with connect(machine, wired(machine, box)):
        pid = os.fork()
        if pid == 0:
            end_machines()
            os._exit(len(box.segments("reset")))
        assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 0


@pytest.mark.parametrize("drives", [True, False])
def test_a_process_that_control_code_forked_drives_no_device_of_a_machine_without_a_guardian(
    drives: bool, capfd: pytest.CaptureFixture[str]
) -> None:
    machine, board = bench(), Board("a board of its own")
    with connect(machine, on(board, machine)):
        calls = len(board.calls)
        pid = os.fork()
        if pid == 0:
            try:
                if drives:
                    machine.valve.write(OnOff.ON)
                    machine.update()
            finally:
                os._exit(3 if len(board.calls) == calls else 4)
        assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == (1 if drives else 3)
        machine.update()
        assert len(board.calls) > calls
    told = f"control code forked process {pid}, which was ended because it tried to drive the machine too"
    assert (told in capfd.readouterr().err) is drives


def in_thread(call: Callable[[], object]) -> BaseException | None:
    """What it raises in another thread."""
    errors: list[BaseException] = []

    def work() -> None:
        try:
            call()
        except BaseException as error:
            errors.append(error)

    thread = threading.Thread(target=work, name="loop")
    thread.start()
    thread.join(LONG)
    return errors[0] if errors else None


def test_a_machine_with_devices_is_refused_in_a_thread_while_a_signal_would_kill_the_program() -> None:
    machine, board = bench(), Board("a board of its own")

    def use() -> None:
        with connect(machine, on(board, machine)):
            pass

    before = [signal.signal(number, signal.SIG_DFL) for number in (signal.SIGTERM, signal.SIGHUP)]
    try:
        error = in_thread(use)
        assert isinstance(error, DeclarationError)
        assert str(error).startswith(
            "in thread 'loop': SIGTERM and SIGHUP would end this program and leave the outputs"
        )
        assert board.calls == []
        simulated = bench()
        assert in_thread(lambda: connect(simulated, wired(simulated, Scripted())).__enter__()) is None
        end_machines()
        with connect(bench(), None):  # the handlers of a machine in the main thread are there as long as that is
            assert isinstance(in_thread(use), DeclarationError)
        for number in (signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, signal.default_int_handler)
        assert in_thread(use) is None
    finally:
        for number, handler in zip((signal.SIGTERM, signal.SIGHUP), before, strict=True):
            signal.signal(number, handler)


PROGRAM = """
import os, signal, sys, threading
sys.path[:0] = [{tests!r}, {here!r}]
from umo import run
from umo.states import OnOff
from umo.testing import Scripted
from helpers.machines import bench, wired
from test_program_end import Driven

class Box(Scripted):
    def _call(self, name, channels=(), raws=()):
        found = super()._call(name, channels, raws)
        if (level := self.get("valve")) != self.level:
            self.level = level
            os.write(1, str(level).encode())
            if level:
                on.set()
        return found
    level = 0

on = threading.Event()
machine, box = bench(Driven), Box()
for number in (signal.SIGTERM, signal.SIGINT):
    signal.signal(number, signal.default_int_handler)
thread = threading.Thread(target=lambda: run(machine, wired(machine, box)), daemon={daemon})
thread.start()
on.wait()
{end}
"""
ENDS = {
    "its last line": ("", 0),
    "an exception": ("raise ValueError", 1),
    "sys.exit": ("sys.exit(5)", 5),
    "SIGTERM": ("os.kill(os.getpid(), signal.SIGTERM); thread.join()", -signal.SIGINT),
    "Ctrl-C": ("os.kill(os.getpid(), signal.SIGINT); thread.join()", -signal.SIGINT),
}


@pytest.mark.slow
@pytest.mark.full
@pytest.mark.parametrize("how", ENDS)
def test_the_outputs_of_a_daemon_thread_are_at_their_defaults_however_the_program_ends(how: str) -> None:
    end, status = ENDS[how]
    code = PROGRAM.format(tests=str(Path(__file__).parents[1]), here=str(Path(__file__).parent), daemon=True, end=end)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert (done.stdout, done.returncode) == ("10", status), done.stderr


@pytest.mark.slow
@pytest.mark.full
def test_a_thread_that_is_no_daemon_goes_on_after_the_program_until_a_signal() -> None:
    end = "threading.Timer(0.3, lambda: os.kill(os.getpid(), signal.SIGTERM)).start()"
    code = PROGRAM.format(tests=str(Path(__file__).parents[1]), here=str(Path(__file__).parent), daemon=False, end=end)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.stdout == "10", done.stderr
