"""No process is signalled or waited for by a bare number: another one may have got it."""

from __future__ import annotations

import ast
import os
import signal
import subprocess
import sys
from collections.abc import Iterator

import pytest

from helpers.own_modules import own_modules
from helpers.waiting import until
from umo.process.run_state import RunState, Who
from umo.system import processes
from umo.system.processes import Child, ProcessHandle, identity, is_used, known, parent_of_this

pytestmark = pytest.mark.skipif(not hasattr(os, "pidfd_open"), reason="descriptors of processes need Linux")
SEAM = "system/calls.py"
BY_NUMBER = {"kill", "killpg", "waitpid", "wait", "wait3", "wait4", "waitid", "pidfd_open", "pidfd_send_signal"}
CALLS_BY_NUMBER = {"kill", "wait", "open_process", "signal_process"}
SLEEP = [sys.executable, "-c", "input()"]


NAMED = [f"{of}.{name}" for of in ("os", "signal") for name in BY_NUMBER]
NAMED += [f"calls.{name}" for name in CALLS_BY_NUMBER]


def test_only_one_module_signals_or_waits_by_number() -> None:
    used = {
        place
        for place, file in own_modules().items()
        if place != SEAM and any(each in (text := file.read_text("utf-8")) for each in NAMED)
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name)
        if (node.value.id in ("os", "signal") and node.attr in BY_NUMBER)
        or (node.value.id == "calls" and node.attr in CALLS_BY_NUMBER)
    }
    assert used == {"system/processes.py"}, "use umo.system.processes"


@pytest.fixture(params=["descriptor", "number"])
def kind(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Also where the kernel gives no descriptors of processes."""
    if request.param == "number":

        def refused(pid: int) -> int:
            raise PermissionError(1, "Operation not permitted")

        monkeypatch.setattr(os, "pidfd_open", refused)
    return str(request.param)


@pytest.fixture
def other() -> Iterator[subprocess.Popen[bytes]]:
    process = subprocess.Popen(SLEEP, stdin=subprocess.PIPE)
    yield process
    process.kill()
    process.communicate()


def forked() -> int:
    """A child that waits for signals."""
    pid = os.fork()
    while pid == 0:
        signal.pause()
    return pid


@pytest.mark.usefixtures("kind")
def test_a_child_is_waited_for_once_and_tells_how_it_ended() -> None:
    child = Child(forked())
    assert not child.ended
    child.send(signal.SIGSTOP)
    until(lambda: not child.ended and child.was_stopped)
    assert child.is_stopped
    assert child.end(20.0)
    assert child.status is not None
    assert os.WTERMSIG(child.status) == signal.SIGKILL
    with pytest.raises(ChildProcessError):
        os.waitpid(child.pid, os.WNOHANG)
    assert child.state == "X"


@pytest.mark.usefixtures("kind")
def test_a_number_that_another_process_has_got_reaches_nobody(
    other: subprocess.Popen[bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The pid of a handle's process is that of a foreign one when the signal is sent."""
    child, handle = Child(forked()), ProcessHandle(other.pid)
    by_number = handle._file < 0
    assert child.end(20.0)
    child.pid = other.pid  # as when the kernel counts round
    child.send(signal.SIGKILL)
    assert child.end(20.0)
    if by_number:
        handle._started += "0"
        handle.send(signal.SIGKILL)
        assert handle.ended
    assert other.poll() is None
    assert is_used(other.pid)


def test_a_process_that_inherits_a_child_waits_for_none_and_sees_its_end() -> None:
    child = Child(forked())
    child._maker = 0  # as in a process that was forked afterwards
    assert not child.is_own
    assert not child.ended
    assert child.end(20.0)
    assert child.status is None
    assert os.WTERMSIG(os.waitpid(child.pid, 0)[1]) == signal.SIGKILL


def test_a_process_is_known_by_its_identity_only(other: subprocess.Popen[bytes]) -> None:
    mine = identity(other.pid)
    found = known(other.pid, mine)
    assert found is not None
    assert not found.ended
    assert known(other.pid, f"{mine}0") is None
    assert known(other.pid, "") is None
    assert known(os.getpid(), mine) is None


def test_only_a_living_parent_is_one() -> None:
    assert parent_of_this(os.getppid()) is not None
    assert parent_of_this(os.getpid()) is None


# Processes of a run, by their locks -------------------------------------------------------------------------


def holding(state: RunState, who: Who) -> int:
    pid = state.fork(who)
    while pid == 0:
        signal.pause()
    return pid


def test_the_holder_of_a_lock_is_that_process_or_none() -> None:
    state = RunState()
    assert state.process(Who.KEEPER) is None
    child = Child(holding(state, Who.KEEPER))
    found = state.process(Who.KEEPER)
    assert found is not None
    assert found.pid == child.pid
    assert state.end(Who.KEEPER, 20.0)
    until(lambda: child.ended)
    assert state.process(Who.KEEPER) is None


def test_a_number_that_a_dead_holder_has_left_is_not_used(other: subprocess.Popen[bytes]) -> None:
    """The number of a keeper that has died belongs to a foreign process by now."""
    state = RunState()
    child = Child(holding(state, Who.KEEPER))
    assert child.end(20.0)
    state._pids[Who.KEEPER] = other.pid
    assert state.process(Who.KEEPER) is None
    assert state.end(Who.KEEPER, 1.0)
    assert other.poll() is None


def test_a_number_of_a_dead_holder_is_not_that_of_one_who_has_just_taken_the_lock(
    other: subprocess.Popen[bytes],
) -> None:
    """Between the lock and the number."""
    state = RunState()
    child = Child(holding(state, Who.KEEPER))
    assert child.end(20.0)
    assert state._take(Who.KEEPER, 1.0)  # as in `hold`, of which no more has happened yet
    state._pids[Who.KEEPER] = other.pid  # the number of the dead one is a foreign process's by now
    assert state.process(Who.KEEPER) is None
    assert not state.is_able(Who.KEEPER)
    assert not state.end(Who.KEEPER, 0.01)
    assert other.poll() is None
    state.release(Who.KEEPER)  # its memory ends with this test


def test_who_does_not_get_a_lock_is_not_taken_for_its_holder() -> None:
    state = RunState()
    child = Child(holding(state, Who.STANDBY))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("umo.process.run_state.HOLD_LIMIT", 0.01)
        assert not state.hold(Who.STANDBY)
    assert not state.holds(Who.STANDBY)
    found = state.process(Who.STANDBY)
    assert found is not None and found.pid == child.pid
    assert child.end(20.0)
    assert state.hold(Who.STANDBY)
    assert state.holds(Who.STANDBY)
    state.release(Who.STANDBY)  # its memory ends with this test
    assert not state.holds(Who.STANDBY)
    assert state.gone(0.0, Who.STANDBY)


def test_a_state_that_cannot_be_read_is_no_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where a process has no descriptors left."""
    monkeypatch.setattr(os, "pidfd_open", lambda pid: (_ for _ in ()).throw(OSError(24, "Too many open files")))
    child = forked()
    handle = ProcessHandle(child)
    monkeypatch.setattr(processes, "_stat", lambda pid: [])
    assert not handle.ended
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    assert handle.ended


def test_a_process_that_was_killed_is_known_before_it_has_ended() -> None:
    """Also before it has got a processor to end."""
    with subprocess.Popen(SLEEP, stdin=subprocess.PIPE) as sleeping:
        handle = ProcessHandle(sleeping.pid)
        assert not handle.is_killed
        sleeping.kill()
        assert handle.is_killed


@pytest.mark.parametrize(
    ("line", "killed"),
    [
        ("SigPnd:\t0000000000000100", True),
        ("ShdPnd:\t0000000000000300", True),
        ("SigPnd:\t0000000000000000", False),
        ("SigPnd:\t0000000000004200", False),
        ("SigBlk:\t0000000000000100", False),
    ],
)
def test_sigkill_is_the_ninth_of_the_signals_that_are_pending(line: str, killed: bool) -> None:
    text = f"Name:\tumo\n{line}\nSigCgt:\t0000000000000100\n"
    assert (processes.SIGKILL_PENDING.search(text) is not None) is killed
