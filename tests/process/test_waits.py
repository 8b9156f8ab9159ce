"""Every wait for another process has a limit: here that one is stopped, or says nothing (docs/waits.md)."""

from __future__ import annotations

import ast
import fcntl
import os
import re
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import pytest

from helpers import process_box
from helpers.begun_programs import programs_begun
from helpers.own_modules import texts
from helpers.process_box import Cells
from helpers.runs import Run, assert_safe
from helpers.waiting import until
from tools import compiled_machine
from umo import Compound
from umo.commissioning.latency import loop, native
from umo.errors import DeclarationError, DriverError, OptionError
from umo.generate import law_library
from umo.operation.alarms import alarm_file
from umo.process import control_process, keeper, kept_file, run_state
from umo.process.control_process import Control
from umo.process.job import Job
from umo.process.run_state import RunState, Who
from umo.process.start import RunFailed, Started
from umo.recording.replay import closed_loop, snapshots
from umo.system import calls, processes
from umo.text import UMO
from umo_command.run import faces_beside, record_beside

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="processes of their own need Linux")


@pytest.fixture
def cells(tmp_path: Path) -> Cells:
    return Cells(tmp_path / "box")


# A process that is forked and does not come to hold its lock ------------------------------------------------


def stop_myself() -> None:
    os.kill(os.getpid(), signal.SIGSTOP)


def work_for_ever() -> None:
    while True:
        pass


@pytest.mark.parametrize(
    ("does", "why"),
    [
        (stop_myself, "a process that was forked was stopped by a signal before it had begun"),
        (signal.pause, "a process that was forked did not begin within 0.1 s"),
        (work_for_ever, "a process that was forked did not begin within 0.1 s"),
    ],
)
def test_a_process_that_does_not_begin_is_ended(monkeypatch: pytest.MonkeyPatch, does: object, why: str) -> None:
    monkeypatch.setattr(run_state, "FORK_TIMEOUT", 0.1 if does is not stop_myself else 60.0)
    monkeypatch.setattr(RunState, "hold", lambda state, who: does())  # type: ignore[operator]
    forked: list[int] = []
    fork = os.fork
    monkeypatch.setattr(os, "fork", lambda: forked.append(fork()) or forked[-1])
    with pytest.raises(OSError, match=why):
        RunState().fork(Who.STANDBY)
    assert processes.state(forked[0]) == "X"  # ended, and waited for


def test_a_process_that_goes_on_in_time_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """A debugger, or the test of a supervisor, stops processes for a moment."""
    monkeypatch.setattr(run_state, "STOPPED_TIMEOUT", 30.0)
    monkeypatch.setattr(RunState, "hold", lambda state, who: stop_myself())
    forked: list[int] = []
    fork = os.fork
    monkeypatch.setattr(os, "fork", lambda: forked.append(fork()) or forked[-1])

    def let_go_on() -> None:
        until(lambda: forked and processes.ProcessHandle(forked[0]).is_stopped)
        os.kill(forked[0], signal.SIGCONT)

    helper = threading.Thread(target=let_go_on)
    helper.start()
    pid = RunState().fork(Who.STANDBY)
    if pid == 0:
        os._exit(0)
    helper.join(30.0)
    assert os.waitpid(pid, 0)[1] == 0


def test_a_process_that_has_to_wait_for_a_processor_is_not_taken_for_a_stopped_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(run_state, "STOPPED_TIMEOUT", 1e-6)
    end, begin = os.pipe()
    monkeypatch.setattr(RunState, "hold", lambda state, who: os.read(end, 1))
    looks: list[float] = []

    def watch(state: RunState) -> None:
        looks.append(1.0)
        if len(looks) == 3:
            os.write(begin, b"!")

    monkeypatch.setattr(RunState, "watch", watch)
    pid = RunState().fork(Who.STANDBY)
    if pid == 0:
        os._exit(0)
    assert os.waitpid(pid, 0)[1] == 0
    assert len(looks) >= 3  # the guardian has sent heartbeats meanwhile


def test_nobody_waits_for_a_process_to_begin_when_the_control_process_has_died(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run_state, "FORK_TIMEOUT", 60.0)
    state = RunState()
    control = state.fork(Who.CONTROL)
    if control == 0:
        signal.pause()
    state.admit()
    os.kill(control, signal.SIGKILL)
    os.waitpid(control, 0)
    monkeypatch.setattr(RunState, "hold", lambda state, who: signal.pause())
    with pytest.raises(OSError, match="the machine must be reset"):
        state.fork(Who.STANDBY)


def test_a_keeper_that_is_stopped_as_it_begins_is_told_and_tried_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(RunState, "hold", lambda state, who: stop_myself())
    said: list[str] = []
    monkeypatch.setattr(keeper, "sections_of", lambda layout: ["something"])
    keeper.Keeper(tmp_path / "kept.json", Mock(), RunState(), said.append).look(Mock())
    why = "a process that was forked was stopped by a signal before it had begun"
    assert said == [f"nothing is kept: {why}; umo tries again"]


def stop_those_that_begin(monkeypatch: pytest.MonkeyPatch, who: Who, when: Path) -> None:
    """While the file is there, a process of this kind is stopped before it holds its lock."""
    hold = RunState.hold

    def stopped(state: RunState, number: int) -> None:
        if number == who and when.exists():
            stop_myself()
        hold(state, number)

    monkeypatch.setattr(RunState, "hold", stopped)


@pytest.mark.full
@pytest.mark.parametrize("who", [Who.CONTROL, Who.STANDBY])
def test_a_run_whose_process_is_stopped_as_it_begins_comes_to_an_end(
    tmp_path: Path, cells: Cells, monkeypatch: pytest.MonkeyPatch, who: Who
) -> None:
    stop_those_that_begin(monkeypatch, who, tmp_path)
    run = Run(process_box.wiring(tmp_path / "box"))
    outcome = run.outcome()
    if who is Who.CONTROL:
        assert outcome.failure is not None
        assert outcome.failure.message == "a process that was forked was stopped by a signal before it had begun"
    else:
        assert outcome.status == 0
        assert [each for each in run.notices if each.startswith("no standby guardian: a process that was forked was")]
    assert_safe(cells)


def test_a_standby_guardian_stopped_as_it_begins_does_not_keep_the_guardian_from_resetting(
    tmp_path: Path, cells: Cells, monkeypatch: pytest.MonkeyPatch
) -> None:
    when = tmp_path / "now"
    stop_those_that_begin(monkeypatch, Who.STANDBY, when)
    run = Run(process_box.wiring(tmp_path / "box"), "forever").until_running()
    when.touch()
    os.kill(run.standby, signal.SIGKILL)
    assert run.message("notice")["text"].startswith("the standby guardian was killed or stopped")
    assert run.message("notice")["text"].startswith("no standby guardian: a process that was forked was stopped")
    os.kill(run.control, signal.SIGKILL)
    outcome = run.outcome()
    assert (outcome.status, outcome.unreached) == (1, [])
    assert_safe(cells)


# The starter and its guardian ---------------------------------------------------------------------------------


start = sys.modules[Started.__module__]


def stopped_program() -> processes.Child:
    process = processes.Child(calls.start_program(["sh", "-c", "kill -STOP $$"], [], os.environ))
    until(lambda: process.is_stopped)
    return process


def test_a_guardian_that_is_stopped_when_it_has_told_the_outcome_is_killed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(start, "GUARDIAN_END_TIMEOUT", 0.2)
    starter = Started.__new__(Started)
    starter._guardian = stopped_program()
    assert starter._end_of_guardian() == -signal.SIGKILL
    until(lambda: starter._guardian.ended)  # on a busy computer a killed process needs longer than the limit
    assert starter._guardian.status == signal.SIGKILL


ENDLESS = """
def machine():
    import pathlib
    pathlib.Path({ready!r}).touch()
    while True:
        try:
            sum(range(999))
        except {kind}:
            pass
"""


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["ValueError", "BaseException"])
def test_a_guardian_in_a_stations_own_code_is_ended_by_a_stop(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    """A station may never come to declare its machine, and may pass over what ends it."""
    monkeypatch.setattr(start, "START_STOP_TIMEOUT", 0.2 if kind == "BaseException" else 60.0)
    ready = tmp_path / "ready"
    (tmp_path / "endless.py").write_text(ENDLESS.format(ready=str(ready), kind=kind))
    machine = Started(Job(machine="endless:machine", application="endless:machine", path=[str(tmp_path), *sys.path]))
    until(ready.exists)
    outcome = machine.stop()
    with suppress(RunFailed), machine:  # closes what is left
        pass
    if kind == "ValueError":
        assert outcome.status == 128 + signal.SIGTERM
        (notice,) = machine.notices
        assert notice.startswith("stopped before the machine was started (")
        assert re.search(r"endless.py:\d+ in machine\)$", notice)
    else:
        assert outcome.failure is not None
        assert "before the machine was started" in outcome.failure.message


def test_a_guardian_that_is_stopped_before_it_admits_the_control_process_is_not_waited_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(control_process, "ADMISSION_TIMEOUT", 0.05)
    state, unlimited = RunState(), SimpleNamespace(process=SimpleNamespace(hang_timeout=60.0), watchdogs={})
    plan: Any = SimpleNamespace(machine=Compound(), wired=unlimited)
    control = Control(plan, Mock(), state, Mock(), 0, None)
    guardian = os.fork()
    if guardian == 0:
        state.hold(Who.GUARDIAN)
        stop_myself()
        os._exit(0)
    until(lambda: processes.ProcessHandle(guardian).is_stopped)
    pid = os.fork()
    if pid == 0:
        control.wait_for_admission()
        os._exit(0)
    assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 1
    assert processes.Child(guardian).end(10.0)


# Files, compilers, measuring, replaying -----------------------------------------------------------------------


@contextmanager
def held_by_a_stopped_process(file: Path) -> Iterator[None]:
    """A process has locked the file, and was stopped."""
    pid = os.fork()
    if pid == 0:
        with file.open("a") as held:
            fcntl.flock(held, fcntl.LOCK_EX)
            stop_myself()
        os._exit(0)
    until(lambda: processes.ProcessHandle(pid).is_stopped)
    yield
    assert processes.Child(pid).end(10.0)


def test_the_history_of_alarms_waits_for_no_writer_that_is_stopped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(alarm_file, "LOCK_TIMEOUT", 0.02)
    file, record = tmp_path / "alarms.jsonl", alarm_file.AlarmRecord(1.0, 1.0, "worn", "returned", "")
    with held_by_a_stopped_process(file), pytest.raises(OSError, match="other users can write to it"):
        alarm_file.append(file, [record])
    alarm_file.append(file, [record])
    assert alarm_file.read(file) == [record]


def test_kept_values_wait_for_no_keeper_that_is_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("UMO_STATE", str(tmp_path))
    path = kept_file.path_of("press", "simulated")
    os.close(kept_file.lock_file(path))
    with held_by_a_stopped_process(kept_file.lock_of(path)), kept_file.locked(path, 0.02) as mine:
        assert not mine
    with kept_file.locked(path, 0.02) as mine:
        assert mine


def test_a_query_waits_for_no_recorder_that_is_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    query = pytest.importorskip("umo.clients.fleet.fleet_query")
    monkeypatch.setattr(query, "MERGING_TIMEOUT", 0.02)
    (tmp_path / "values").mkdir()
    with held_by_a_stopped_process(tmp_path / query.MERGING), pytest.raises(OptionError, match="it may be stopped"):
        query.asked(tmp_path, "SELECT 1").__enter__()


def test_a_compiler_that_is_stopped_is_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cc = tmp_path / "cc"
    cc.write_text("#!/bin/sh\nkill -STOP $$\n")
    cc.chmod(0o755)
    for module in (compiled_machine, law_library, native):
        monkeypatch.setattr(module, "COMPILE_TIMEOUT", 0.1)
    monkeypatch.setattr(compiled_machine, "compiler", lambda: str(cc))
    monkeypatch.setattr(native, "compiler", lambda: str(cc))
    monkeypatch.setattr(law_library, "compiler", lambda: str(cc))
    with pytest.raises(DeclarationError, match="timed out"):
        compiled_machine.compiled(tmp_path)
    with pytest.raises(DeclarationError, match="timed out"):
        law_library.library_of("")
    with native.compiled() as program:
        assert program is None


@pytest.mark.slow
def test_a_measuring_process_that_is_stopped_ends_the_measurement(monkeypatch: pytest.MonkeyPatch) -> None:
    begun = programs_begun(monkeypatch)
    measuring = loop.Loop(0.001)
    monkeypatch.setattr(native, "SLICE_MARGIN", 0.1)
    begun[0].send_signal(signal.SIGSTOP)
    with closing(measuring), pytest.raises(DriverError, match="it may have been stopped"):
        measuring.run(20)
    assert begun[0].returncode is not None


def test_a_snapshot_that_is_stopped_as_it_begins_is_done_without(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(snapshots, "BEGIN_TIMEOUT", 0.05)
    mine, forked, fork = os.getpid(), list[int](), os.fork
    monkeypatch.setattr(snapshots.Link, "to", lambda address: Mock() if os.getpid() == mine else stop_myself())
    monkeypatch.setattr(os, "fork", lambda: forked.append(fork()) or forked[-1])
    runner = snapshots.Runner("nowhere")
    runner.snapshot(5, 0.005)
    assert runner.known == {}
    assert processes.state(forked[0]) == "X"


def test_a_trial_that_is_stopped_counts_as_one_without_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(closed_loop, "CHILD_TIMEOUT", 0.05)
    monkeypatch.setattr(closed_loop.Trial, "run", lambda trial: stop_myself())
    forked: list[int] = []
    fork = os.fork
    monkeypatch.setattr(os, "fork", lambda: forked.append(fork()) or forked[-1])
    assert closed_loop.Trial("press").ending() is None
    assert processes.state(forked[0]) == "X"


# Beside a run -------------------------------------------------------------------------------------------------


STOPPED = ("sh", "-c", "kill -STOP $$")


def test_faces_that_are_stopped_do_not_keep_a_run_from_ending(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(faces_beside, "END_TIMEOUT", 0.05)
    begun = programs_begun(monkeypatch)
    with faces_beside.FacesBeside("rig.toml", {"lamp": {}}, command=STOPPED) as beside:
        beside.look(1, [])
        until(lambda: processes.ProcessHandle(begun[0].pid).is_stopped)
    assert begun[0].returncode == -signal.SIGKILL


def test_a_recorder_that_is_stopped_keeps_a_run_neither_from_beginning_nor_from_ending(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(record_beside, "START_TIMEOUT", 0.05)
    monkeypatch.setattr(record_beside, "END_TIMEOUT", 0.05)
    begun = programs_begun(monkeypatch)
    with record_beside.RecordBeside(record_beside.RecordOrder(Path("x.mcap"), {}), STOPPED) as beside:
        until(lambda: processes.ProcessHandle(begun[0].pid).is_stopped)
    assert begun[0].returncode == -signal.SIGKILL
    assert not beside.complete
    assert "the recorder has ended (signal 9); the data that it had not written are lost" in capsys.readouterr().err


# What waits in src/umo ---------------------------------------------------------------------------------------

ASKED_FIRST = "a look has said that something is there, or the descriptor does not block"
TERMINAL = "waits for a person at a terminal"
OWN_THREAD = "a thread of this process, each of whose calls has a limit"
ENDS_WITH_PARENT = "waits for work; it is killed with its parent (PDEATHSIG)"
SESSION = "lasts as long as the user's own session, whose processes are one group: Ctrl-C reaches all"
ENDED = "it has ended: nothing is waited for"
ALLOWED = {
    "umo_command/device/conform.py: input": TERMINAL,
    "clients/faces/face_users.py: getpass.getpass": TERMINAL,
    "umo_command/run/process_beside.py: os.read": ASKED_FIRST,
    "umo_command/run/record_beside.py: self._channel.recv": "a timeout of the socket: START_TIMEOUT",
    "umo_command/show/values_live.py: os.read": ASKED_FIRST,
    "drivers/iio/scan.py: os.read": ASKED_FIRST,
    "drivers/streams/hosts.py: connection.connect": "a timeout of the socket",
    "drivers/streams/stream.py: os.read": ASKED_FIRST,
    "umo_command/connect/fleet.py: asyncio.Event().wait": "serves until a signal",
    "drivers/timerfd.py: self.ticker.wait": "waits for the kernel's timer; a stop lets it expire",
    "drivers/timerfd.py: read_timer": "waits for the kernel's timer; a stop lets it expire",
    "clients/faces/opcua/ua_commands.py: task.result": ENDED,
    "clients/fleet/fleet_diagnosis.py: greeted.recv": "a timeout of the socket: ALERT_TIME",
    "clients/fleet/jetstream_server.py: client.connect": "awaited for CONNECT_TIME",
    "clients/fleet/jetstream_source.py: self._thread.join": OWN_THREAD,
    "process/frames/frame_server.py: self._socket.accept": "does not block, or serves who comes until it is closed",
    "process/frames/frame_server.py: self._thread.join": OWN_THREAD,
    "process/frames/frame_server.py: here.connect": "a timeout of the socket, or it does not block",
    "process/frames/reader.py: os.read": ASKED_FIRST,
    "commissioning/latency/loop.py: self._here.recv": ASKED_FIRST,
    "commissioning/latency/loop.py: self._here.recv_bytes": ASKED_FIRST,
    "commissioning/latency/loop.py: there.recv": ENDS_WITH_PARENT,
    "process/reset.py: calls.read": ASKED_FIRST,
    "recording/recorder.py: writing.result": "a thread that writes to the disk: what is not written cannot be given up",
    "clients/remote/commander.py: self._thread.join": OWN_THREAD,
    "clients/remote/live_view.py: self._thread.join": OWN_THREAD,
    "recording/replay/closed_loop.py: os.read": ASKED_FIRST,
    "recording/replay/debugger_prompt.py: os.read": TERMINAL,
    "recording/replay/snapshots.py: connection.connect": SESSION,
    "recording/replay/snapshots.py: os.read": ASKED_FIRST,
    "recording/replay/snapshots.py: select.select": SESSION,
    "recording/replay/snapshots.py: self._connection.recv": SESSION,
    "recording/replay/snapshots.py: self._connection.sendall": SESSION,
    "recording/replay/snapshots.py: self._listener.accept": ASKED_FIRST,
    "system/calls.py: connection.recvmsg": "its callers look first, or the socket has a timeout",
    "testing/conformance/relay.py: os.read": ASKED_FIRST,
    "testing/conformance/relay.py: self._thread.join": OWN_THREAD,
    "testing/conformance/runner.py: outcome.result": ENDED,
    "testing/conformance/tcp_tap.py: self._listener.accept": ASKED_FIRST,
    "clients/faces/conformance/face_rules.py: checking.result": ENDED,
    "clients/faces/conformance/face_rules.py: looking.result": ENDED,
    "clients/faces/conformance/face_rules.py: serving.result": ENDED,
    "testing/replays.py: subprocess.run": SESSION,
}
"""What waits without a limit of its own in the call, by file and call, and why that is right."""
WITHOUT_ARGUMENTS = ("wait", "join", "acquire", "result", "accept", "select", "poll", "getresponse")
"""Calls that wait for ever without an argument, or with None: of a process, thread, lock, socket or selector."""
ALWAYS = ("recv", "recv_bytes", "recv_into", "recvfrom", "recvmsg", "recvmsg_into", "sendall", "sendmsg", "sendfile")
"""Calls of a socket or connection, which wait if it blocks and has no timeout."""
TIMED = ("communicate", "wait_for", "urlopen", "create_connection", "as_completed")
"""Calls whose arguments are other things than a limit: only `timeout=` is one."""
PROGRAMS = ("run", "call", "check_call", "check_output")
REAPS = ("waitpid", "wait", "wait3", "wait4", "waitid")
READS = ("os.read", "calls.read", "read_timer")
BARE = (*READS, "input", "signal.pause", "signal.sigwait", "signal.sigwaitinfo", "getpass.getpass")
OTHERS = ("flock", "lockf", "get", "read", "readline", "readlines", "connect")
PROCESSES = ("create_subprocess_exec", "create_subprocess_shell")
NAMES = {*WITHOUT_ARGUMENTS, *ALWAYS, *TIMED, *PROGRAMS, *REAPS, *OTHERS, *PROCESSES}
NAMES |= {each.rpartition(".")[2] for each in BARE}
OF_PROCESS = re.compile(r"(process|guardian|popen|child)$", re.I)
OF_PIPE = re.compile(r"(stdout|stderr)(\.buffer)?$")
OF_QUEUE = re.compile(r"queue$", re.I)
OF_SOCKET = re.compile(r"(sock|socket|here|connection|channel|greeted|client)$", re.I)


MAY_WAIT = re.compile(
    rf"\.(?:{'|'.join((*ALWAYS, *TIMED, *REAPS, 'connect'))})\(|\.std(?:out|err)\b"
    rf"|\.(?:{'|'.join(WITHOUT_ARGUMENTS)})\((?=\s*(?:\)|None\b|\w+=|\*\*))"
)
WAITING = (*READS, *PROCESSES, "input(", "signal.pause", "signal.sigwait", "getpass(", "subprocess.", "select.select(")
WAITING += ("flock(", "lockf(", "ueue.get(")
"""What a text has of a call that may wait: most modules have none of these and nothing of that, and are not parsed."""


def is_none(value: ast.expr) -> bool:
    return isinstance(value, ast.Constant) and value.value is None


def waits_for_ever(call: ast.Call) -> bool:
    """Whether a call may wait without a limit, as far as its text says."""
    name = call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")
    if name not in NAMES:  # quick: most
        return False
    function, words = ast.unparse(call.func), ast.unparse(call)
    of = function.rpartition(".")[0]
    if any(each.arg == "timeout" and not is_none(each.value) for each in call.keywords):
        return False
    if function in BARE:
        return True
    if name in REAPS and function == f"os.{name}":
        return "WNOHANG" not in words
    if name in ("flock", "lockf"):
        return "LOCK_NB" not in words and "LOCK_UN" not in words
    if function.startswith("subprocess."):
        return name in PROGRAMS
    if function == "select.select":
        return len(call.args) < 4 or is_none(call.args[3])
    if name in PROCESSES:
        return True
    if name in TIMED:
        return bool(of) and not (name in ("wait_for", "create_connection") and len(call.args) > 1)
    if name in ALWAYS:
        return bool(of) and not function.startswith("self.recv") and "MSG_DONTWAIT" not in words
    if name in ("read", "readline", "readlines"):
        return OF_PIPE.search(of) is not None
    if name == "get":
        return OF_QUEUE.search(of) is not None and (not call.args or is_none(call.args[-1]))
    if name == "connect":
        return OF_SOCKET.search(of) is not None
    if name == "poll" and (of in ("select", "self") or OF_PROCESS.search(of)):
        return False
    return name in WITHOUT_ARGUMENTS and bool(of) and all(map(is_none, call.args))


def waits_in(code: str) -> Iterator[str]:
    if not (any(each in code for each in WAITING) or MAY_WAIT.search(code)):
        return
    tree = ast.parse(code)
    awaited = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Await)}
    for node in ast.walk(tree):  # what a task of asyncio awaits holds nobody up
        if isinstance(node, ast.Call) and id(node) not in awaited and waits_for_ever(node):
            yield ast.unparse(node.func)


def test_every_call_that_waits_has_a_limit_or_a_reason() -> None:
    found = {f"{place}: {call}" for place, code in texts().items() for call in waits_in(code)}
    assert found - ALLOWED.keys() == set(), "a wait without a limit: give it one, or a reason here"
    assert ALLOWED.keys() - found == set(), "a reason for what is no more"


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("os.read(file, 1)", True),
        ("os.waitpid(child, 0)", True),
        ("os.waitpid(child, os.WNOHANG)", False),
        ("process.wait()", True),
        ("process.wait(5.0)", False),
        ("process.communicate(timeout=5)", False),
        ("subprocess.run(words)", True),
        ("subprocess.run(words, timeout=5)", False),
        ("select.select([a], [], [])", True),
        ("select.select([a], [], [], 0.0)", False),
        ("select.select([a], [], [], None)", True),
        ("ready.poll(None)", True),
        ("ready.poll()", True),
        ("self._process.poll()", False),
        ("selector.select()", True),
        ("process.wait(None)", True),
        ("process.wait(timeout=None)", True),
        ("process.communicate(text)", True),
        ("condition.wait_for(is_so)", True),
        ("condition.wait_for(is_so, 5.0)", False),
        ("lock.acquire()", True),
        ("queue.get()", True),
        ("self._queue.get(True, 5.0)", False),
        ("process.stdout.readline()", True),
        ("here.connect(address)", True),
        ("request.urlopen(address)", True),
        ("socket.create_connection(address)", True),
        ("socket.create_connection(address, 5.0)", False),
        ("here.sendmsg([data], rights, socket.MSG_DONTWAIT)", False),
        ("asyncio.create_subprocess_exec(program)", True),
        ("signal.sigwait(numbers)", True),
        ("fcntl.flock(file, fcntl.LOCK_EX)", True),
        ("fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)", False),
        ("', '.join(names)", False),
        ("thread.join()", True),
    ],
)
def test_a_wait_without_a_limit_is_recognised(text: str, found: bool) -> None:
    assert bool(list(waits_in(text))) is found


def test_the_limits_that_the_page_names_are_those_of_the_code() -> None:
    page = (Path(UMO).parents[1] / "docs" / "waits.md").read_text("utf-8")
    named = re.findall(r"`umo\.([a-z_.]+)\.([A-Z_]+)`, ([0-9.]+) s", page)
    assert len(named) > 25
    for module, name, seconds in named:
        value = getattr(pytest.importorskip(f"umo.{module}"), name)
        assert value == pytest.approx(float(seconds)), f"{module}.{name}"
