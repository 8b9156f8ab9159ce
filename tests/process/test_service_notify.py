"""The messages of a run to the service manager that started it: datagrams to a socket of the test's own."""

from __future__ import annotations

import os
import select
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import KW_ONLY
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest

import umo
from helpers.machines import timer
from helpers.tiers import first
from umo import Compound, DigitalSensor, connect, published
from umo.cycle.stage import Stage
from umo.operation.alarms import Alarm
from umo.process.frames import Reader
from umo.process.run_state import RunState
from umo.process.service_report import ServiceReport
from umo.system import notify
from umo.system.notify import ServiceManager
from umo.testing import periods

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="real time needs Linux")
LIMIT = 30.0
"""s within which a message comes on a busy computer."""
FOR_EVER = "from umo.control import until\n\n\nasync def main(m):\n    m.cycle.progress('filling', 1, 3)\n"
FOR_EVER += "    await until(lambda: False)\n"


class Supervisor:
    """A service manager of the test's own: it reads messages, and kills a run that sends no heartbeat."""

    def __init__(self, address: str) -> None:
        self.address = address
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.socket.bind("\0" + address[1:] if address[0] == "@" else address)
        self.told: list[str] = []

    def receive(self, within: float = 0.0) -> str:
        """The next message; "" if none comes."""
        if not select.select([self.socket], [], [], within)[0]:
            return ""
        message = self.socket.recv(4096).decode()
        self.told.append(message)
        return message

    def until(self, text: str) -> str:
        """Wait for a message with this text."""
        while message := self.receive(LIMIT):
            if text in message:
                return message
        raise AssertionError(f"no {text} among {self.told}")

    def starves(self, watchdog: float) -> bool:
        """Whether no heartbeat comes for this many s; False when the service says that it stops."""
        while message := self.receive(watchdog):
            if notify.STOPPING in message:
                return False
        return True


@pytest.fixture(params=first(1, ["abstract", "path"]))
def supervisor(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Supervisor]:
    made = Supervisor(str(tmp_path / "n") if request.param == "path" else f"@umo-test-{os.getpid()}")
    yield made
    made.socket.close()


@contextmanager
def run(tank: Path, environ: Mapping[str, str], *words: str) -> Iterator[subprocess.Popen[str]]:
    (tank / "application.py").write_text(FOR_EVER)
    command = [sys.executable, "-m", "umo_command", "run", "tank", "--realtime", "--no-record", *words]
    process = subprocess.Popen(
        command, cwd=tank.parent, env=os.environ | environ, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    try:
        yield process
    finally:
        process.terminate()
        process.communicate(timeout=LIMIT)


# The datagrams -----------------------------------------------------------------------------------------


def test_a_message_reaches_the_socket_that_the_environment_names(supervisor: Supervisor) -> None:
    manager = ServiceManager.of_environment({notify.SOCKET: supervisor.address}, ())
    manager.tell(notify.READY, notify.status("a\nb"))
    assert supervisor.receive() == "READY=1\nSTATUS=a b"


@pytest.mark.parametrize("address", ["", "@", "relative", "/nowhere/at/all", "/" + "long" * 100])
def test_where_nobody_listens_nothing_is_raised(address: str) -> None:
    ServiceManager.of_environment({notify.SOCKET: address}, ()).tell(notify.READY)


def test_a_manager_that_does_not_read_blocks_nobody(supervisor: Supervisor) -> None:
    manager = ServiceManager(supervisor.address)
    for _ in range(10_000):
        manager.tell(notify.status("full"))
    assert supervisor.receive() == "STATUS=full"


def test_a_text_that_is_no_unicode_is_not_sent_and_raises_nothing(supervisor: Supervisor) -> None:
    ServiceManager(supervisor.address).tell(notify.status("\udcff"))
    assert supervisor.receive() == ""


@pytest.mark.parametrize(
    ("variables", "watchdog"),
    [
        ({"WATCHDOG_USEC": "3000000"}, 3.0),
        ({"WATCHDOG_USEC": "3000000", "WATCHDOG_PID": "7"}, 3.0),
        ({"WATCHDOG_USEC": "3000000", "WATCHDOG_PID": "8"}, 0.0),
        ({"WATCHDOG_USEC": "soon"}, 0.0),
        ({"WATCHDOG_USEC": "-1"}, 0.0),
        ({}, 0.0),
    ],
)
def test_the_watchdog_counts_if_it_is_meant_for_this_run(variables: dict[str, str], watchdog: float) -> None:
    assert ServiceManager.of_environment({notify.SOCKET: "/n"} | variables, (6, 7)).watchdog == watchdog


# What is told ------------------------------------------------------------------------------------------


class Time:
    now = 100.0

    def __call__(self) -> float:
        return self.now


def messages(supervisor: Supervisor) -> list[str]:
    return list(iter(supervisor.receive, ""))


def test_a_heartbeat_is_passed_on_only_if_a_new_one_came(supervisor: Supervisor) -> None:
    state, time = RunState(), Time()
    report = ServiceReport(ServiceManager(supervisor.address, 10.0), state, lambda: None, time)
    report.look()
    assert messages(supervisor) == []  # it is still starting
    state.enter(Stage.RUNNING)
    report.look()
    assert messages(supervisor) == [notify.READY, notify.ALIVE, "STATUS=running"]
    state.beat()
    report.look()
    assert messages(supervisor) == []  # half of the interval has not passed
    time.now += 5.0
    report.look()
    assert messages(supervisor) == [notify.ALIVE]
    time.now += 5.0
    report.look()
    assert messages(supervisor) == []  # no new heartbeat
    state.beat()
    report.look()
    assert messages(supervisor) == [notify.ALIVE]


def test_who_takes_over_passes_on_no_heartbeat_that_was_passed_on(supervisor: Supervisor) -> None:
    state, time = RunState(), Time()
    report = ServiceReport(ServiceManager(supervisor.address, 10.0), state, lambda: None, time)
    state.enter(Stage.RUNNING)
    state.beat()
    report.take_over()
    report.look()
    assert notify.ALIVE not in messages(supervisor)
    state.beat()
    report.look()
    assert messages(supervisor) == [notify.ALIVE]


def test_the_stop_is_told_once_and_nothing_after_it(supervisor: Supervisor) -> None:
    state = RunState()
    report = ServiceReport(ServiceManager(supervisor.address, 10.0), state, lambda: None)
    state.enter(Stage.STOPPING)
    report.look()
    report.stopping("again")
    state.enter(Stage.RUNNING)
    report.look()
    assert messages(supervisor) == ["STOPPING=1\nSTATUS=stopping: every actuator goes to its default"]


def test_a_message_for_which_the_manager_has_no_room_is_sent_as_soon_as_it_has(supervisor: Supervisor) -> None:
    state, time = RunState(), Time()
    other = ServiceManager(supervisor.address)
    report = ServiceReport(ServiceManager(supervisor.address, 10.0), state, lambda: None, time)

    def full() -> None:
        messages(supervisor)
        while other.tell("STATUS=of another service"):
            pass

    full()
    state.enter(Stage.RUNNING)
    report.look()
    messages(supervisor)
    time.now += 1.0
    report.look()
    assert messages(supervisor) == [notify.READY, notify.ALIVE, "STATUS=running"]
    full()
    report.stopping("now")
    messages(supervisor)
    report.stopping("now")
    assert messages(supervisor) == ["STOPPING=1\nSTATUS=stopping: now"]


class Vat(Compound, alarms={"full": Alarm(lambda vat: vat.level > 80.0, "too full")}):
    timer: DigitalSensor
    _: KW_ONLY
    level: float = 0.0


def test_the_status_is_put_in_words_only_where_something_has_changed(
    supervisor: Supervisor, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("UMO_FRAMES", str(tmp_path / "frames"))
    state, time, calls = RunState(), Time(), []
    state.enter(Stage.RUNNING)
    facts = Reader.facts
    monkeypatch.setattr(Reader, "facts", lambda self, frame: calls.append(0) or facts(self, frame))  # type: ignore[func-returns-value]
    connection = connect(Vat(timer=timer()))
    with connection as m, published(connection, "vat") as ring, Reader(ring.path) as reader:
        report = ServiceReport(ServiceManager(supervisor.address), state, lambda: reader, time)

        def told(level: float) -> str:
            m.level = level
            periods(m, 3)
            messages(supervisor)
            for _ in range(3):
                report.look()
                time.now += 1.0
            return "".join(messages(supervisor))

        assert "STATUS=" in told(0.0)
        assert told(90.0) == "STATUS=full: too full (medium, unacknowledged)"
        assert (told(90.0), len(calls)) == ("", 2)
        assert told(0.0) == "STATUS=full: too full (medium, returned)"


@pytest.mark.parametrize(("frame", "first"), [({}, [notify.READY]), (None, [])])
def test_a_run_that_is_over_between_two_looks_was_ready_if_a_period_has_ended(
    supervisor: Supervisor, frame: object, first: list[str]
) -> None:
    reader = cast(Reader, SimpleNamespace(latest=lambda: frame))
    ServiceReport(ServiceManager(supervisor.address), RunState(), lambda: reader).stopping("it is done")
    assert messages(supervisor) == [*first, "STOPPING=1\nSTATUS=stopping: it is done"]


# A run -------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_run_tells_that_it_runs_how_that_it_lives_and_that_it_stops(tank: Path, supervisor: Supervisor) -> None:
    with run(tank, {notify.SOCKET: supervisor.address, notify.WATCHDOG: "200000"}) as process:
        supervisor.until(notify.READY)
        supervisor.until("STATUS=automatic; filling, 1 of 3")
        for _ in range(3):
            supervisor.until(notify.ALIVE)
        process.terminate()
        supervisor.until(notify.STOPPING)
        assert process.wait(LIMIT) == 143


@pytest.mark.slow
@pytest.mark.full
def test_a_supervisor_starves_when_the_guardians_are_stopped_and_its_stop_resets_the_machine(
    tank: Path, supervisor: Supervisor
) -> None:
    """Stopped by a signal, neither the guardian nor the standby guardian passes heartbeats on."""
    with run(tank, {notify.SOCKET: supervisor.address, notify.WATCHDOG: "1000000"}) as process:
        supervisor.until(notify.ALIVE)
        children = processes_of(process.pid)
        for pid in children:
            os.kill(pid, signal.SIGSTOP)
        assert supervisor.starves(3.0)
        for pid in (process.pid, *children):  # as WatchdogSignal=SIGTERM, which systemd follows by SIGCONT
            with suppress(ProcessLookupError):  # a control process without guardians has reset the machine and ended
                os.kill(pid, signal.SIGTERM)
                os.kill(pid, signal.SIGCONT)
        supervisor.until(notify.STOPPING)
        assert process.wait(LIMIT) in (1, 3, 143)


@pytest.mark.slow
@pytest.mark.full
def test_the_standby_guardian_tells_the_stop_when_the_guardian_is_killed(tank: Path, supervisor: Supervisor) -> None:
    with run(tank, {notify.SOCKET: supervisor.address, notify.WATCHDOG: "200000"}) as process:
        supervisor.until(notify.ALIVE)
        os.kill(child_of(process.pid), signal.SIGKILL)
        supervisor.until(notify.STOPPING)
        assert process.wait(LIMIT) == 1  # the guardian was lost


@pytest.mark.slow
def test_a_program_that_starts_a_run_speaks_for_itself(
    tank: Path, supervisor: Supervisor, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tank / "application.py").write_text(FOR_EVER)
    monkeypatch.setenv(notify.SOCKET, supervisor.address)
    with umo.start(str(tank), realtime=True) as machine:
        while machine.progress.text != "filling":
            machine.poll(0.1)
    assert supervisor.receive() == ""


def child_of(pid: int) -> int:
    return int(Path(f"/proc/{pid}/task/{pid}/children").read_text().split()[0])


def processes_of(pid: int) -> list[int]:
    """All processes that it started, and theirs."""
    children = [int(each) for each in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
    return children + [each for child in children for each in processes_of(child)]
