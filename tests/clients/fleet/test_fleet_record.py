"""The history of a fleet: what is in its files is what the machines had."""

from __future__ import annotations

import errno
import json
import sys
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("zenoh", reason="the extra fleet is not installed")
pytest.importorskip("duckdb", reason="the extra fleet-history is not installed")
pytest.importorskip("pyarrow", reason="the extra fleet-history is not installed")

import pyarrow.parquet as pq

from helpers.fleet_histories import KnownRun, by_duckdb, rows
from helpers.fleets import PLANT, free_port
from umo.clients.fleet import fleet_record, fleet_record_files, fleet_record_source, run_feed
from umo.clients.fleet.fleet_keys import StationKey
from umo.clients.fleet.fleet_query import asked
from umo.clients.fleet.fleet_record import FleetRecorder, Incoming
from umo.clients.fleet.fleet_record_files import RecordFolder
from umo.clients.fleet.fleet_record_run import AWAY, BEFORE, FULL_DISK, LOST, UNDECLARED, FollowedRun, Recorded
from umo.clients.fleet.fleet_record_source import FleetSource, Put, key_pattern
from umo.clients.fleet.fleet_session import FleetNetwork, opened
from umo.errors import FramesError, OptionError

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="a fleet needs Linux")
HOUR = "2026-11-25T14"


def nothing(text: str) -> None:
    pass


def followed(known: KnownRun, *numbers: int, recorded: Recorded | None = None, declared: int | None = 0) -> FollowedRun:
    run = FollowedRun(known.run, recorded or Recorded())
    if declared is not None:
        run.take_declaration(known.declaration(declared))
    for number in numbers:
        run.take_delta(known.delta(number))
    return run


def numbers(run: FollowedRun) -> list[int]:
    return [each.number for each in run.taken]


def gaps(run: FollowedRun) -> list[tuple[str, int, int, str]]:
    return [(each.of, each.first, each.last, each.why) for each in run.gaps]


# Runs ------------------------------------------------------------------------------------------------------


def test_deltas_become_rows_with_exact_values_states_qualities_and_times() -> None:
    known = KnownRun()
    run = followed(known, *range(25))
    assert run.rows is not None
    table = run.rows.values(run.taken).to_pylist()
    level = [row for row in table if row["path"] == "level"]
    assert [row["value"] for row in level] == [number / 10 for number in range(25)]
    assert [row["number"] for row in level] == [row["delta"] for row in level] == list(range(25))
    limit = [(row["value"], row["state"], row["quality"]) for row in table if row["path"] == "limit"]
    assert limit[:2] == [(0.0, "PASS", "GOOD"), (1.0, "FAIL", "GOOD")]
    still = next(row for row in table if row["path"] == "still")
    assert (still["value"], still["state"], still["quality"]) == (None, None, "BAD")
    assert next(row["value"] for row in table if row["path"] == "tunable:gain") == 2.5
    assert level[3]["time"].timestamp() == 1_764_000_000.3
    assert level[0]["time_error"] == pytest.approx(5e-6)


def test_what_comes_twice_is_taken_once_and_what_is_missing_is_told_with_its_numbers() -> None:
    run = followed(KnownRun(), *range(5), 3, 4, 5, *range(20, 23), 21)
    assert numbers(run) == [0, 1, 2, 3, 4, 5, 20, 21, 22]
    assert gaps(run) == [("values", 6, 19, LOST)]


def test_deltas_that_come_before_the_declaration_are_kept() -> None:
    known = KnownRun()
    run = followed(known, *range(12), declared=None)
    assert run.needs_declaration
    assert not run.taken
    run.take_declaration(known.declaration(5))
    assert numbers(run) == list(range(12))
    assert not run.needs_declaration


def test_without_a_whole_one_the_image_of_the_declaration_is_where_it_begins() -> None:
    known = KnownRun()
    run = followed(known, *range(3, 9), declared=None)
    run.take_declaration(known.declaration(5))
    assert numbers(run) == [5, 6, 7, 8]
    assert gaps(run) == [("values", 0, 4, BEFORE)]


def test_a_hole_without_a_whole_one_waits_for_the_declaration_or_the_next_whole_one() -> None:
    known = KnownRun()
    run = followed(known, 0, 1, 2, 5, 6)
    assert run.needs_declaration
    run.take_declaration(known.declaration(6))
    run.take_delta(known.delta(7))
    assert numbers(run) == [0, 1, 2, 6, 7]
    run = followed(known, 0, 1, 2, 5, 6, *range(7, 12))
    assert numbers(run) == [0, 1, 2, 10, 11]
    assert gaps(run) == [("values", 3, 9, LOST)]


def test_a_run_that_is_not_declared_is_a_gap() -> None:
    run = followed(KnownRun(), *range(3, 9), declared=None)
    assert run.give_up()
    assert gaps(run) == [("values", 0, 8, UNDECLARED)]


def test_a_damaged_delta_that_waits_for_the_declaration_costs_no_other() -> None:
    known = KnownRun()
    run = followed(known, *range(5), declared=None)
    run.take_delta(known.delta(5)[:-1])
    for number in range(6, 12):
        run.take_delta(known.delta(number))
    with pytest.raises(FramesError):
        run.take_declaration(known.declaration(0))
    run.take_delta(known.delta(12))
    assert numbers(run) == [*range(5), 10, 11, 12]
    assert gaps(run) == [("values", 5, 9, LOST)]


def test_a_declaration_of_another_run_changes_nothing() -> None:
    run = followed(KnownRun(), 0, 1, declared=None)
    with pytest.raises(Exception, match="another run"):
        run.take_declaration(KnownRun(b"12345678").declaration(1))
    assert run.needs_declaration


def test_a_recorder_that_was_away_goes_on_after_its_last_number() -> None:
    known = KnownRun()
    recorded = Recorded(last={("values", known.name): 14, ("events", known.name): 2})
    run = followed(known, *range(7, 20), recorded=recorded)
    run.take_events(known.events(1, 2, 3)["events"])
    assert numbers(run) == [15, 16, 17, 18, 19]
    assert [number for number, *_ in run.events()] == [3]
    assert not run.gaps
    run = followed(known, *range(25, 32), recorded=recorded)
    assert gaps(run) == [("values", 15, 29, AWAY)]


def test_a_gap_that_the_files_have_already_is_told_once() -> None:
    known = KnownRun()
    recorded = Recorded(last={("values", known.name): 14}, gaps={("values", known.name, 15): 19})
    assert not gaps(followed(known, *range(20, 22), recorded=recorded))
    recorded = Recorded(last={("values", known.name): 14}, gaps={("values", known.name, 15): 19})
    assert gaps(followed(known, *range(30, 32), recorded=recorded)) == [("values", 20, 29, AWAY)]


def test_events_are_once_each_with_utc_and_missing_ones_are_told() -> None:
    known = KnownRun()
    run = followed(known, *range(5))
    run.take_events(known.events(0, 1)["events"])
    run.take_events(known.events(1, 2, 5)["events"])
    assert [number for number, *_ in run.events()] == [0, 1, 2, 5]
    assert run.events()[2][1] == 1_764_000_000_200_000
    assert gaps(run) == [("events", 3, 4, LOST)]


def test_the_last_delta_that_repeats_a_period_is_no_row() -> None:
    known = KnownRun()
    run = followed(known, *range(3))
    frame = known.words(2)
    same = KnownRun()
    same.words = lambda number: frame  # type: ignore[method-assign, assignment]
    run.take_delta(same.delta(3, is_last=True))
    assert numbers(run) == [0, 1, 2]
    assert run.has_ended


# Files -----------------------------------------------------------------------------------------------------


def written(folder: RecordFolder, known: KnownRun, *stretches: range, hour: str = HOUR) -> None:
    for stretch in stretches:
        run = followed(known, *range(stretch.start // 10 * 10, stretch.stop))
        run.has_written(values=stretch.start % 10)
        assert run.rows is not None
        told = {known.name: (stretch.start, stretch.stop - 1)}
        folder.write("values", PLANT, run.rows.values(run.taken), told, hour)


def levels(root: Path) -> list[float]:
    return [row[0] for row in rows(root, "SELECT value FROM values WHERE path = 'level' ORDER BY delta")]


@pytest.fixture
def folder(tmp_path: Path) -> Any:
    made = RecordFolder(tmp_path / "history", nothing)
    yield made
    made.close()


def test_parts_become_the_file_of_their_hour_with_the_same_rows(folder: RecordFolder) -> None:
    written(folder, KnownRun(), range(10), range(10, 25), range(25, 30))
    place = folder.place("values", PLANT)
    folder.tidy(place, HOUR, "")
    assert [each.name for each in place.iterdir()] == [f"{HOUR}.00000002.parquet"]
    written(folder, KnownRun(), range(30, 40))
    folder.tidy(place, "2026-11-25T15", "")
    assert [each.name for each in place.iterdir()] == [f"{HOUR}.parquet"]
    assert levels(folder.root) == [number / 10 for number in range(40)]
    table = pq.read_table(folder.root / "values").to_pylist()  # hive partitions, by pyarrow alone
    assert {(row["site"], row["station"]) for row in table} == {("cell7", "plant")}
    assert [row["value"] for row in table if row["path"] == "level"] == [number / 10 for number in range(40)]
    files = f"read_parquet('{folder.root}/values/*/*/*.parquet')"
    assert by_duckdb(f"SELECT sum(value) FROM {files} WHERE state = 'FAIL'") == [(20.0,)]


def test_an_hour_that_comes_again_after_a_step_of_the_clock_is_added_to(folder: RecordFolder) -> None:
    place = folder.place("values", PLANT)
    written(folder, KnownRun(), range(10))
    folder.tidy(place, "2026-11-25T15", "")
    written(folder, KnownRun(), range(10, 20), hour="2026-11-25T15")
    written(folder, KnownRun(), range(20, 30))
    folder.tidy(place, "2026-11-25T16", "")
    assert levels(folder.root) == [number / 10 for number in range(30)]
    assert len(list(place.iterdir())) == 2


def test_parts_that_were_left_over_by_the_end_of_a_merge_are_not_counted_twice(
    folder: RecordFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = folder.place("values", PLANT)
    written(folder, KnownRun(), range(10), range(10, 20))
    for hour in (HOUR, "2026-11-25T15"):
        with monkeypatch.context() as patched:
            patched.setattr(Path, "unlink", lambda path, missing_ok=False: None)
            folder.tidy(place, hour, "")  # killed before the parts were removed
        folder.tidy(place, hour, "")
        assert len(list(place.iterdir())) == 1
        assert levels(folder.root) == [number / 10 for number in range(20)]
    assert [each.name for each in place.iterdir()] == [f"{HOUR}.parquet"]


def test_torn_and_half_written_files_are_set_aside_and_the_others_go_on(tmp_path: Path) -> None:
    said: list[str] = []
    root = tmp_path / "history"
    folder = RecordFolder(root, said.append)
    written(folder, KnownRun(), range(10), range(10, 20))
    place = folder.place("values", PLANT)
    whole = next(place.glob("*01.parquet")).read_bytes()
    (place / f"{HOUR}.00000002.parquet").write_bytes(whole[: len(whole) // 2])
    (place / f".{HOUR}.00000003.parquet.tmp").write_bytes(whole[:100])
    assert folder.recorded(PLANT).last == {("values", KnownRun().name): 19}
    assert len(said) == 1
    assert "is damaged" in said[0]
    folder.tidy(place, "2026-11-25T15", "")
    assert levels(root) == [number / 10 for number in range(20)]
    assert not list(place.glob(".*.tmp"))
    folder.close()


def test_nothing_is_merged_while_a_question_is_answered(folder: RecordFolder) -> None:
    written(folder, KnownRun(), range(10), range(10, 20))
    place = folder.place("values", PLANT)
    with asked(folder.root, "SELECT 1"):
        folder.tidy(place, HOUR, "")
        assert len(list(place.iterdir())) == 2
    folder.tidy(place, HOUR, "")
    assert len(list(place.iterdir())) == 1


def test_older_hours_are_removed(folder: RecordFolder) -> None:
    written(folder, KnownRun(), range(10), hour="2026-10-01T00")
    written(folder, KnownRun(), range(10, 20))
    folder.tidy(folder.place("values", PLANT), HOUR, "2026-11-01T00")
    assert levels(folder.root) == [number / 10 for number in range(10, 20)]


def test_a_second_recorder_of_a_folder_is_refused(folder: RecordFolder) -> None:
    with pytest.raises(OptionError, match="another recorder"):
        RecordFolder(folder.root, nothing)


def test_a_disk_that_is_full_costs_no_file_and_no_number(folder: RecordFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(file: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    written(folder, KnownRun(), range(10))
    with monkeypatch.context() as patched:
        patched.setattr(fleet_record_files.os, "fsync", full)
        with pytest.raises(OSError, match="No space left"):
            written(folder, KnownRun(), range(10, 20))
    assert len(list(folder.place("values", PLANT).iterdir())) == 1
    written(folder, KnownRun(), range(10, 20))
    assert levels(folder.root) == [number / 10 for number in range(20)]


# The recorder ----------------------------------------------------------------------------------------------


class ArrivalsByHand(FleetSource):
    """`come` is what a subscriber calls with each message."""

    def begin(self, put: Put, has_room: Callable[[], bool]) -> None:
        self.come: Callable[..., None] = put
        super().begin(put, has_room)


def test_a_full_disk_is_told_once_and_the_oldest_values_are_a_gap_when_there_is_room_again(
    folder: RecordFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fleet_record, "FLUSH", 0.0)
    monkeypatch.setattr(fleet_record, "FLUSHES", 10**9)
    monkeypatch.setattr(fleet_record, "TAKE_WAIT", 0.0)
    said: list[str] = []
    known = KnownRun()
    session = opened(FleetNetwork(listen=[f"tcp/127.0.0.1:{free_port()}"]), "peer")
    source, kept = ArrivalsByHand(session), 30
    most = kept * known.words(0).nbytes
    recorder = FleetRecorder(source, folder, say=said.append, most_pending=most)

    def come(first: int, stop: int) -> None:
        for number in range(first, stop):
            source.come("delta", PLANT, known.delta(number))
            recorder.step()

    source.come("event", PLANT, json.dumps(known.events(0)).encode())
    source.come("delta", PLANT, known.delta(0))
    source.come("declaration", PLANT, known.declaration(0))
    come(1, 10)
    fsync = fleet_record_files.os.fsync
    is_full = [True]

    def sync(file: int) -> None:
        if is_full[0]:
            raise OSError(errno.ENOSPC, "No space left on device")
        fsync(file)

    monkeypatch.setattr(fleet_record_files.os, "fsync", sync)
    come(10, 100)
    is_full[0] = False
    come(100, 110)
    recorder.run(lambda: True)
    assert len([text for text in said if "cannot be written: No space left on device" in text]) == 1
    assert said[-1] == "the history can be written again"
    found = rows(folder.root, "SELECT delta FROM values WHERE path = 'level' ORDER BY delta")
    lost = rows(folder.root, "SELECT first, last, count, why FROM gaps ORDER BY first")
    missing = [number for first, last, *_ in lost for number in range(first, last + 1)]
    assert sorted([each[0] for each in found] + missing) == list(range(110))
    assert 0 < sum(number in range(10, 100) for (number,) in found) <= kept  # of those that came meanwhile
    assert {why for *_, why in lost} == {FULL_DISK}
    assert sum(count for _, _, count, _ in lost) == len(missing)
    assert rows(folder.root, "SELECT number, text FROM events") == [(0, "event 0")]
    assert rows(folder.root, "SELECT path, unit, maximum FROM objects LIMIT 1") == [("level", "mm", 9.0)]
    session.close()  # type: ignore[no-untyped-call]


def test_what_is_damaged_costs_no_other_message_and_does_not_end_the_recorder(
    folder: RecordFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nobody answers, so that what is missing is given up, and what waits behind it has its turn."""
    monkeypatch.setattr(fleet_record, "TAKE_WAIT", 0.0)
    monkeypatch.setattr(run_feed, "RETRY_DELAY", 0.0)
    known = KnownRun()
    with closing(opened(FleetNetwork(listen=[f"tcp/127.0.0.1:{free_port()}"]), "peer")) as session:
        source = ArrivalsByHand(session)
        recorder = FleetRecorder(source, folder, say=nothing)
        source.come("delta", PLANT, known.delta(0))
        source.come("declaration", PLANT, known.declaration(0))
        events = known.events(0, 1, 2)
        events["events"][1][6] = 99  # no state of a command
        source.come("event", PLANT, json.dumps(events).encode())
        source.come("delta", PLANT, known.delta(2)[:-1])
        for number in range(3, 15):
            source.come("delta", PLANT, known.delta(number))
        for _ in range(run_feed.TRIES + 2):
            recorder.step()
        recorder.run(lambda: True)
    deltas = rows(folder.root, "SELECT delta FROM values WHERE path = 'level' ORDER BY delta")
    assert [each[0] for each in deltas] == [0, *range(10, 15)]
    assert rows(folder.root, "SELECT number FROM events ORDER BY number") == [(0,), (2,)]


def test_stations_that_do_not_answer_do_not_keep_others_from_being_asked(
    folder: RecordFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fleet_record, "TAKE_WAIT", 0.0)
    monkeypatch.setattr(run_feed, "RETRY_DELAY", 0.0)
    known = KnownRun()
    with closing(opened(FleetNetwork(listen=[f"tcp/127.0.0.1:{free_port()}"]), "peer")) as session:
        source, queries = ArrivalsByHand(session), HangingQueries()
        monkeypatch.setattr(fleet_record_source, "PastQueries", lambda *_: queries)
        recorder = FleetRecorder(source, folder, say=nothing)
        keys = [StationKey("cell7", f"s{number}") for number in range(5)]
        for key in keys:
            source.come("delta", key, known.delta(3))
        for _ in range(4):
            queries.waiting = 0
            recorder.step()
    assert set(queries.asked) == set(keys)


class HangingQueries:
    """Two of them may wait."""

    def __init__(self) -> None:
        self.waiting, self.asked = 0, list[StationKey]()

    @property
    def are_too_many(self) -> bool:
        return self.waiting >= 2

    def ask(self, key: StationKey, missing: object) -> None:
        self.waiting += 1
        self.asked.append(key)


def test_messages_beyond_the_bound_are_dropped() -> None:
    incoming = Incoming(most=100)
    for _ in range(5):
        incoming.put("delta", PLANT, bytes(40))
    assert len(incoming.take(0.0)) == 2
    incoming.put("delta", PLANT, bytes(40))
    assert len(incoming.take(0.0)) == 1


def test_patterns_are_keys_of_zenoh() -> None:
    assert key_pattern("cell7/*") == "cell7/*"
    assert key_pattern("*/press*") == "*/press$*"
    for wrong in ("press", "a/b/c", "a/", "a/b d", "**"):
        with pytest.raises(OptionError, match="SITE/STATION"):
            key_pattern(wrong)


# Questions -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("sql", "words"),
    [
        ("SELEC 1", 'SQL: syntax error at or near "SELEC"'),
        ("SELECT valu FROM values", "not found"),
        ("DROP VIEW values", "read-only"),
        ("COPY values TO 'there.csv'", "read-only"),
        ("SELECT 1; SELECT 2", "read-only"),
        ("", "read-only"),
        ("SELECT * FROM read_csv('/etc/passwd')", "Cannot access file"),
        ("SET lock_configuration = false", "read-only"),
        ("SELECT value::INTEGER FROM values WHERE error(path)", "level"),
    ],
)
def test_a_mistake_in_a_question_is_told_in_a_line(folder: RecordFolder, sql: str, words: str) -> None:
    written(folder, KnownRun(), range(10))
    with pytest.raises(OptionError, match=words) as told:
        rows(folder.root, sql)
    assert "\n" not in str(told.value)


def test_views_are_there_without_files_and_a_folder_without_history_is_told(tmp_path: Path) -> None:
    with pytest.raises(OptionError, match="no history"):
        rows(tmp_path, "SELECT 1")
    (tmp_path / "values").mkdir()
    assert rows(tmp_path, "SELECT station, path, value FROM values") == []
    assert rows(tmp_path, "SELECT sum(count) FROM gaps") == [(None,)]


def test_only_files_of_the_last_hours_are_read(folder: RecordFolder) -> None:
    from datetime import UTC, datetime

    written(folder, KnownRun(), range(10), hour="2026-11-25T10")
    written(folder, KnownRun(), range(10, 20), hour="2026-11-25T14")
    now = datetime(2026, 11, 25, 14, 30, tzinfo=UTC)
    for last, count in ((3600.0, 10), (5 * 3600.0, 20)):
        with asked(folder.root, "SELECT count(DISTINCT delta) FROM values", last, now) as answer:
            assert answer.fetchall() == [(count,)]
