"""A guardian that needs nothing it does not have, believes nothing, and never stops short of resetting."""

from __future__ import annotations

import dataclasses
import errno
import gc
import json
import os
import select
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

import umo
from helpers import process_box
from helpers.machines import Board, bench, on, relay, wired
from helpers.process_box import Cells
from helpers.runs import Run, assert_safe, standing
from helpers.tiers import first
from umo import connect
from umo.cycle import segments
from umo.cycle.stage import Stage
from umo.drivers import Channel
from umo.errors import DeviceTimeout, DriverError
from umo.process import control_process, control_watch, guardian, hang_detection, reset
from umo.process import outcome as outcome_module
from umo.process.control_process import Control
from umo.process.control_watch import ControlWatch
from umo.process.frame_watcher import FrameWatcher
from umo.process.hang_detection import LOOK_INTERVAL, HangDetector
from umo.process.job import Job, Plan
from umo.process.messages import MessageSocket
from umo.process.outcome import Failed, Outcome, plain
from umo.process.processor_share import ProcessorShare
from umo.process.reset import Resetter
from umo.process.reset_state import Reached, ResetState
from umo.process.run_state import MAX_REPORT_BYTES, RunState
from umo.process.start import vanished
from umo.system import calls, realtime
from umo.system.device_record import DeviceClaim
from umo.system.processes import Child
from umo.testing import Scripted, periods
from umo.wiring import resolve

pytestmark = [
    pytest.mark.skipif(not sys.platform.startswith("linux"), reason="processes of their own need Linux"),
    pytest.mark.timeout(method="thread"),  # a resetter in this process takes the alarm
]


@pytest.fixture
def cells(tmp_path: Path) -> Cells:
    return Cells(tmp_path / "box")


@pytest.fixture(autouse=True)
def soon(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a device may still have under way is over at once."""
    monkeypatch.setattr(segments, "SETTLE", 0.01)


# What a control process says ----------------------------------------------------------------------------


RESULTS = ["much", "a_million", "a_file", "the_machine", "the_unshowable", "the_slow", "the_leaving", "the_lethal"]


@pytest.mark.parametrize("what", first(1, RESULTS))
def test_what_an_application_returns_cannot_change_how_a_run_ends(tmp_path: Path, cells: Cells, what: str) -> None:
    wiring = process_box.wiring(tmp_path / "box", process={"hang_timeout": "200 ms"})
    outcome = Run(wiring, f"returns_{what}").outcome()
    assert (outcome.status, outcome.unsafe) == (0, False)
    assert outcome.result is None if what == "the_lethal" else isinstance(outcome.result, str)
    assert len(json.dumps(outcome.dump())) < 65_536
    assert_safe(cells)


@pytest.mark.full
def test_an_exception_that_is_shown_slowly_does_not_count_as_hanging(tmp_path: Path, cells: Cells) -> None:
    outcome = Run(process_box.wiring(tmp_path / "box", process={"hang_timeout": "1 s"}), "fails_slowly").outcome()
    assert outcome.failure is not None
    assert outcome.failure.message.startswith("SlowError: said slowly (at ")
    assert (outcome.status, outcome.unsafe) == (1, False)


@pytest.mark.full
def test_a_report_that_never_ends_is_cut_off_and_the_end_stays_as_it_was(
    tmp_path: Path, cells: Cells, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(hang_detection, "REPORTING_LIMIT", 0.1)
    outcome = Run(process_box.wiring(tmp_path / "box"), "returns_the_slow").outcome()
    assert (outcome.status, outcome.unsafe, outcome.result) == (0, False, None)
    assert standing() == []


def test_a_report_of_a_driver_that_is_too_long_is_cut(tmp_path: Path) -> None:
    outcome = Outcome(reports={"box": {"all": list(range(100_000))}, "plant": {"parts": 3}})
    again = Outcome.decode(outcome.encode())
    assert again is not None
    assert again.reports["plant"] == {"parts": 3}
    assert again.reports["box"].startswith("{'all': [0, 1, 2")


@pytest.mark.full
def test_an_exception_with_an_endless_message_is_reported_in_a_bounded_one(tmp_path: Path, cells: Cells) -> None:
    outcome = Run(process_box.wiring(tmp_path / "box"), "fails_at_length").outcome()
    assert outcome.failure is not None
    assert outcome.failure.message.startswith("ValueError: xxxxx")
    assert len(outcome.encode()) < MAX_REPORT_BYTES
    assert (outcome.status, outcome.unsafe) == (1, False)


def test_plain_results_pass_as_they_are() -> None:
    assert plain({"a": [1, 2.5, None, "text"]}) == {"a": [1, 2.5, None, "text"]}


@pytest.mark.parametrize(
    ("text", "name"), [("x", "zones.{}.heater"), ("Ж" * 20_000, "motor{}"), ("\0" * 20_000, "\0" * 200)]
)
def test_however_long_an_outcome_is_it_arrives_with_some_of_its_unreached_actuators(text: str, name: str) -> None:
    outcome = Outcome(Failed("StopError", text, 3, text), unreached=[name.format(i) for i in range(4000)], result=text)
    assert len(outcome.encode()) <= outcome_module.MAX_BYTES < MAX_REPORT_BYTES
    assert len(json.dumps(outcome.dump())) <= outcome_module.MAX_BYTES
    again = Outcome.decode(outcome.encode())
    assert again is not None
    assert again.status == 3
    assert again.unreached
    assert again.failure is not None


@pytest.mark.parametrize("text", [b"", b"{", b"null", b"[]", b'{"failure": 1}', b"\xff", b"[" * 60_000])
def test_what_is_not_an_outcome_is_none(text: bytes) -> None:
    assert Outcome.decode(text) is None


def test_a_broken_report_is_a_reason_to_step_in(tmp_path: Path, cells: Cells, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Outcome, "encode", lambda self: b"{")
    outcome = Run(process_box.wiring(tmp_path / "box")).outcome()
    assert outcome.failure is not None
    assert "without resetting the machine (at " in outcome.failure.message
    assert "the guardian reset every actuator" in outcome.failure.message
    assert_safe(cells)


def test_a_control_process_that_closes_every_descriptor_is_reset_and_reported(tmp_path: Path, cells: Cells) -> None:
    """Its own connections and pipes are gone, the outputs stood energised. The period is long: one that is late does
    not read the timer."""
    wiring = process_box.wiring(tmp_path / "box", descriptor=True, period="50 ms")
    outcome = Run(wiring, "closes_everything").outcome()
    assert outcome.status == 1
    assert outcome.unreached == []
    assert_safe(cells)


@pytest.mark.full
def test_a_machine_without_actuators_whose_control_process_was_killed_is_told_so(tmp_path: Path) -> None:
    """Nothing is reset, so nothing has waited for the end of the process."""
    wiring = process_box.wiring(tmp_path / "box")
    del wiring["wire"]["motor"], wiring["wire"]["valve"]
    run = Run(wiring, "watch", machine="helpers.process_box:watching").until_running()
    os.kill(run.control, signal.SIGKILL)
    outcome = run.outcome()
    assert outcome.failure is not None
    assert outcome.failure.message.startswith("the control process was killed (SIGKILL)")


def test_only_what_was_waited_for_in_vain_is_told_as_blocked(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(control_watch, "DEATH_TIMEOUT", 0.05)
    pid = os.fork()
    while pid == 0:
        signal.pause()
    watch = ControlWatch(pid, RunState(), -1)
    assert watch.ending() == "cannot be killed: it is blocked in a kernel call"  # nobody has killed it
    monkeypatch.setattr(control_watch, "DEATH_TIMEOUT", 20.0)
    watch = ControlWatch(pid, RunState(), -1)
    watch.process.send(signal.SIGKILL)
    assert watch.ending() == "was killed (SIGKILL)"


# A guardian short of everything ---------------------------------------------------------------------------


def no_fork(patch: pytest.MonkeyPatch, when: Callable[[], bool] = lambda: True) -> None:
    """There is no room for another process."""
    fork = calls.fork

    def refused() -> int:
        if when():
            raise BlockingIOError(errno.EAGAIN, "Resource temporarily unavailable")
        return fork()

    patch.setattr(calls, "fork", refused)


def test_without_a_child_the_guardian_resets_the_machine_itself(
    tmp_path: Path, cells: Cells, monkeypatch: pytest.MonkeyPatch
) -> None:
    full = tmp_path / "full"
    monkeypatch.setattr(Resetter, "stand_by", lambda self, first=True: None)
    no_fork(monkeypatch, full.exists)
    run = Run(process_box.wiring(tmp_path / "box"), "forever").until_running()
    full.touch()
    os.kill(run.control, signal.SIGKILL)
    outcome = run.outcome()
    assert outcome.failure is not None
    assert "the guardian reset every actuator" in outcome.failure.message
    assert_safe(cells)


def test_a_guardian_that_cannot_watch_any_more_resets_the_machine(
    tmp_path: Path, cells: Cells, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(self: HangDetector) -> str:
        raise MemoryError("no room")

    monkeypatch.setattr(HangDetector, "look", fail)
    outcome = Run(process_box.wiring(tmp_path / "box"), "forever").outcome()
    assert outcome.failure is not None
    assert "the guardian failed: MemoryError: no room" in outcome.failure.message
    assert_safe(cells)


def test_a_guardian_that_fails_in_a_step_goes_on_watching(
    tmp_path: Path, cells: Cells, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(self: FrameWatcher) -> None:
        raise OSError("no frames")

    monkeypatch.setattr(FrameWatcher, "look", fail)
    run = Run(process_box.wiring(tmp_path / "box"), "forever").until_running()
    os.kill(run.control, signal.SIGKILL)
    outcome = run.outcome()
    assert "the guardian reset every actuator" in str(outcome.failure)
    assert run.notices.count("the guardian failed in a step and continues: no frames") == 1
    assert_safe(cells)


def test_a_guardian_that_cannot_be_asked_to_stop_any_more_stops_the_machine(
    tmp_path: Path, cells: Cells, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(self: MessageSocket, timeout: float = 0.0) -> None:
        raise MemoryError("no room")

    with monkeypatch.context() as patch:
        patch.setattr(MessageSocket, "receive", fail)
        run = Run(process_box.wiring(tmp_path / "box"), "forever")
    outcome = run.outcome()
    assert (outcome.status, outcome.unsafe) == (128 + signal.SIGTERM, False)
    assert_safe(cells)


def test_a_driver_that_hangs_in_the_guardian_itself_is_interrupted(
    tmp_path: Path, cells: Cells, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reset, "CALL_MARGIN", 0.1)
    machine = process_box.machine()
    wired_up = resolve(machine, process_box.wiring(tmp_path / "box", at=2, action="hang"))
    resetter = Resetter(machine, wired_up)
    no_fork(monkeypatch)
    cells.numbers[process_box.LEVELS] = 500
    assert resetter.reset(5.0) == {}
    assert_safe(cells)


# Asking and watching --------------------------------------------------------------------------------------


def test_a_guardian_that_is_stopped_is_noticed_and_the_machine_stops_by_itself(tmp_path: Path, cells: Cells) -> None:
    run = Run(process_box.wiring(tmp_path / "box", process={"hang_timeout": "1 s"}), "forever").until_running()
    os.kill(run.guardian, signal.SIGSTOP)
    outcome = run.outcome()
    assert outcome.failure is not None
    assert "no heartbeat from the guardian for " in outcome.failure.message
    assert (outcome.status, outcome.unsafe) == (1, True)
    assert_safe(cells)
    assert len(standing()) == 1


def test_a_stop_that_comes_while_the_devices_are_claimed_leaves_no_record(
    tmp_path: Path, cells: Cells, monkeypatch: pytest.MonkeyPatch
) -> None:
    def claim_and_be_stopped(*words: Any, **more: Any) -> DeviceClaim:
        claim = DeviceClaim(*words, **more)
        os.kill(os.getpid(), signal.SIGTERM)
        return claim

    monkeypatch.setattr(guardian, "DeviceClaim", claim_and_be_stopped)
    outcome = Run(process_box.wiring(tmp_path / "box")).outcome()
    assert (outcome.stopped_by, outcome.failure, outcome.unsafe) == (signal.SIGTERM, None, False)
    assert standing() == []


def test_a_signal_that_the_application_ignores_is_asked_again_in_shared_memory(tmp_path: Path, cells: Cells) -> None:
    run = Run(process_box.wiring(tmp_path / "box"), "deaf").until_running()
    run.channel.send("stop", signal=signal.SIGINT)
    outcome = run.outcome()
    assert (outcome.status, outcome.stopped_by) == (130, signal.SIGINT)
    assert_safe(cells)


FRAME = cast(Any, SimpleNamespace(time=0.0))


class Found:
    """What a control process finds when it looks at itself at the end of a period."""

    def __init__(self, gap: float = 0.0, unwatched: float = 0.0, asked: int = 0, excused: float = 0.0) -> None:
        self.gap, self.unwatched, self.asked, self.excused = gap, unwatched, asked, excused

    def beat(self) -> float:
        return self.gap


def plan_of(folder: Path, **process: object) -> Plan:
    return Plan(Job(machine="helpers.process_box:machine", wiring=process_box.wiring(folder / "box", process=process)))


@pytest.mark.parametrize(
    ("found", "stops"),
    [
        (Found(gap=0.05), False),
        (Found(gap=0.3), True),
        (Found(gap=0.25, excused=0.2), False),
        (Found(gap=0.35, excused=0.3), True),  # nobody controlled the machine for three times the limit
        (Found(unwatched=0.4), False),
        (Found(unwatched=0.6), True),
        (Found(asked=15), True),
    ],
)
def test_a_control_process_stops_after_a_gap_without_a_guardian_or_when_asked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, found: Found, stops: bool
) -> None:
    stopped: list[object] = []
    monkeypatch.setattr(control_process, "request_stop", lambda number=None: stopped.append(number))
    plan = plan_of(tmp_path, hang_timeout="100 ms")
    Control(plan, cast(Any, None), cast(RunState, found), cast(Any, None), 0, None).each_period(FRAME)
    assert bool(stopped) is stops


def test_a_look_of_the_guardians_beside_a_late_heartbeat_takes_no_excuse_away(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Looked(Found):
        def beat(self) -> float:
            self.excused = 0.0
            return self.gap

    monkeypatch.setattr(control_process, "request_stop", lambda number=None: pytest.fail("stopped"))
    life = cast(RunState, Looked(gap=0.25, excused=0.2))
    plan = plan_of(tmp_path, hang_timeout="100 ms")
    Control(plan, cast(Any, None), life, cast(Any, None), 0, None).each_period(FRAME)


@pytest.mark.parametrize(("late", "unsafe"), [(True, False), (False, True)])
def test_a_guardian_that_looks_soon_after_the_computer_was_suspended_is_not_lost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, late: bool, unsafe: bool
) -> None:
    life, outcome = Found(unwatched=3600.0), Outcome()
    monkeypatch.setattr(calls, "sleep", lambda seconds: setattr(life, "unwatched", 0.0) if late else None)
    control = Control(plan_of(tmp_path), cast(Any, None), cast(RunState, life), cast(Any, None), os.getppid(), None)
    control._judge(outcome, None)
    assert outcome.unsafe is unsafe


@pytest.mark.parametrize(("watchdogs", "stops"), [({}, False), ({"box": 0.06}, True)])
def test_a_gap_longer_than_the_watchdog_of_a_circuit_ends_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, watchdogs: dict[str, float], stops: bool
) -> None:
    stopped: list[object] = []
    monkeypatch.setattr(control_process, "request_stop", lambda number=None: stopped.append(number))
    plan = plan_of(tmp_path, hang_timeout="100 ms")
    plan.wired = dataclasses.replace(plan.wired, watchdogs=watchdogs)
    life = cast(RunState, Found(gap=0.07, excused=0.07))
    Control(plan, cast(Any, None), life, cast(Any, None), 0, None).each_period(FRAME)
    assert bool(stopped) is stops


@pytest.mark.full
def test_a_driver_that_hangs_while_leaving_is_noticed_after_the_limit_for_a_hang(tmp_path: Path, cells: Cells) -> None:
    hangs = "helpers.process_box:HangsInReset"
    wiring = process_box.wiring(tmp_path / "box", type=hangs, process={"hang_timeout": "200 ms"})
    outcome = Run(wiring).outcome()
    assert outcome.failure is not None
    assert "no heartbeat for 200 ms while stopping" in outcome.failure.message
    assert_safe(cells)


@pytest.mark.full
def test_the_guardian_keeps_the_hold_until_its_resets_are_done(tmp_path: Path, cells: Cells) -> None:
    away = tmp_path / "away"
    away.touch()
    wiring = process_box.wiring(tmp_path / "box", at=25, action="kill", away=str(away))
    run = Run(wiring, "forever").until_running()
    kinds = []
    while "notice" not in kinds:  # "not reached yet, trying"
        message = run.next()
        kinds.append(message["kind"])
    second = Run(wiring, acknowledge=True).outcome()
    assert second.status == 2
    assert second.failure is not None
    assert f"is held by pid {run.guardian} of " in second.failure.message
    away.unlink()
    assert run.outcome().unreached == []
    assert Run(wiring, acknowledge=True).outcome().status == 0


def test_the_guardian_too_resets_a_second_time_when_what_was_under_way_is_over(
    tmp_path: Path, cells: Cells, monkeypatch: pytest.MonkeyPatch
) -> None:
    machine, waited = process_box.machine(), []
    no_fork(monkeypatch)
    wired_up = resolve(machine, process_box.wiring(tmp_path / "box", timeout="300 ms"))

    def late(seconds: float, pause: object, on_call: object) -> None:
        waited.append(seconds)
        cells.numbers[process_box.LEVELS] = 500  # the device carries out the dead process's last write

    monkeypatch.setattr(reset, "wait_for", late)
    assert Resetter(machine, wired_up).reset(5.0) == {}
    assert waited == [0.3]
    assert_safe(cells)


@pytest.mark.usefixtures("many_descriptors")
def test_messages_pass_where_more_than_1024_descriptors_are_open() -> None:
    here, there = MessageSocket.pair()
    other = MessageSocket(there)
    try:
        assert here._socket.fileno() > 1023
        other.send("notice", text="all is well")
        message = here.receive(1.0)
        assert message is not None
        assert message["text"] == "all is well"
    finally:
        other.close()
        here.close()


def test_the_last_messages_of_a_peer_that_left_ours_unread_are_received() -> None:
    """Such a socket gives ECONNRESET once, and the messages after it."""
    here, there = MessageSocket.pair()
    here.send("stop", signal=2)
    other = MessageSocket(there)
    other.send("ended", outcome={"a": 1})
    other.close()
    message = here.receive(1.0)
    assert message is not None
    assert message["outcome"] == {"a": 1}
    assert here.receive(1.0) is None
    assert here.ended
    here.close()


@pytest.mark.parametrize("text", [b"{", b"[1]", b'{"no": "kind"}', b"\xff\xfe"])
def test_what_is_not_a_message_is_passed_over(text: bytes) -> None:
    here, there = MessageSocket.pair()
    there.send(text)
    message = here.receive(1.0)
    assert message == {"kind": "", "files": []}
    assert not here.ended
    there.close()
    here.close()


class OfShare:
    """What a guardian knows of its control process's share of a processor: it was kept waiting for that part of each
    look."""

    by_whom = "press (pid 12) had core 1"

    def __init__(self, part: float = 0.0) -> None:
        self._part = part
        self.kept_waiting = 0.0

    def begin(self) -> None:
        self.kept_waiting = 0.0

    def look(self) -> None:
        self.kept_waiting += self._part * LOOK_INTERVAL


IDLE = cast(ProcessorShare, OfShare())


class Time:
    """The clock of the heartbeats, which goes on by the guardian's looks only."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = 10**12
        monkeypatch.setattr(calls, "boottime_ns", lambda: self.now)

    def hung_after(self, silence: HangDetector, every: float, most: int = 100) -> tuple[str, float]:
        """What is known, and after how many s, of a process that sends no heartbeat; looks come `every` s."""
        for look in range(1, most + 1):
            self.now += int(every * 1e9)
            if hung := silence.look():
                return hung, look * every
        return "", most * every


def test_a_period_longer_than_the_limit_for_a_step_of_starting_does_not_count_as_hanging() -> None:
    assert HangDetector(RunState(), IDLE, 0.1, period=60.0).limit > 60.0


def test_a_suspended_computer_is_not_taken_for_a_hanging_control_process(monkeypatch: pytest.MonkeyPatch) -> None:
    time, life = Time(monkeypatch), RunState()
    life.enter(Stage.RUNNING)
    silence = HangDetector(life, IDLE, 0.1, 0.001)
    assert time.hung_after(silence, 3600.0, most=1)[0] == ""
    assert time.hung_after(silence, LOOK_INTERVAL, most=2)[0] == ""


@pytest.mark.parametrize(("every", "after"), [(LOOK_INTERVAL, 0.12), (LOOK_INTERVAL + 0.08, 0.6)])
def test_a_hang_is_noticed_also_by_a_guardian_whose_looks_come_late(
    monkeypatch: pytest.MonkeyPatch, every: float, after: float
) -> None:
    """As in a container with a CPU quota that the hanging process uses up."""
    time, life = Time(monkeypatch), RunState()
    life.enter(Stage.RUNNING)
    hung, late = time.hung_after(HangDetector(life, IDLE, 0.1, 0.001), every)
    assert hung == "hung: no heartbeat for 100 ms while running"
    assert late == pytest.approx(after)


@pytest.mark.parametrize(
    ("part", "after", "what"),
    [
        (0.4, 0.16, "hung: no heartbeat for 100 ms while running"),  # 0.1 s in which it could run
        (0.9, 0.32, "was kept from running for 0.27 s while running: press (pid 12) had core 1"),  # three times 0.1 s
    ],
)
def test_time_for_which_others_had_the_processor_is_not_counted_up_to_three_times_the_limit(
    monkeypatch: pytest.MonkeyPatch, part: float, after: float, what: str
) -> None:
    time, life = Time(monkeypatch), RunState()
    life.enter(Stage.RUNNING)
    how, late = time.hung_after(HangDetector(life, cast(ProcessorShare, OfShare(part)), 0.1, 0.001), LOOK_INTERVAL)
    assert (how, late) == (what, pytest.approx(after))
    assert life.excused == pytest.approx(part * late, abs=0.03)


@pytest.mark.full
@pytest.mark.parametrize("number", [signal.SIGCHLD])
def test_a_guardian_started_with_sigchld_ignored_still_resets(tmp_path: Path, cells: Cells, number: int) -> None:
    before = signal.signal(number, signal.SIG_IGN)
    try:
        run = Run(process_box.wiring(tmp_path / "box"), "forever").until_running()
        signal.signal(number, before)
        os.kill(run.control, signal.SIGKILL)
        outcome = run.outcome()
    finally:
        signal.signal(number, before)
    assert outcome.failure is not None
    assert "the guardian reset every actuator" in outcome.failure.message
    assert (outcome.status, outcome.unreached) == (1, [])
    assert_safe(cells)


# Drivers and applications that break rules -----------------------------------------------------------------


@pytest.mark.parametrize("killed", first(1, [False, True]))
def test_a_driver_that_raises_what_is_not_an_exception_costs_its_own_actuator_only(
    tmp_path: Path, cells: Cells, killed: bool
) -> None:
    wiring = process_box.wiring(tmp_path / "box", type="helpers.process_box:Leaving", process={"reset_for": "10 ms"})
    run = Run(wiring, "forever" if killed else "drive")
    if killed:
        os.kill(run.until_running().control, signal.SIGKILL)
    outcome = run.outcome()
    assert (outcome.status, outcome.unreached) == (3, ["valve"])
    assert outcome.failure is not None
    assert "CancelledError" in outcome.failure.message
    assert cells.levels["motor"] == 0


def test_what_does_not_answer_keeps_nothing_else_of_its_driver_from_being_reset(
    tmp_path: Path, cells: Cells, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reset, "ATTEMPT_PAUSE", 0.05)
    wiring = process_box.wiring(tmp_path / "box", type="helpers.process_box:HalfDead", process={"reset_for": "1 s"})
    run = Run(wiring, "forever").until_running()
    cells.numbers[process_box.STRUCK] = 1
    os.kill(run.control, signal.SIGKILL)
    outcome = run.outcome()
    assert (outcome.status, outcome.unreached) == (3, ["valve"])
    assert cells.levels["motor"] == 0


def test_the_stop_order_is_the_one_that_the_machine_was_connected_with(tmp_path: Path, cells: Cells) -> None:
    outcome = Run(process_box.wiring(tmp_path / "box"), "breaks_its_stop_order").outcome()
    assert (outcome.status, outcome.unreached) == (0, [])
    assert_safe(cells)


def test_a_driver_reports_after_its_outputs_were_reset(tmp_path: Path, cells: Cells) -> None:
    outcome = Run(process_box.wiring(tmp_path / "box", type="helpers.process_box:Reporting")).outcome()
    assert outcome.status == 0
    assert outcome.reports["box"] == {"motor": 0}  # 500 before the reset


@pytest.mark.full
def test_a_report_that_fails_is_told_in_its_place_and_does_not_fail_the_run(tmp_path: Path, cells: Cells) -> None:
    outcome = Run(process_box.wiring(tmp_path / "box", type="helpers.process_box:Mute")).outcome()
    assert (outcome.status, outcome.unreached, outcome.unsafe) == (0, [], False)
    assert outcome.failure is None
    assert outcome.reports["box"]["no report"].startswith("SystemExit: no report")
    assert_safe(cells)


# Requests that were still under way -----------------------------------------------------------------------


def test_after_a_write_that_failed_everything_is_reset_a_second_time_later(tmp_path: Path) -> None:
    """A device that stalled carried out the abandoned write after the reset had been confirmed."""
    machine, box = bench(), Board(f"test {tmp_path}")
    connection = connect(machine, on(box, machine))
    waited: list[float] = []
    connection.pause = waited.append
    with connection as m:
        periods(m)
        box.at(len(box.calls), DeviceTimeout("no answer"))
        with pytest.raises(DriverError, match="no answer"):
            m.update()
    assert [call.channels[0] for call in box.segments("reset")] == ["motor", "valve"] * 2
    assert sum(waited) == pytest.approx(segments.settling(connection.wired))


def test_a_write_that_failed_on_a_simulated_circuit_costs_no_waiting() -> None:
    machine, box = bench(), Scripted()
    connection = connect(machine, wired(machine, box))
    connection.pause = lambda seconds: pytest.fail("it waited")
    with connection as m:
        box.at(len(box.calls), OSError("cut"))
        with pytest.raises(OSError):
            m.update()


# Resetting from outside -----------------------------------------------------------------------------------


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in {
        "CALL_MARGIN": 0.4,
        "UNCONTROLLED_TIMEOUT": 0.05,
        "ATTEMPT_PAUSE": 0.01,
        "DEATH_TIMEOUT": 0.2,
    }.items():
        monkeypatch.setattr(reset, name, value)


def resetter_of(tmp_path: Path, wiring: dict[str, Any], **more: Any) -> Resetter:
    """Of a machine whose outputs are on."""
    machine = process_box.machine()
    for name in ("box", "bad"):
        cells = Cells(tmp_path / name)
        for i in range(len(process_box.OUTPUTS)):
            cells.numbers[process_box.LEVELS + i] = 500
    return Resetter(machine, resolve(machine, wiring), **more)


@pytest.mark.parametrize(
    ("fault", "cause"),
    first(
        4,
        [
            ("open:kill", "the process that resets was killed (SIGKILL)"),
            ("open:raise close:leave", "unplugged"),
            ("initialize.valve:hang", "a call did not return within"),
            ("reset.valve:crash", "the driver crashed"),
            ("open:hang", "a call did not return within"),
            ("open:crash", "the driver crashed (SIGSEGV)"),
            ("open:leave", "CancelledError"),
        ],
    ),
)
@pytest.mark.usefixtures("impatient")
def test_a_driver_that_fails_in_any_way_keeps_no_other_driver_from_being_reset(
    tmp_path: Path, fault: str, cause: str
) -> None:
    wiring = process_box.wiring(tmp_path / "box", timeout="10 ms")
    bad = {"type": "helpers.process_box:Faulty", "fault": fault, "file": str(tmp_path / "bad"), "timeout": "10 ms"}
    wiring["drivers"]["bad"], wiring["wire"]["valve"] = bad, {"driver": "bad"}
    left = left_by(tmp_path, wiring, fault)
    assert Cells(tmp_path / "box").levels["motor"] == 0
    assert list(left) == ["valve"]
    assert cause in left["valve"]


def test_a_child_on_standby_that_cannot_be_replaced_is_tried_again_until_it_can(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now, refusals = 100.0, 0

    def fork(first: bool) -> int:
        nonlocal refusals
        if refusals:
            refusals -= 1
            raise BlockingIOError(11, "Resource temporarily unavailable")
        return os.fork()

    monkeypatch.setattr(calls, "now", lambda: now)
    resetter = resetter_of(tmp_path, process_box.wiring(tmp_path / "box"), fork=fork)
    resetter.stand_by()
    before, files = resetter.reserve, os.listdir("/proc/self/fd")
    refusals = 3
    os.kill(before, signal.SIGKILL)
    os.waitid(os.P_PID, before, os.WEXITED | os.WNOWAIT)
    for _ in range(3):
        with pytest.raises(BlockingIOError):
            resetter.look()
        assert (resetter.reserve, resetter.look()) == (0, False)  # not sooner than after a pause
        now += reset.FORK_PAUSE
    assert resetter.look()
    assert resetter.reserve not in (0, before)
    assert len(os.listdir("/proc/self/fd")) == len(files)
    assert not resetter.look()
    resetter.dismiss()
    now += reset.FORK_PAUSE
    assert (resetter.look(), resetter.reserve) == (False, 0)  # none is needed any more


def test_a_child_on_standby_that_fails_by_itself_is_not_forked_again_and_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    resetter = resetter_of(tmp_path, process_box.wiring(tmp_path / "box"))
    monkeypatch.setattr(resetter, "takes_place", lambda within: sys.exit(1))
    resetter.stand_by()
    os.waitid(os.P_PID, resetter.reserve, os.WEXITED | os.WNOWAIT)
    assert not resetter.look()
    assert resetter.reset(0.0) == {}
    assert Cells(tmp_path / "box").levels["motor"] == 0


@pytest.mark.parametrize(
    ("fault", "left"),
    [("reset.valve:hang", ["valve"]), ("initialize.valve:crash", ["valve"]), ("close:hang", []), ("close:leave", [])],
)
@pytest.mark.usefixtures("impatient")
def test_only_what_was_not_reached_is_reported(tmp_path: Path, fault: str, left: list[str]) -> None:
    wiring = process_box.wiring(tmp_path / "box", type="helpers.process_box:Faulty", fault=fault, timeout="10 ms")
    assert list(left_by(tmp_path, wiring, fault)) == left
    assert Cells(tmp_path / "box").levels["motor"] == 0


def left_by(tmp_path: Path, wiring: dict[str, Any], fault: str) -> dict[str, str]:
    """What a reset has not reached. An attempt with a call that does not return takes 0.4 s, and more on a busy
    computer: what such a one could not do in the time is tried once more, with more time."""
    left = resetter_of(tmp_path, wiring).reset(1.5 if "hang" in fault else 0.5)
    return left if "motor" not in left else resetter_of(tmp_path, wiring).reset(8.0)


class Rack(umo.Compound):
    outs: list[umo.BinaryActuator[umo.states.OnOff]]


def test_what_stands_behind_many_that_do_not_answer_is_tried_as_well(tmp_path: Path) -> None:
    machine = Rack(outs=[relay() for _ in range(4)])
    box = {"type": "helpers.process_box:Silent", "file": str(tmp_path / "box"), "timeout": "10 ms"}
    wire = {path: {"driver": "box", "channel": path} for path in ("outs.0", "outs.1", "outs.2")}
    wire["outs.3"] = {"driver": "box", "channel": "motor"}
    resetter = Resetter(machine, resolve(machine, {"drivers": {"box": box}, "wire": wire}))
    Cells(tmp_path / "box").numbers[process_box.LEVELS] = 1
    assert resetter.reset(0.5) == dict.fromkeys(resetter.paths[:3], f"box (file {tmp_path}/box): slot gone")
    assert Cells(tmp_path / "box").levels["motor"] == 0


@pytest.mark.usefixtures("impatient")
def test_a_child_that_cannot_be_killed_is_not_waited_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As in a driver call that the kernel does not interrupt."""
    wiring = process_box.wiring(tmp_path / "box", type="helpers.process_box:Faulty", fault="open:hang", timeout="10 ms")
    children: list[Child] = []
    with monkeypatch.context() as patch:
        patch.setattr(Child, "send", lambda child, number: children.append(child))
        left = resetter_of(tmp_path, wiring).reset(0.0)
    assert all(child.end(20.0) for child in children)
    assert left["valve"] == "a call did not return within 0.42 s"


def test_a_call_that_hangs_in_this_process_is_interrupted_when_no_time_is_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where no child can be had. The time is over as soon as the call hangs."""
    begun: list[str] = []
    monkeypatch.setattr(calls, "now", lambda: float(len(begun)))

    def hang(driver: object, channel: Channel, default: int | None) -> None:
        begun.append(channel.text)
        select.select([], [], [], 60.0)

    monkeypatch.setattr(process_box.Box, "initialize", hang)
    resetter = resetter_of(tmp_path, process_box.wiring(tmp_path / "box"))
    gc.disable()  # what a signal raises in the callback of a collection is lost
    try:
        resetter._work_here([0, 1], lambda: True, limit=60.0, until=0.05)
    finally:
        gc.enable()
    assert len(begun) == 1
    assert resetter._state.reached(0) is Reached.NO
    assert resetter._state.cause(0) == f"box (file {tmp_path}/box): no time was left"
    assert resetter._state.reached(1) is Reached.UNTRIED
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)


def test_a_reset_needs_no_permission(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "sched_setaffinity", refused)
    monkeypatch.setattr(realtime, "use_fifo", lambda priority: None)
    realtime.prepare_guardian(80)
    resetter = resetter_of(tmp_path, process_box.wiring(tmp_path / "box"), guard=refused)
    assert resetter.reset(0.0) == {}
    assert_safe(Cells(tmp_path / "box"))


def test_a_board_keeps_what_was_reached_and_why_not() -> None:
    state = ResetState(["a", "b", "c"])
    state.note(0, Reached.YES)
    state.note(1, Reached.NO, "no route ü" * 100)
    assert [state.reached(i) for i in range(3)] == [Reached.YES, Reached.NO, Reached.UNTRIED]
    assert state.cause(1).startswith("no route ü")
    state.clear()
    assert state.reached(0) is Reached.UNTRIED


@pytest.mark.parametrize(
    ("status", "left", "safe", "expected"),
    [
        (0, None, False, 0),
        (143, None, False, 143),
        (1, None, False, 1),
        (-9, None, False, 3),
        (-9, Outcome(), False, 1),
        (-9, Outcome(), True, 1),
        (-9, Outcome(Failed("StopError", "not reached: m", 3), unreached=["m"]), False, 3),
    ],
)
def test_the_starter_takes_the_guardians_status_where_nobody_told_the_outcome(
    status: int, left: Outcome | None, safe: bool, expected: int
) -> None:
    outcome = vanished(status, left, ["motor", "valve"], "press", running=True, safe=safe)
    assert outcome.status == expected
    assert outcome.failure is None or (expected == 3) == ("not reached: m" in outcome.failure.message)
    if expected == 3 and left is None:
        assert "any actuator of press" in str(vanished(status, left, [], "press", running=True, safe=False).failure)
    if status < 0:
        assert outcome.unsafe is not safe
        advice = "the next start may need --acknowledge" if safe else "inspect the machine"
        assert advice in str(outcome.failure)
        assert ("after the control process had ended" in str(outcome.failure)) is (left is not None)
        assert ("all ended without resetting the actuators" in str(outcome.failure)) is (left is None)


@pytest.mark.full
@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root is granted a priority")
def test_the_child_that_resets_stands_below_the_guardian_so_that_a_driver_that_loops_cannot_starve_it(
    tmp_path: Path, cells: Cells
) -> None:
    wiring = process_box.wiring(tmp_path / "box", type="helpers.process_box:NotesPriority", process={"priority": 60})
    run = Run(wiring, "forever").until_running()
    if not os.sched_getparam(run.guardian).sched_priority:
        pytest.skip("not granted here")
    assert os.sched_getparam(run.guardian).sched_priority == 61
    os.kill(run.control, signal.SIGKILL)
    run.outcome()
    assert cells.numbers[process_box.PRIORITY] == 60
