"""Snapshots by fork: a process goes on from each, nothing is left over, and what is lost is told."""

from __future__ import annotations

import json
import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from umo.recording.replay import snapshots
from umo.recording.replay.snapshots import MOST, START, Runner, SnapshotList

pytestmark = [
    pytest.mark.full,
    pytest.mark.skipif(not sys.platform.startswith("linux"), reason="snapshots are forks of Linux"),
]
STEP = 10
"""Periods between two snapshots."""


class Counting:
    """A replay that counts its periods, and goes to each of some in turn."""

    def __init__(self, out: Path, goals: list[int], at_goal: Callable[[Runner], object] = lambda runner: None) -> None:
        self.out, self.goals, self.at_goal = out, goals, at_goal
        self.seen: list[int] = []

    def begin(self, runner: Runner) -> int:
        period = START
        self._snapshot(runner, period)
        while self.goals:
            period += 1
            self.seen.append(period)
            if period == self.goals[0]:
                self._told(runner, period)
                self.goals = self.goals[1:]
                if self.goals and self.goals[0] <= period:
                    nearest = max(each for each in runner.known if each < self.goals[0])
                    runner.go(period=nearest, goals=self.goals)
            if period % STEP == STEP - 1:
                self._snapshot(runner, period)
        return 7

    def _snapshot(self, runner: Runner, period: int) -> None:
        if period not in runner.known:
            runner.snapshot(period, float(period))
            orders, runner.orders = runner.orders, {}
            self.goals = orders.get("goals", self.goals)

    def _told(self, runner: Runner, period: int) -> None:
        row = {
            "period": period,
            "whole": self.seen == list(range(period + 1)),
            "descriptors": len(os.listdir("/proc/self/fd")),
            "known": len(runner.known),
            "group": len(children_of_all()),
        }
        with self.out.open("a") as file:
            file.write(json.dumps(row) + "\n")
        self.at_goal(runner)


def children_of_all() -> list[int]:
    """The processes of this group, and those that have ended and were not waited for."""
    group, found = os.getpgrp(), []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            rest = stat.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(rest[2]) == group:
            found.append(int(stat.parent.name))
    return found


def counted(out: Path, goals: list[int], at_goal: Any = lambda runner: None) -> tuple[int, list[dict[str, Any]]]:
    """The exit status of such a replay, and what it told; in a group of processes of its own, of which none is left."""
    child = os.fork()
    if child == 0:
        status = 99
        try:
            os.setpgid(0, 0)
            before = len(os.listdir("/proc/self/fd"))
            listed = SnapshotList()
            status = listed.run(Counting(out, goals, at_goal).begin)
            status = status if len(os.listdir("/proc/self/fd")) == before else 98
        finally:
            os._exit(status)
    _, status = os.waitpid(child, 0)
    assert not alive(child)
    rows = [json.loads(row) for row in out.read_text().splitlines()] if out.exists() else []
    return os.waitstatus_to_exitcode(status), rows


def alive(group: int) -> bool:
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.fixture
def out(tmp_path: Path) -> Path:
    return tmp_path / "rows"


def test_each_process_that_goes_on_has_the_memory_of_its_snapshot(out: Path) -> None:
    goals = [55, 12, 54, 3, 0, 70, 70, 69]
    status, rows = counted(out, goals)
    assert status == 7
    assert [row["period"] for row in rows] == goals and all(row["whole"] for row in rows)


def test_the_last_snapshots_and_the_first_one_are_kept_and_descriptors_and_processes_do_not_add_up(out: Path) -> None:
    goals = [25, *(each for n in range(40, 640, 40) for each in (n + 25, n - 15))]
    status, rows = counted(out, goals)
    assert status == 7 and [row["period"] for row in rows] == goals
    assert len({row["descriptors"] for row in rows}) == 1
    assert max(row["group"] for row in rows) <= 2 * MOST, rows  # with those that end just now, and their list


def test_a_process_outlives_all_snapshots_but_its_own(out: Path) -> None:
    """It would be ended with the snapshot that it comes from."""
    far = STEP * (MOST + 5)
    status, rows = counted(out, [25, 15, far, far + STEP * MOST, 5])
    assert status == 7 and [row["period"] for row in rows] == [25, 15, far, far + STEP * MOST, 5]


def test_a_process_that_is_killed_ends_all_and_is_told(out: Path, capfd: pytest.CaptureFixture[str]) -> None:
    status, _ = counted(out, [25, 40], lambda runner: os.kill(os.getpid(), signal.SIGKILL))
    assert status == 1
    assert "the process of the replay has been ended" in capfd.readouterr().err


def test_a_snapshot_that_was_killed_is_replaced_by_an_earlier_one(out: Path) -> None:
    def kill(runner: Runner) -> None:
        for child in runner._children[-1:]:  # the snapshot of period 49
            os.kill(child, signal.SIGKILL)

    status, rows = counted(out, [55, 52], kill)
    assert status == 7 and [row["period"] for row in rows] == [55, 52]


def test_without_room_for_another_process_there_is_no_snapshot(out: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fork, calls = os.fork, [0]

    def forked() -> int:
        calls[0] += 1
        if calls[0] > 4:
            raise BlockingIOError("no room")
        return fork()

    child = fork()
    if child == 0:
        status = 99
        try:
            monkeypatch.setattr(snapshots.os, "fork", forked)
            status = SnapshotList().run(Counting(out, [95]).begin)
        finally:
            os._exit(status)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 7
    (row,) = map(json.loads, out.read_text().splitlines())
    assert row["known"] == 3 and row["whole"]
