"""The history of alarms: bounded, over restarts, and whatever is torn or foreign costs only itself."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from umo.alarms import alarm_file
from umo.alarms.alarm_file import AlarmRecord
from umo.cycle.events import ALARM, FAULT, Event
from umo.errors import UmoError
from umo.frames.alarm_history import AlarmHistory


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


def test_changes_of_alarms_are_noted_and_no_other_events(file: Path) -> None:
    said: list[Any] = []
    events = [
        Event(3.0, "tank.full", "returned (high): x", asked=ALARM),
        Event(3.0, "tank", "in fault: x", asked=FAULT),
    ]
    AlarmHistory("vat", said.append, lambda: 1e9).append(events)
    assert alarm_file.read(file) == [AlarmRecord(1e9, 3.0, "tank.full", "returned (high): x", "")]
    assert said == []


def test_a_history_that_cannot_be_written_is_told_once(file: Path) -> None:
    file.mkdir()
    said: list[Any] = []
    noting = AlarmHistory("vat", said.append)
    for _ in range(3):
        noting.append([Event(3.0, "tank.full", "x", asked=ALARM)])
    assert len(said) == 1
    assert "the history of alarms is no longer written: " in said[0]
