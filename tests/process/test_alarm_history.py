"""The history of alarms: bounded, over restarts, and whatever is torn or foreign costs only itself."""

from __future__ import annotations

import json
import stat
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from umo.cycle.events import ALARM, FAULT, Event
from umo.errors import UmoError
from umo.operation.alarms import alarm_file
from umo.operation.alarms.alarm_file import AlarmRecord
from umo.process.alarm_history import LOST, AlarmHistory
from umo.process.frames.run_reader import NumberedEvent

fcntl = pytest.importorskip("fcntl")


def record(number: int, text: str = "unacknowledged (high): too full") -> AlarmRecord:
    return AlarmRecord(1.0e9 + number, float(number), f"tanks.{number}.full", text, "ann")


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("UMO_STATE", str(tmp_path))
    return alarm_file.file_of("vat")


def test_what_was_written_is_read_in_order(file: Path) -> None:
    assert alarm_file.read(file) == []
    alarm_file.append(file, [record(0), record(1)])
    alarm_file.append(file, [record(2)])
    assert alarm_file.read(file) == [record(0), record(1), record(2)]


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the sticky bit of a file")
def test_an_old_history_is_left_alone_by_what_cleans_var_tmp(file: Path) -> None:
    alarm_file.append(file, [record(0)])
    assert stat.S_IMODE(file.stat().st_mode) == 0o1644


def test_two_generations_are_kept_and_no_more(file: Path) -> None:
    long = "x" * 1000
    for number in range(4 * alarm_file.MAX_BYTES // 1000):
        alarm_file.append(file, [record(number, long)])
    sizes = [each.stat().st_size for each in file.parent.iterdir()]
    assert len(sizes) == 2
    assert max(sizes) <= alarm_file.MAX_BYTES
    numbers = [each.time for each in alarm_file.read(file)]
    assert numbers == sorted(numbers)
    assert numbers[-1] == 4 * alarm_file.MAX_BYTES // 1000 - 1


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="limits of files as on Linux")
def test_a_disk_that_becomes_full_is_told_and_takes_no_half_of_the_changes(file: Path) -> None:
    resource = pytest.importorskip("resource")
    alarm_file.append(file, [record(0)])
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (file.stat().st_size + 150, before[1]))
    try:
        with pytest.raises(OSError, match="File too large"):
            alarm_file.append(file, [record(1), record(2)])
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert alarm_file.read(file) == [record(0)]
    alarm_file.append(file, [record(1), record(2)])
    assert alarm_file.read(file) == [record(0), record(1), record(2)]


def test_a_writer_that_waited_while_another_began_a_new_generation_writes_to_that(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    long, flock = "x" * 1000, fcntl.flock
    for number in range(alarm_file.MAX_BYTES // 1100):
        alarm_file.append(file, [record(number, long)])

    def meanwhile(stream: Any, operation: int) -> None:
        monkeypatch.setattr(fcntl, "flock", flock)
        for number in range(500, 700):
            alarm_file.append(file, [record(number, long)])
        flock(stream, operation)

    before = alarm_file.read(file)
    monkeypatch.setattr(fcntl, "flock", meanwhile)
    alarm_file.append(file, [record(1000, long)])
    assert alarm_file.read(file) == [*before, *(record(number, long) for number in [*range(500, 700), 1000])]


def test_a_file_that_is_cut_at_any_byte_loses_the_cut_record_only(file: Path) -> None:
    alarm_file.append(file, [record(0), record(1)])
    whole = file.read_bytes()
    first = whole.index(b"\n")
    for size in range(len(whole)):
        file.write_bytes(whole[:size])
        alarm_file.append(file, [record(2)])
        left = [record(0)] * (size >= first) + [record(1)] * (size == len(whole) - 1)
        assert alarm_file.read(file) == [*left, record(2)], size


@pytest.mark.parametrize(
    "line",
    [b"", b"\xff\xfe", b"[]", b"3", b"{}", b"null", b"[" * 100_000, json.dumps({"when": float("nan")}).encode()]
    + [json.dumps(record(0)._asdict() | wrong).encode() for wrong in ({"when": "x"}, {"path": 3}, {"time": 1e999})],
)
def test_a_foreign_line_is_passed_over(file: Path, line: bytes) -> None:
    file.write_bytes(line + b"\n")
    alarm_file.append(file, [record(1)])
    assert alarm_file.read(file) == [record(1)]


def test_a_folder_in_its_place_is_said(file: Path) -> None:
    file.mkdir()
    with pytest.raises(UmoError, match="cannot be read: Is a directory"):
        alarm_file.read(file)


def test_the_name_of_a_station_leads_out_of_no_folder(file: Path) -> None:
    for name in ("../../etc/passwd", "/etc/passwd", "..", "", "a\0b", "x" * 1000):
        assert alarm_file.file_of(name).parent == file.parent


FRAME = {"began": 100_000_000_000, "utc": 900_000_000_000, "time": 10.0}
"""A frame at 10 s of the cycle's clock, 1000 s after 1970."""
ALARM_CHANGE = Event(3.0, "tank.full", "returned (high): x", who="ann", asked=ALARM)


def frames(*events: Event, alarms: tuple[Any, ...] = ("tank.full",)) -> Any:
    """A reader that has these events."""
    return SimpleNamespace(
        about={"station": "vat"},
        layout=SimpleNamespace(alarms=alarms),
        events=lambda start: [NumberedEvent(*each) for each in enumerate(events)][start:],
    )


def test_changes_of_alarms_are_noted_with_their_utc_and_no_other_events(file: Path) -> None:
    history = AlarmHistory()
    history.take(frames(ALARM_CHANGE, Event(3.0, "tank", "in fault: x", asked=FAULT)), FRAME)
    assert alarm_file.read(file) == [AlarmRecord(993.0, 3.0, "tank.full", "returned (high): x", "ann")]
    assert history.next == 2


def test_a_change_is_noted_once(file: Path) -> None:
    history = AlarmHistory()
    history.take(frames(ALARM_CHANGE), FRAME)
    history.take(frames(ALARM_CHANGE), FRAME)
    history.take(frames(ALARM_CHANGE, ALARM_CHANGE), FRAME)
    assert len(alarm_file.read(file)) == 2


def test_events_that_were_gone_leave_a_line_with_their_number(file: Path) -> None:
    reader = frames(*[ALARM_CHANGE] * 9)
    events = reader.events
    reader.events = lambda start: events(max(start, 5))  # of the others nothing is left
    history = AlarmHistory(2)
    history.take(reader, FRAME)
    first, *others = alarm_file.read(file)
    assert first == AlarmRecord(993.0, 3.0, "", LOST.format(3), "")
    assert (len(others), history.next) == (4, 9)


def test_a_station_without_alarms_has_no_history(file: Path) -> None:
    AlarmHistory().take(frames(ALARM_CHANGE, alarms=()), FRAME)
    assert not file.exists()


def test_changes_that_could_not_be_written_are_written_with_the_next(file: Path) -> None:
    history = AlarmHistory()
    file.mkdir()
    with pytest.raises(IsADirectoryError):
        history.take(frames(ALARM_CHANGE), FRAME)
    file.rmdir()
    history.take(frames(ALARM_CHANGE, ALARM_CHANGE), FRAME)
    assert len(alarm_file.read(file)) == 2
