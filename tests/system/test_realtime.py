"""What a control process is granted, and what it says of the rest: with privileges, and as an ordinary user."""

from __future__ import annotations

import ctypes
import json
import os
import resource
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from umo.system import realtime
from umo.system.processes import user_name

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="real time needs Linux")

PREPARE = """
import gc, json, os
from umo.system.realtime import prepare
refusals = prepare(70)
status = open("/proc/self/status").read()
print(json.dumps({
    "refusals": [[r.what, r.why, r.grant] for r in refusals],
    "collecting": gc.isenabled(), "frozen": gc.get_freeze_count(),
    "locked": int(status.partition("VmLck:")[2].split()[0]),
    "fifo": os.sched_getscheduler(0) == os.SCHED_FIFO, "cores": len(os.sched_getaffinity(0)),
}))
"""
PR_CAPBSET_DROP, LAST_CAP = 24, 40


def ordinary() -> None:
    """In a child before exec: what an ordinary user without privileges has."""
    libc = ctypes.CDLL(None)
    for capability in range(LAST_CAP + 1):
        libc.prctl(PR_CAPBSET_DROP, capability, 0, 0, 0)
    resource.setrlimit(resource.RLIMIT_MEMLOCK, (8 << 20, 8 << 20))
    resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0))


def prepared(**how: Any) -> dict[str, Any]:
    done = subprocess.run([sys.executable, "-c", PREPARE], capture_output=True, text=True, check=True, **how)
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def test_an_ordinary_user_is_told_what_to_ask_for() -> None:
    found = prepared(preexec_fn=ordinary)
    said = {what: (why, grant) for what, why, grant in found["refusals"]}
    assert set(said) == {"memory is not locked", "no real-time scheduling"}
    assert said["memory is not locked"][0] == "ulimit -l is 8192 kB"
    assert "memlock unlimited" in said["memory is not locked"][1]
    assert said["no real-time scheduling"][0] == "ulimit -r is 0"
    assert "rtprio 95" in said["no real-time scheduling"][1]
    assert (found["collecting"], found["locked"], found["fifo"]) == (False, 0, False)
    assert found["frozen"] > 0


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root is granted everything")
def test_what_is_granted_is_used() -> None:
    found = prepared()
    if found["refusals"]:
        pytest.skip(f"not granted to root here: {found['refusals']}")
    assert (found["collecting"], found["fifo"], found["cores"]) == (False, True, 1)
    assert found["locked"] > 0


@pytest.mark.parametrize(
    ("granted", "period", "compiled", "busy_wait"),
    [
        ((80, 1), 1.0, False, 200e-6),
        ((80, 1), 1e-4, False, 50e-6),
        ((80, 1), 2e-4, True, 100e-6),
        ((80, 1), 1e-4, True, 100e-6),
        ((80, 1), 5e-5, True, 50e-6),
        ((0, 1), 5e-5, True, 0.0),
        ((0, 1), 1e-3, False, 0.0),
        ((80, None), 1e-3, False, 0.0),
        ((80, 0), 1e-3, False, 200e-6),
    ],
)
def test_a_process_rises_early_by_itself_where_it_has_priority_and_a_core(
    monkeypatch: pytest.MonkeyPatch, granted: tuple[int, int | None], period: float, compiled: bool, busy_wait: float
) -> None:
    monkeypatch.setattr(realtime, "granted", lambda: granted)
    assert realtime.default_busy_wait(period, compiled) == pytest.approx(busy_wait)


def test_a_process_is_sent_its_signal_also_where_its_parent_has_died_before_it_asked() -> None:
    code = """if True:
        import os, signal, time
        from umo.system import calls
        parent = os.getpid()
        if os.fork() == 0:
            while os.getppid() == parent:
                time.sleep(0.001)
            calls.die_with_parent(parent, signal.SIGKILL)
            print("alive")
        """
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("", "")


def test_a_core_that_there_is_not_is_refused_with_those_there_are() -> None:
    refusal = realtime.pin(4095, fifo=False)
    assert refusal is not None
    assert refusal.what == "not pinned to core 4095"
    assert "0" in refusal.grant


@pytest.mark.parametrize(("text", "cores"), [("", []), ("3", [3]), ("1-3,7", [1, 2, 3, 7]), ("nonsense", [])])
def test_isolated_cores_are_read_from_the_kernels_list(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str, cores: list[int]
) -> None:
    file = tmp_path / "isolated"
    file.write_text(text + "\n")
    monkeypatch.setattr(realtime, "ISOLATED", file)
    assert realtime.isolated_cores() == cores


RUN = """
import sys
from umo.process.start import start
from helpers import process_box
from pathlib import Path
folder = Path(sys.argv[1])
with start(process_box.machine, process_box.wiring(folder / "box"), process_box.drive) as machine:
    outcome = machine.wait()
print(len(machine.refusals), outcome.result, outcome.status)
"""


def test_a_run_without_privileges_ends_as_well(tmp_path: Path) -> None:
    command = [sys.executable, "-c", RUN, str(tmp_path)]
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[1])}
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, env=environment, preexec_fn=ordinary, timeout=60
    )
    assert done.stdout == "2 driven 0\n", done.stderr


def test_a_user_without_a_name_and_without_a_number_has_a_word(monkeypatch: pytest.MonkeyPatch) -> None:
    def unknown() -> str:
        raise ImportError("pwd")

    monkeypatch.setattr("getpass.getuser", unknown)
    monkeypatch.delattr("os.getuid")
    assert user_name() == "a user"
