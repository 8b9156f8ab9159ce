"""Why a period was missed: each cause is provoked once in a real control process, and named rightly."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from helpers import process_box
from helpers.machines import Bench, bench, wired
from helpers.runs import Run
from umo import connect, published
from umo.process.frames import Reader, blackbox
from umo.process.frames.causes import Cause, Evidence, MissCause, always_slow, explain_all, sentences, split
from umo.process.frames.layout import Layout
from umo.system import realtime
from umo.testing import Scripted, VirtualTimer
from umo_command.show.why import why

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="processes of their own need Linux")


@pytest.fixture(autouse=True)
def every_miss(monkeypatch: pytest.MonkeyPatch) -> None:
    """A box for every miss: on a busy computer there are others than the one provoked."""
    monkeypatch.setattr("umo.process.frame_watcher.BLACK_BOX_INTERVAL", 0.0)
    monkeypatch.setattr("umo.process.frames.blackbox.MAX_BOXES", 1000)


def longest(wiring: dict[str, Any], application: str, cause: Cause) -> MissCause:
    """The verdict on the longest of the delays from this cause that the black boxes of a run hold. There may be others:
    these computers are shared."""
    outcome = Run(wiring, application).outcome()
    assert outcome.status == 0, outcome
    found = []
    for path in blackbox.boxes(blackbox.folder()):
        with Reader(path) as reader:
            frames = reader.read()
            found += explain_all(frames, reader.layout)
    named = [verdict for verdict in found if verdict.cause is cause]
    assert named, f"not named among {found}"
    return max(named, key=lambda verdict: verdict.excess)


def patient(folder: Path, **options: Any) -> dict[str, Any]:
    return process_box.wiring(folder / "box", process=options)


@pytest.mark.full
def test_a_slow_driver_is_named(tmp_path: Path) -> None:
    wiring = patient(tmp_path)
    wiring["drivers"]["box"]["type"] = "helpers.process_box:Slow"
    verdict = longest(wiring, "slow_driver", Cause.DRIVER)
    took = re.fullmatch(r"driver box took (.+) ms \(sample\)", verdict.text)
    assert took, verdict.text
    assert float(took[1]) >= 20.0


@pytest.mark.full
def test_a_collection_is_named(tmp_path: Path) -> None:
    verdict = longest(patient(tmp_path), "collection", Cause.COLLECTION)
    assert "a collection ran for" in verdict.text


@pytest.mark.full
def test_page_faults_are_named(tmp_path: Path) -> None:
    verdict = longest(patient(tmp_path), "page_faults", Cause.PAGE_FAULTS)
    assert "page faults" in verdict.text


@contextmanager
def busy_neighbours(cpu: int, count: int = 2) -> Iterator[None]:
    code = f"import os, ctypes\nctypes.CDLL(None).prctl(1, 9)\nos.sched_setaffinity(0, {{{cpu}}})\nprint(flush=True)\n"
    command = [sys.executable, "-c", code + "while True: pass"]
    neighbours = [subprocess.Popen(command, stdout=subprocess.PIPE) for _ in range(count)]
    try:
        for neighbour in neighbours:
            assert neighbour.stdout is not None
            neighbour.stdout.readline()
        yield
    finally:
        for neighbour in neighbours:
            neighbour.kill()
            neighbour.communicate()


@pytest.mark.full
def test_a_busy_neighbour_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without real-time scheduling, on the core of others that want all of it."""
    refused = realtime.Refusal("no real-time scheduling", "not in this test", "-")
    monkeypatch.setattr(realtime, "use_fifo", lambda priority: refused)
    cpu = min(os.sched_getaffinity(0))
    with busy_neighbours(cpu):
        verdict = longest(patient(tmp_path, cpu=cpu), "half_busy", Cause.PREEMPTED)
    assert "preempted for" in verdict.text


def test_umo_why_prints_the_last_box(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # which has no runs/, as the folder of make demo has
    wiring = patient(tmp_path)
    wiring["drivers"]["box"]["type"] = "helpers.process_box:Slow"
    longest(wiring, "slow_driver", Cause.DRIVER)
    assert why(None, False, None) == 0
    assert "a period was missed" in capsys.readouterr().out
    for path in blackbox.boxes(blackbox.folder()):
        assert why(None, False, path) == 0
    said = capsys.readouterr().out
    assert re.search(r"driver box took \d", said)
    assert "sample box, µs" in said


def test_a_run_that_failed_leaves_a_black_box_of_its_end_however_short_it_was(tmp_path: Path) -> None:
    outcome = Run(patient(tmp_path), "fail_at").outcome()
    assert outcome.status == 1
    boxes = [Reader(path) for path in blackbox.boxes(blackbox.folder())]
    (last,) = [box for box in boxes if box.about["reason"] != "a period was missed"]
    assert "a mistake in the application" in last.about["reason"]
    assert last.read()["number"][-1] >= 4
    for box in boxes:
        box.close()


# From figures made by hand ------------------------------------------------------------------------------

LAYOUT = Layout((), ("timer", "sample io", "control", "update io"), {})
MS = 1_000_000


def frames_with(row: int, **changes: Any) -> Any:
    """Thirty periods as they should be, but for what happens in the one before `row` reports a miss."""
    frames = np.zeros(30, LAYOUT.dtype)
    frames["began"] = np.arange(30) * MS
    frames["phases"] = [900_000, 10_000, 20_000, 10_000]
    frames["execution"] = 40_000
    frames["wake"] = 30_000
    frames["missed"][row] = 3
    frames["counted"] = np.arange(30)
    for name, value in changes.items():
        if name in ("sample", "control", "update"):
            frames["phases"][row - 1][("", "sample", "control", "update").index(name)] = value
            frames["execution"][row - 1] += value
        elif name == "wake":
            frames["wake"][row - 1] = value
        else:
            frames[name][row - 1 :] += value
    return frames


@pytest.mark.parametrize(
    ("changes", "cause", "text"),
    [
        ({"sample": 3_100_000}, Cause.DRIVER, "driver io took 3.1 ms (sample)"),
        ({"update": 3_100_000}, Cause.DRIVER, "driver io took 3.1 ms (update)"),
        ({"control": 5 * MS}, Cause.CONTROL, "control code took 5 ms"),
        ({"control": 5 * MS, "run_queue_wait": 4_900_000}, Cause.PREEMPTED, "preempted for 4.9 ms"),
        ({"sample": 5 * MS, "collections": 1, "collecting": 4 * MS}, Cause.COLLECTION, "a collection ran for 4 ms"),
        ({"control": 5 * MS, "minor_faults": 9000}, Cause.PAGE_FAULTS, "9000 page faults"),
        ({"control": 5 * MS, "minor_faults": 16, "in_kernel": 4 * MS}, Cause.PAGE_FAULTS, "16 page faults"),
        ({"control": 5 * MS, "in_kernel": 4 * MS}, Cause.CONTROL, "control code took"),
        ({"control": 5 * MS, "major_faults": 2}, Cause.PAGE_FAULTS, "2 page faults, 2 of them from disk"),
        ({"wake": 5 * MS}, Cause.WAKE, "the timer woke 5 ms late"),
        ({"wake": 5 * MS, "run_queue_wait": 5 * MS}, Cause.PREEMPTED, "preempted for 5 ms"),
        ({"control": 5 * MS, "collections": 1, "collecting": 1000}, Cause.CONTROL, "control code took"),
    ],
)
def test_the_largest_excess_and_its_counters_decide(changes: dict[str, int], cause: Cause, text: str) -> None:
    verdict = Evidence(frames_with(20, **changes), LAYOUT).explain(20)
    assert (verdict.cause, verdict.missed) == (cause, 3)
    assert text in verdict.text


@pytest.mark.parametrize("cause", [Cause.PREEMPTED, Cause.CONTROL])
def test_what_is_usual_between_two_readings_of_the_counters_is_no_cause(cause: Cause) -> None:
    """They are read every ten periods, in each of which the thread waits for its processor for 0.3 ms, and in the one
    that took long."""
    frames = frames_with(20, control=3 * MS)
    read = [0, 5, 9, 19, 29]
    frames["counted"] = [max(each for each in read if each <= row) for row in range(30)]
    frames["run_queue_wait"] = frames["counted"] * 300_000
    if cause is Cause.PREEMPTED:
        frames["run_queue_wait"][19:] += 2 * MS
    verdict = Evidence(frames, LAYOUT).explain(20)
    assert verdict.cause is cause
    if cause is Cause.PREEMPTED:
        assert verdict.text.startswith("preempted for 2.3 ms")


def test_a_driver_that_is_away_and_was_tried_is_named_and_told_only_where_it_was_tried() -> None:
    layout = Layout((), ("timer", "try io", "control"), {"period": 0.001})
    frames = np.zeros(30, layout.dtype)
    frames["began"] = np.arange(30) * MS
    frames["phases"], frames["execution"], frames["counted"] = [900_000, 0, 20_000], 20_000, np.arange(30)
    assert "try io" not in split(frames, layout)
    frames["missed"][20], frames["phases"][19][1], frames["execution"][19] = 3, 3 * MS, 3 * MS + 20_000
    assert "try io" in split(frames, layout)
    verdict = Evidence(frames, layout).explain(20)
    assert (verdict.cause, verdict.text) == (
        Cause.DRIVER,
        "driver io took 3 ms (the driver is away, and umo looked for its device)",
    )


@pytest.mark.parametrize(
    ("phase", "cause", "text"),
    [
        ("control oven", Cause.CONTROL, "control code of oven took 3 ms"),
        ("sample io for oven", Cause.DRIVER, "driver io for oven took 3 ms (sample)"),
    ],
)
def test_a_part_at_a_rate_of_its_own_is_named(phase: str, cause: Cause, text: str) -> None:
    layout = Layout((), (*LAYOUT.phases, phase), {})
    frames = np.zeros(30, layout.dtype)
    plain = frames_with(20)
    for name in ("began", "execution", "wake", "missed", "counted"):
        frames[name] = plain[name]
    frames["phases"][:, :4] = plain["phases"]
    frames["phases"][19][4] = 3 * MS
    frames["execution"][19] += 3 * MS
    verdict = Evidence(frames, layout).explain(20)
    assert (verdict.cause, verdict.text) == (cause, text)


def test_a_second_miss_from_one_long_period_has_the_cause_of_the_first() -> None:
    layout = Layout((), LAYOUT.phases, {"period": 0.001})
    frames = frames_with(20, sample=3_100_000)
    frames["missed"][21] = 1
    verdict = Evidence(frames, layout).explain(21)
    assert (verdict.cause, verdict.missed) == (Cause.DRIVER, 1)
    assert verdict.text == "still late: driver io took 3.1 ms (sample)"
    frames["phases"][20][2] = 2 * MS  # control: late by itself
    assert Evidence(frames, layout).explain(21).cause is Cause.CONTROL


def test_periods_that_are_all_too_long_are_explained_one_by_one() -> None:
    layout = Layout((), LAYOUT.phases, {"period": 0.001})
    frames = frames_with(20)
    frames["missed"][:] = 1
    last = len(frames) - 1
    verdict = Evidence(frames, layout).explain(last)
    assert (verdict.cause, verdict.row) == (Cause.UNKNOWN, last)
    assert verdict.text == "still late: the periods before it are not in this file"


def test_the_first_rows_have_no_past() -> None:
    frames = frames_with(1)
    assert [verdict.row for verdict in explain_all(frames, LAYOUT)] == [1]
    assert Evidence(frames, LAYOUT).explain(1).cause is Cause.UNKNOWN


# Always too slow ----------------------------------------------------------------------------------------

TEN_MS = Layout((), ("timer", "sample io", "control", "update io", "control oven"), {"period": 0.01})


def slow_frames(late: float = 1.0, count: int = 100, first: int = 0, **phases: float) -> Any:
    """Periods of 10 ms, of which so many, from the row `first` on, take these times in ms; `oven` is a part of its own.
    The timer returns at once where they do."""
    frames = np.zeros(count, TEN_MS.dtype)
    slow = (np.arange(count) % 100 < 100 * late) & (np.arange(count) >= first)
    names = {"sample": 1, "control": 2, "update": 3, "oven": 4}
    for name, place in names.items():
        usual = 0.02 if name == "control" else 0.0
        frames["phases"][:, place] = np.where(slow, phases.get(name, usual), usual) * MS
    frames["execution"] = frames["phases"].sum(axis=1)
    frames["missed"][1:] = slow[:-1]
    frames["wake"] = np.where(frames["missed"] > 0, 5 * MS, 30_000)
    lasted = np.where(slow, frames["execution"], 10 * MS)
    frames["began"] = np.append(0, np.cumsum(lasted)[:-1])
    frames["counted"] = np.arange(count)
    return frames


@pytest.mark.parametrize("late", [1.0, 0.9, 0.6, 0.3, 0.02])
def test_control_code_that_is_too_slow_is_named_however_often_it_is(late: float) -> None:
    verdicts = explain_all(slow_frames(late, control=15.0), TEN_MS)
    assert verdicts
    assert {verdict.cause for verdict in verdicts} == {Cause.CONTROL}, verdicts
    assert verdicts[-1].text == "control code took 15 ms"


@pytest.mark.parametrize(
    ("phases", "told"),
    [
        ({"control": 15.0}, "control code 15 ms"),
        ({"control": 4.0, "oven": 9.0}, "control code of oven 9 ms, control code 4 ms"),
        ({"sample": 8.0, "control": 3.0}, "driver io (sample) 8 ms, control code 3 ms"),
        ({"update": 12.0}, "driver io (update) 12 ms"),
    ],
)
def test_what_is_always_too_slow_is_told_with_the_times_of_its_parts(phases: dict[str, float], told: str) -> None:
    said = always_slow(slow_frames(1.0, **phases), TEN_MS)
    assert said == f"too slow for the period of 10 ms: 100% of 99 periods are late; usual times: {told}"
    assert sentences(slow_frames(1.0, **phases), TEN_MS, [], 3) == [said]


def test_what_has_become_slow_is_told_as_soon_as_most_periods_are_late() -> None:
    assert always_slow(slow_frames(1.0, first=70, control=15.0), TEN_MS) == ""
    assert always_slow(slow_frames(1.0, first=40, control=15.0), TEN_MS).endswith("control code 15 ms")


def test_control_code_that_hardly_fits_is_told_before_it_is_late() -> None:
    frames = slow_frames(1.0, control=9.0)
    frames["missed"][:] = 0
    assert always_slow(frames, TEN_MS) == (
        "hardly within the period of 10 ms: 0% of 99 periods are late; usual times: control code 9 ms"
    )


def test_control_code_that_others_keep_from_running_is_told_so() -> None:
    frames = slow_frames(1.0, control=15.0)
    frames["run_queue_wait"] = np.arange(100) * 9 * MS
    assert always_slow(frames, TEN_MS).endswith(
        "control code 15 ms; for 9 ms of this time, other processes used the core"
    )
    assert {verdict.cause for verdict in explain_all(frames, TEN_MS)[2:]} == {Cause.PREEMPTED}


def test_late_periods_that_took_no_time_and_few_periods_are_not_said_to_be_slow() -> None:
    frames = slow_frames(1.0, control=0.02)
    assert (frames["missed"][1:] == 1).all()
    assert always_slow(frames, TEN_MS) == ""
    assert always_slow(slow_frames(1.0, count=5, control=15.0), TEN_MS) == ""
    assert always_slow(slow_frames(1.0, control=15.0), Layout((), TEN_MS.phases, {})) == ""


def test_a_black_box_holds_several_periods_after_a_missed_one_if_they_are_not_long() -> None:
    assert [blackbox.aftermath(period) for period in (0.0, 0.001, 0.01, 0.05, 1.0)] == [0.05, 0.05, 0.2, 1.0, 1.0]


class Busy(Bench):
    """Its control code takes 3 ms in each period of 1 ms."""

    def control(self) -> None:
        until = time.monotonic_ns() + 3 * MS
        while time.monotonic_ns() < until:
            pass


def test_umo_why_of_control_code_that_is_always_too_slow(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    machine = bench(Busy)
    connection = connect(machine, wired(machine, Scripted(), clock=VirtualTimer([0] + [3] * 30)))
    with connection as m, published(connection, "busy", "rig") as ring:
        for _ in range(15):
            m.timer.read()
            m.sample()
            m.control()
            m.update()
        assert ring.path is not None
        with Reader(ring.path) as reader:
            blackbox.save(reader, tmp_path / "a.box", blackbox.MISSED_PERIOD)
    assert why(None, False, tmp_path / "a.box") == 0
    said = " ".join(capsys.readouterr().out.split())
    slow = r"too slow for the period of 1 ms: 100% of 14 periods are late; usual times: control code \d"
    assert re.search(slow, said)
    assert "unknown" not in said
    assert "python -m cProfile -s tottime $(which umo) run busy" in said
