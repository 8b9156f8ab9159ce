"""The seam of the operating system: a test can put a gate in front of what the processes of a run ask of it."""

from __future__ import annotations

import ast
import os
import re
import signal
import sys
from collections.abc import Callable, Iterator
from functools import wraps
from pathlib import Path
from typing import Any

import pytest

from helpers import process_box
from helpers.own_modules import texts
from helpers.process_box import Cells
from helpers.runs import Run, assert_safe
from helpers.waiting import until
from umo.process.run_state import NotBegun, RunState, Who
from umo.system import calls
from umo.system.processes import Child
from umo.text import UMO

ROOT = Path(UMO)
SEALED = [
    *(ROOT / "process").glob("*.py"),
    *(ROOT / "generate" / "split").glob("*.py"),
    ROOT / "drivers" / "timerfd.py",
    ROOT / "system" / "device_lock.py",
]
"""The modules that use nothing else of the operating system. The import contracts name those of Python that they do
not import."""
CONSTANT = re.compile(r"[A-Z][A-Z0-9_]+$")
READINGS = {"access", "environ", "getpid", "getppid", "path", "pread", "strerror", "waitstatus_to_exitcode"}
"""What only looks, at something of this process or that no other process waits for."""
OF_THIS_PROCESS = {"devnull", "dup2", "pathsep", "register_at_fork", "sep"}
SCHEDULING = {"sched_getaffinity", "sched_getparam", "sched_param", "sched_setaffinity", "sched_setscheduler"}
"""Which processor a process has, and when: a gate lets one process run at a time."""
MAY_BE_NAMED = {"os": READINGS | OF_THIS_PROCESS | SCHEDULING, "signal": set[str]()}

linux = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="processes of their own need Linux")


# The rule ----------------------------------------------------------------------------------------------------


def named_of_the_system(module: ast.Module) -> Iterator[str]:
    """What a module names of os and signal, but for constants."""
    for node in ast.walk(module):
        if isinstance(node, ast.ImportFrom) and node.module in MAY_BE_NAMED:
            yield f"from {node.module} import"
        if not isinstance(node, ast.Attribute) or not isinstance(node.value, ast.Name):
            continue
        known = MAY_BE_NAMED.get(node.value.id)
        if known is not None and not CONSTANT.match(node.attr) and node.attr not in known:
            yield f"{node.value.id}.{node.attr}"


def test_processes_timer_and_device_lock_ask_the_operating_system_through_the_seam_alone() -> None:
    found = {
        f"{file.relative_to(ROOT)}: {name}"
        for file in SEALED
        for name in named_of_the_system(ast.parse(file.read_text("utf-8")))
    }
    assert not found, "use umo.system.calls"


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("import os\nos.fork()", ["os.fork"]),
        ("import signal\nsignal.signal(signal.SIGTERM, signal.SIG_IGN)", ["signal.signal"]),
        ("from os import fork", ["from os import"]),
        ("import os\nos.open(os.devnull, os.O_RDONLY)", ["os.open"]),
        ("import os\nos.WTERMSIG(os.getpid())", []),
    ],
)
def test_what_passes_the_seam_by_is_found(text: str, found: list[str]) -> None:
    assert list(named_of_the_system(ast.parse(text))) == found


def functions_of(module: ast.Module) -> Iterator[str]:
    """The public functions that a module defines, also by another name of one."""
    for node in module.body:
        names = [node.name] if isinstance(node, ast.FunctionDef) else []
        if isinstance(node, ast.Assign):
            names = [each.id for each in node.targets if isinstance(each, ast.Name) and each.id.islower()]
        yield from (name for name in names if not name.startswith("_"))


FUNCTIONS = set(functions_of(ast.parse((ROOT / "system" / "calls.py").read_text("utf-8"))))


def kept_at_import(module: ast.Module) -> Iterator[str]:
    """The functions of the seam that a module takes when it is imported, where a later gate would be passed by."""
    if not any(isinstance(node, ast.ImportFrom) and any(a.name == "calls" for a in node.names) for node in module.body):
        return
    waiting: list[ast.AST] = [module]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            body = node.body if isinstance(node.body, list) else [node.body]
            waiting += node.args.defaults + [each for each in node.args.kw_defaults if each is not None]
            waiting += getattr(node, "decorator_list", [])
            waiting += [each for outer in body for each in ast.walk(outer) if isinstance(each, ast.FunctionDef)]
            continue
        if isinstance(node, ast.Attribute) and ast.unparse(node.value) == "calls" and node.attr in FUNCTIONS:
            yield node.attr
        waiting += ast.iter_child_nodes(node)


def imported_by_name(module: ast.Module) -> Iterator[str]:
    for node in ast.walk(module):
        if isinstance(node, ast.ImportFrom) and node.module == "umo.system.calls":
            yield from (each.name for each in node.names)
        if isinstance(node, ast.ImportFrom) and node.module == "umo.system":
            yield from (each.asname for each in node.names if each.name == "calls" and each.asname)


def test_the_functions_of_the_seam_are_called_through_its_module_when_they_are_needed() -> None:
    modules = {name: ast.parse(text) for name, text in texts().items() if "system" in text and "calls" in text}
    found = {f"{name}: {each}" for name, module in modules.items() for each in imported_by_name(module)}
    found |= {f"{name}: {each}" for name, module in modules.items() for each in kept_at_import(module)}
    assert not found, "from umo.system import calls; calls.fork()"


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("def wait(sleep=calls.sleep): calls.now()", ["sleep"]),
        ("def wait(*, sleep=calls.sleep): calls.now()", ["sleep"]),
        ("class Clock:\n    now = calls.now", ["now"]),
        ("wait = lambda clock=calls.now: clock()", ["now"]),
        ("def outer():\n    def inner(clock=calls.now): calls.fork()", ["now"]),
        ("BEGUN = calls.now()", ["now"]),
        ("def wait(write=calls): return lambda: calls.sleep(0.1)", []),
        ("ROOM = calls.MUTEX_BYTES", []),
    ],
)
def test_a_function_of_the_seam_that_is_kept_at_import_is_found(text: str, found: list[str]) -> None:
    assert list(kept_at_import(ast.parse(f"from umo.system import calls\n{text}"))) == found


# A gate ------------------------------------------------------------------------------------------------------


def put_gates(monkeypatch: pytest.MonkeyPatch, file: int) -> None:
    """In front of every function: it writes its name down, in whatever process."""

    def gate(name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        @wraps(function)
        def gated(*given: Any, **named: Any) -> Any:
            os.write(file, f"{name}\n".encode())
            return function(*given, **named)

        return gated

    for name in FUNCTIONS:
        monkeypatch.setattr(calls, name, gate(name, getattr(calls, name)))


AT_EACH_RUN = {
    *("fork", "new_session", "exit_now", "wait", "open_process", "signal_process", "stat_of", "die_with_parent"),
    *("handle_signal", "mask_signals", "pipe", "read", "write", "open", "close", "ready"),
    *("message_sockets", "socket_of", "send_message", "receive_message", "take_name", "listen"),
    *("now", "now_ns", "boottime_ns", "wall_time", "sleep", "make_timer", "set_timer"),
    *("make_mutex", "lock_mutex", "mutex_is_held", "unlock_mutex", "replace", "unlink", "fsync"),
}
NOT_AT_EACH = {
    "start_program": "a test's guardian is forked from the test",
    "kill": "only where the kernel gives no descriptors of processes",
    "set_alarm": "only where no process can be had to reset",
    "close_from": "keeper and black box",
    "processor_ns": "only while a tick is waited for busily",
    "listener": "only where a device is held already",
    "lock_file": "kept values and the history of alarms",
}


def test_every_function_of_the_seam_is_named_here() -> None:
    assert AT_EACH_RUN | NOT_AT_EACH.keys() == FUNCTIONS
    assert not AT_EACH_RUN & NOT_AT_EACH.keys()


@linux
def test_a_gate_that_is_put_in_place_after_the_import_stands_before_all_processes_of_a_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    names = tmp_path / "names"
    file = os.open(names, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    put_gates(monkeypatch, file)
    run = Run(process_box.wiring(tmp_path / "box"), "forever").until_running()
    os.kill(run.control, signal.SIGKILL)
    assert run.outcome().unsafe
    assert_safe(Cells(tmp_path / "box"))
    os.close(file)
    assert set(names.read_text().split()) - NOT_AT_EACH.keys() == AT_EACH_RUN


@linux
@pytest.mark.parametrize("call", ["new_session", "lock_mutex", "stat_of"])
def test_a_process_that_is_stopped_at_any_call_before_it_holds_its_lock_is_ended(
    monkeypatch: pytest.MonkeyPatch, call: str
) -> None:
    state, forked = RunState(), list[int]()
    fork, real, starter = calls.fork, getattr(calls, call), os.getpid()

    def stopped(*given: Any) -> Any:
        if os.getpid() != starter:
            os.kill(os.getpid(), signal.SIGSTOP)
        return real(*given)

    monkeypatch.setattr(calls, call, stopped)
    monkeypatch.setattr(calls, "fork", lambda: forked.append(fork()) or forked[-1])
    with pytest.raises(NotBegun, match="was stopped by a signal before it had begun"):
        state.fork(Who.STANDBY)
    with pytest.raises(ProcessLookupError):
        os.kill(forked[0], 0)  # ended, and waited for


# The functions -----------------------------------------------------------------------------------------------


@linux
def test_a_program_has_a_session_of_its_own_inherits_what_is_named_and_is_a_child(tmp_path: Path) -> None:
    asked, answer = os.pipe()
    words = [sys.executable, "-c", f"import os\nos.write({answer}, b'%d' % os.getsid(0))"]
    child = Child(calls.start_program(words, [answer], os.environ))
    os.close(answer)
    until(lambda: child.ended)
    assert child.status == 0
    assert int(os.read(asked, 99)) == child.pid
    os.close(asked)


@linux
def test_the_end_of_the_other_side_is_told_apart_from_something_to_read() -> None:
    asked, answer = calls.pipe()
    assert calls.ready(asked, 0.0) == 0
    calls.write(answer, b"!")
    assert calls.ready(asked, 0.0) == calls.INPUT
    assert calls.ready(asked, 0.0, 0) == 0
    calls.close(answer)
    assert calls.ready(asked, 0.0, 0) & calls.HUNG_UP
    calls.close(asked)


@linux
def test_a_timer_that_is_refused_is_an_error_of_the_operating_system() -> None:
    with pytest.raises(OSError, match="Bad file descriptor"):
        calls.set_timer(-1, 1, 1)


@linux
def test_an_end_is_killed_and_waited_for_once_also_of_a_process_that_was_stopped() -> None:
    pid = calls.fork()
    while pid == 0:
        signal.pause()
    child, looks = Child(pid), list[int]()
    child.send(signal.SIGSTOP)
    until(lambda: child.is_stopped)
    assert child.end(20.0, lambda: looks.append(1))
    assert child.status == signal.SIGKILL
    assert child.end(0.0)
