"""A guardian that needs nothing it does not have, believes nothing, and never stops short of resetting."""

from __future__ import annotations

import json
import os
import signal
import sys
from pathlib import Path
from typing import Any, cast

import pytest

import process_box
from machines import bench, wired
from process_box import Cells
from test_hold import Board, on
from test_process import Run, assert_safe, standing
from umo import DeviceTimeout, DriverError, connect
from umo.cycle import transfer
from umo.process import control, guardian, reset
from umo.process.board import Board as ResetBoard
from umo.process.board import Reached
from umo.process.control import Control
from umo.process.job import Job
from umo.process.life import LARGEST, Life
from umo.process.messages import MessageSocket
from umo.process.outcome import Failed, Outcome, plain
from umo.process.reset import Resetter
from umo.system.custody import Custody
from umo.testing import Scripted, periods
from umo.wiring import resolve

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="processes of their own need Linux")


@pytest.fixture
def cells(tmp_path: Path) -> Cells:
    return Cells(tmp_path / "box")


@pytest.fixture(autouse=True)
def soon(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a device may still have under way is over at once."""
    monkeypatch.setattr(transfer, "SETTLE", 0.01)


# What a control process says ----------------------------------------------------------------------------


@pytest.mark.parametrize("what", ["much", "a_file", "the_machine", "the_unshowable"])
def test_what_an_application_returns_cannot_change_how_a_run_ends(tmp_path: Path, cells: Cells, what: str) -> None:
    outcome = Run(process_box.wiring(tmp_path / "box"), f"returns_{what}").outcome()
    assert (outcome.status, outcome.unsafe) == (0, False)
    assert isinstance(outcome.result, str)
    assert len(json.dumps(outcome.dump())) < 65_536
    assert_safe(cells)


def test_an_exception_with_an_endless_message_is_reported_in_a_bounded_one(tmp_path: Path, cells: Cells) -> None:
    outcome = Run(process_box.wiring(tmp_path / "box"), "fails_at_length").outcome()
    assert outcome.failure is not None
    assert outcome.failure.message.startswith("ValueError: xxxxx")
    assert len(outcome.encode()) < LARGEST
    assert (outcome.status, outcome.unsafe) == (1, False)


def test_plain_results_pass_as_they_are() -> None:
    assert plain({"a": [1, 2.5, None, "text"]}) == {"a": [1, 2.5, None, "text"]}


def test_names_of_actuators_are_left_out_before_an_outcome_is_too_long() -> None:
    outcome = Outcome(Failed("StopError", "x", 3), unreached=[f"zones.{i}.heater" for i in range(100_000)])
    again = Outcome.decode(outcome.encode())
    assert again is not None
    assert again.status == 3


@pytest.mark.parametrize("text", [b"", b"{", b"null", b"[]", b'{"failure": 1}', b"\xff", b"[" * 60_000])
def test_what_is_not_an_outcome_is_none(text: bytes) -> None:
    assert Outcome.decode(text) is None


def test_a_broken_report_is_a_reason_to_step_in(tmp_path: Path, cells: Cells, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Outcome, "encode", lambda self: b"{")
    outcome = Run(process_box.wiring(tmp_path / "box")).outcome()
    assert outcome.failure is not None
    assert "without resetting the machine; the guardian reset every actuator" in outcome.failure.message
    assert_safe(cells)


def test_a_control_process_that_closes_every_descriptor_is_reset_and_reported(tmp_path: Path, cells: Cells) -> None:
    """Finding F.1: its own connections and pipes are gone, the outputs stood energised."""
    outcome = Run(process_box.wiring(tmp_path / "box", descriptor=True), "closes_everything").outcome()
    assert outcome.status == 1
    assert outcome.unreached == []
    assert_safe(cells)


# A guardian short of everything ---------------------------------------------------------------------------


def test_without_a_child_the_guardian_resets_the_machine_itself(
    tmp_path: Path, cells: Cells, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Resetter, "stand_by", lambda self: None)
    monkeypatch.setattr(Resetter, "_begin", lambda self, numbers: False)
    run = Run(process_box.wiring(tmp_path / "box"), "forever").until_running()
    os.kill(run.control, signal.SIGKILL)
    outcome = run.outcome()
    assert outcome.failure is not None
    assert "the guardian reset every actuator" in outcome.failure.message
    assert_safe(cells)


def test_a_guardian_that_fails_itself_resets_the_machine(
    tmp_path: Path, cells: Cells, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(self: guardian.Guardian) -> None:
        raise MemoryError("no room")

    monkeypatch.setattr(guardian.Guardian, "_listen", fail)
    outcome = Run(process_box.wiring(tmp_path / "box"), "forever").outcome()
    assert outcome.failure is not None
    assert "the guardian failed: MemoryError: no room" in outcome.failure.message
    assert_safe(cells)


def test_a_driver_that_hangs_in_the_guardian_itself_is_interrupted(
    tmp_path: Path, cells: Cells, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reset, "GRACE", 0.1)
    machine = process_box.machine()
    wired_up = resolve(machine, process_box.wiring(tmp_path / "box", at=2, action="hang"))
    resetter = Resetter(machine, wired_up)
    monkeypatch.setattr(Resetter, "_begin", lambda self, numbers: False)
    cells.numbers[process_box.LEVELS] = 500
    assert resetter.reset(resetter.paths, 5.0) == {}
    assert_safe(cells)


# Asking and watching --------------------------------------------------------------------------------------


def test_a_guardian_that_is_stopped_is_noticed_and_the_machine_stops_by_itself(tmp_path: Path, cells: Cells) -> None:
    run = Run(process_box.wiring(tmp_path / "box", process={"hang_timeout": "200 ms"}), "forever").until_running()
    os.kill(run.guardian, signal.SIGSTOP)
    outcome = run.outcome()
    assert outcome.failure is not None
    assert "no sign of life from the guardian for " in outcome.failure.message
    assert (outcome.status, outcome.unsafe) == (1, True)
    assert_safe(cells)
    assert len(standing()) == 1


def test_a_signal_that_the_application_ignores_is_asked_again_in_shared_memory(tmp_path: Path, cells: Cells) -> None:
    run = Run(process_box.wiring(tmp_path / "box"), "deaf").until_running()
    run.channel.send("stop", signal=signal.SIGINT)
    outcome = run.outcome()
    assert (outcome.status, outcome.stopped_by) == (130, signal.SIGINT)
    assert_safe(cells)


def watched(gap: float = 0.0, asked: int = 0, unwatched: float = 0.0) -> Control:
    """A control process's look at itself, with what it finds."""

    class Found:
        def __init__(self) -> None:
            self.asked, self.unwatched = asked, unwatched

        def beat(self) -> float:
            return gap

    found = Control.__new__(Control)
    found._life, found._hang, found._alarm = cast(Life, Found()), 0.1, ""
    return found


def test_a_gap_longer_than_the_hang_limit_ends_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    stopped: list[object] = []
    monkeypatch.setattr(control, "request_stop", lambda number=None: stopped.append(number))
    one = watched(gap=3.0)
    one._each_period(cast(Any, None))
    assert stopped == [None]
    assert "no process ran for 3.0 s" in one._alarm
    watched(gap=0.05)._each_period(cast(Any, None))
    assert len(stopped) == 1
    watched(unwatched=0.6)._each_period(cast(Any, None))
    assert len(stopped) == 2
    watched(unwatched=0.4)._each_period(cast(Any, None))
    assert len(stopped) == 2


def test_the_last_messages_of_a_peer_that_left_ours_unread_are_received() -> None:
    """Finding A.2: such a socket gives ECONNRESET once, and the messages after it."""
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


def test_a_period_longer_than_the_limit_for_a_step_of_starting_does_not_count_as_hanging() -> None:
    life = guardian.Guardian.__new__(guardian.Guardian)
    life._life = Life()
    life._plan = cast(Any, type("P", (), {"wired": type("W", (), {"period": 60.0})}))
    assert life._limit() > 60.0


# Requests that were still under way -----------------------------------------------------------------------


def test_after_a_write_that_failed_everything_is_reset_a_second_time_later(tmp_path: Path) -> None:
    """Finding E.4: a device that stalled carried out the abandoned write after the reset had been confirmed."""
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
    assert sum(waited) == pytest.approx(transfer.settling(connection.wired))


def test_a_write_that_failed_on_a_simulated_circuit_costs_no_waiting() -> None:
    machine, box = bench(), Scripted()
    connection = connect(machine, wired(machine, box))
    connection.pause = lambda seconds: pytest.fail("it waited")
    with connection as m:
        box.at(len(box.calls), OSError("cut"))
        with pytest.raises(OSError):
            m.update()


# Resetting from outside -----------------------------------------------------------------------------------


def test_a_silent_device_gets_more_time_from_attempt_to_attempt(tmp_path: Path) -> None:
    """Finding E.10: a device that frees its one connection late was kept busy by the reconnecting."""
    machine = process_box.machine()
    resetter = Resetter(machine, resolve(machine, process_box.wiring(tmp_path / "box", timeout="100 ms")))
    found = []
    for _ in range(5):
        found.append(resetter._patience("box"))
        resetter._attempt += 1
    assert found == [0.1, 0.4, 1.6, 3.0, 3.0]


def test_a_board_keeps_what_was_reached_and_why_not() -> None:
    board = ResetBoard(["a", "b", "c"])
    board.note(0, None)
    board.note(1, "no route ü" * 100)
    assert [board.reached(i) for i in range(3)] == [Reached.YES, Reached.NO, Reached.UNTRIED]
    assert board.cause(1).startswith("no route ü")
    board.clear()
    assert board.reached(0) is Reached.UNTRIED


def test_the_starter_takes_the_guardians_status_where_its_last_words_were_lost() -> None:
    from umo.process.start import Started

    class Ended:
        def __init__(self, status: int) -> None:
            self._status = status

        def wait(self) -> int:
            return self._status

    def vanished(status: int) -> Outcome:
        started = Started.__new__(Started)
        started.pid = 1
        started._guardian = cast(Any, Ended(status))
        return started._vanished()

    assert vanished(0).status == 0
    assert vanished(143).status == 143
    assert vanished(1).status == 1
    assert "without resetting the actuators" in str(vanished(-9).failure)


def test_the_child_that_resets_stands_below_the_guardian_so_that_a_driver_that_loops_cannot_starve_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[tuple[int, int | None]] = []
    monkeypatch.setattr(guardian.realtime, "guard", lambda priority, cpu: asked.append((priority, cpu)))
    monkeypatch.syspath_prepend(str(Path(__file__).parent))
    wiring = process_box.wiring(tmp_path / "box", process={"priority": 60})
    plan = guardian.Plan(Job(machine="process_box:machine", wiring=wiring))
    here, there = MessageSocket.pair()
    watch = guardian.Guardian(plan, here, Custody([], "test"))
    watch._traces.close()
    watch._resetter._guard()
    assert asked == [(59, None)]  # `guard` gives one more than the priority of the control process
    there.close()
    here.close()
