"""The keeper's work in this process: what it writes of the frames, and when."""

from __future__ import annotations

import errno
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import KW_ONLY
from pathlib import Path
from types import SimpleNamespace
from typing import Annotated, cast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from helpers.machines import timer
from umo import Compound, DigitalSensor, Number, connect, published
from umo.operation.alarms import Alarm, alarm_file
from umo.process import kept_file
from umo.process.frames import Reader
from umo.process.keeper import HELD_BY_ANOTHER, INTERVAL, KeeperMessage, Writer, keep
from umo.process.kept_file import KeptValues
from umo.testing import periods

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="frames need Linux")


class Press(Compound, alarms={"worn": Alarm(lambda press: press.count > 5, "to be replaced")}):
    timer: DigitalSensor
    _: KW_ONLY
    count: Annotated[int, Number(kept=True)] = 0
    other: Annotated[float, Number("mm", tunable=True)] = 1.0


class Bench:
    def __init__(self, m: Press, reader: Reader, path: Path) -> None:
        self.m, self.reader, self.path = m, reader, path
        self.told = [0] * len(KeeperMessage)
        self.writes = 0
        self.error = 0
        self.writer = Writer(path, KeptValues("press", "simulated"), self.told, self._write)

    def _write(self, path: Path, data: bytes) -> None:
        self.writes += 1
        if self.error:
            raise OSError(self.error, "it cannot be written")
        kept_file.write(path, data)

    def kept(self) -> KeptValues:
        values = kept_file.read(self.path)
        assert values is not None
        return values

    def at(self, *moments: Callable[[], object]) -> Callable[[float], bool]:
        """In place of the wait for the writer's end: what happens in each; after the last one it is gone."""
        rest = list(moments)

        def is_gone(within: float) -> bool:
            if rest:
                rest.pop(0)()
            return not rest

        return is_gone


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    monkeypatch.setenv("UMO_STATE", str(tmp_path))
    connection = connect(Press(timer=timer()))
    with connection as m, published(connection, "press") as ring, Reader(ring.path) as reader:
        yield Bench(m, reader, tmp_path / "kept" / "press.json")


def count(bench: Bench, number: int) -> Callable[[], None]:
    def work() -> None:
        bench.m.count = number
        periods(bench.m, 2)

    return work


def test_each_look_writes_the_last_frame_if_what_is_kept_has_changed(bench: Bench) -> None:
    keep(bench.reader, bench.writer, bench.at(count(bench, 1), count(bench, 1), count(bench, 2)))
    values = bench.kept()
    assert (bench.writes, bench.told[KeeperMessage.ERROR]) == (2, 0)
    assert values.numbers == {"count": {"value": 2, "unit": "", "type": "int"}}
    assert (values.station, values.wiring, values.pid) == ("press", "simulated", bench.reader.about["pid"])
    assert values.period in (5, 6)  # of the last change


def test_the_time_of_the_disk_does_not_delay_the_next_look(bench: Bench) -> None:
    now, waits = 100.0, []

    def is_gone(within: float) -> bool:
        nonlocal now
        waits.append(within)
        now += within
        count(bench, len(waits))()
        return len(waits) == 5

    def slow(path: Path, data: bytes) -> None:
        nonlocal now
        now += (0.1, 0.2, 0.5, 3.0, 0.0)[len(waits) - 1]

    keep(bench.reader, Writer(bench.path, KeptValues("press", "simulated"), bench.told, slow), is_gone, lambda: now)
    assert waits == pytest.approx([0.0, INTERVAL - 0.1, INTERVAL - 0.2, INTERVAL - 0.5, 0.0])


class Timed:
    """A run whose newest period is that of the injected clock, its keeper, and a disk that takes these times in s."""

    def __init__(self, disk: Sequence[float]) -> None:
        self.now = self.written = 100.0
        """The clock, and the moment of the period that the file has."""
        self.ages = [0.0]
        """How much older than the newest period the file was, just before each write of it was finished."""
        self.rest = list(disk)

    def is_gone(self, within: float) -> bool:
        self.now += within
        return not self.rest

    def take(self, reader: object) -> None:
        found = self.now
        self.now += self.rest.pop(0) if self.rest else 0.0
        self.ages.append(self.now - self.written)
        self.written = found


@given(st.lists(st.floats(0.0, 0.5), min_size=1, max_size=12))
def test_what_is_kept_is_at_no_moment_older_than_a_second_where_the_disk_takes_half_of_one(disk: list[float]) -> None:
    timed = Timed(disk)
    keep(cast(Reader, SimpleNamespace(is_finished=False)), cast(Writer, timed), timed.is_gone, lambda: timed.now)
    assert max(timed.ages) <= 1.0 + 1e-9


@given(st.lists(st.floats(0.0, 20.0), min_size=1, max_size=12))
def test_on_a_slower_disk_it_is_older_by_no_more_than_two_writes_take(disk: list[float]) -> None:
    timed = Timed(disk)
    keep(cast(Reader, SimpleNamespace(is_finished=False)), cast(Writer, timed), timed.is_gone, lambda: timed.now)
    pairs = zip([0.0, *disk], [*disk, 0.0], strict=True)
    assert max(timed.ages) <= max(max(INTERVAL, before) + write for before, write in pairs) + 1e-9


def test_the_last_frame_is_written_when_the_writer_is_gone(bench: Bench) -> None:
    keep(bench.reader, bench.writer, bench.at(count(bench, 7)))
    assert bench.kept().numbers["count"]["value"] == 7


def test_the_changes_of_alarms_are_added_to_their_history(bench: Bench) -> None:
    keep(bench.reader, bench.writer, bench.at(count(bench, 9), count(bench, 9), count(bench, 1)))
    changes = alarm_file.read(alarm_file.file_of("press"))
    assert [(each.path, each.text.partition(" ")[0]) for each in changes] == [
        ("worn", "unacknowledged"),
        ("worn", "returned"),
    ]
    assert bench.told[KeeperMessage.NEXT_EVENT] == bench.reader.now().next_event


def test_a_history_that_cannot_be_written_keeps_nothing_else_from_being_written(bench: Bench) -> None:
    file = alarm_file.file_of("press")
    file.mkdir()
    keep(bench.reader, bench.writer, bench.at(count(bench, 9)))
    assert (bench.told[KeeperMessage.HISTORY_ERROR], bench.kept().numbers["count"]["value"]) == (errno.EISDIR, 9)
    file.rmdir()
    keep(bench.reader, bench.writer, bench.at(count(bench, 9)))
    assert (bench.told[KeeperMessage.HISTORY_ERROR], len(alarm_file.read(file))) == (0, 1)


def test_without_a_frame_nothing_is_written(bench: Bench) -> None:
    keep(bench.reader, bench.writer, bench.at(lambda: None))
    assert not bench.path.exists()


def test_what_could_not_be_written_is_tried_again_and_the_old_file_stays(bench: Bench) -> None:
    def fail(number: int) -> Callable[[], None]:
        def work() -> None:
            bench.error = number

        return work

    keep(bench.reader, bench.writer, bench.at(count(bench, 1)))
    keep(bench.reader, bench.writer, bench.at(fail(errno.ENOSPC), count(bench, 2)))
    assert (bench.told[KeeperMessage.ERROR], bench.kept().numbers["count"]["value"]) == (errno.ENOSPC, 1)
    keep(bench.reader, bench.writer, bench.at(fail(0)))
    assert (bench.told[KeeperMessage.ERROR], bench.kept().numbers["count"]["value"]) == (0, 2)


def test_a_file_that_another_run_keeps_is_left_alone_until_that_has_ended(bench: Bench) -> None:
    with kept_file.locked(bench.path, 1.0):
        keep(bench.reader, bench.writer, bench.at(count(bench, 1)))
        assert (bench.told[KeeperMessage.ERROR], bench.writes) == (HELD_BY_ANOTHER, 0)
    keep(bench.reader, bench.writer, bench.at(count(bench, 2)))
    assert (bench.told[KeeperMessage.ERROR], bench.kept().numbers["count"]["value"]) == (0, 2)


def test_a_reader_knows_what_is_kept_and_what_was_tuned(bench: Bench) -> None:
    periods(bench.m, 2)
    assert (bench.reader.kept, bench.reader.tuned()) == (["count"], {})
    bench.m.other = 0.1 + 0.2
    periods(bench.m, 2)
    assert bench.reader.tuned() == {"other": 0.1 + 0.2}
