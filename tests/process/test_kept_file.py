"""The file of kept values: whole or refused, whatever was done to it; old or new, whenever the computer goes down."""

from __future__ import annotations

import json
import os
import stat
import sys
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as some

from umo.process import kept_file, kept_values
from umo.process.kept_file import KeptFileError, KeptValues

VALUES = KeptValues(
    "press", "modbus", "/machines/press", 4711, 1.7e9, 12_345, 1.7e9 + 12.5,
    {"numbers": {
        "count": {"value": 9_007_199_254_740_991, "unit": "", "type": "int"},
        "gain": {"value": 0.1 + 0.2, "unit": "V/mm", "type": "float"},
        "on": {"value": True, "unit": "", "type": "bool"},
        "name": {"value": "FAST", "unit": "", "type": "Enum"},
        "none": {"value": None, "unit": "mm", "type": "float"},
    },
    "alarms": {"full": 1, "filler.fault": 4, "many.12": 9},
    "states": {"filler.unit": "unholding", "brewer.unit": "aborted"}},
)  # fmt: skip
DATA = kept_file.dump(VALUES)


def test_what_is_written_is_read_again_to_the_last_digit(tmp_path: Path) -> None:
    path = tmp_path / "kept.json"
    kept_file.write(path, DATA)
    assert kept_file.read(path) == VALUES
    assert [file.name for file in tmp_path.iterdir()] == ["kept.json"]
    assert path.stat().st_mode & 0o777 == 0o600 or sys.platform == "win32"


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the sticky bit of a file")
def test_old_files_are_left_alone_by_what_cleans_var_tmp(tmp_path: Path) -> None:
    path = tmp_path / "kept" / "kept.json"
    with kept_file.locked(path, 1.0):
        kept_file.write(path, DATA)
    assert [stat.S_IMODE(file.stat().st_mode) for file in (path, kept_file.lock_of(path))] == [0o1600, 0o1600]


def test_every_beginning_of_a_file_is_refused() -> None:
    for end in range(len(DATA)):
        with pytest.raises(KeptFileError):
            kept_file.load(DATA[:end])


def test_a_file_cut_at_every_byte_costs_all_its_values_and_the_next_run_keeps_its_own(tmp_path: Path) -> None:
    job = SimpleNamespace(fresh=False)
    plan: Any = SimpleNamespace(name="press", wiring_name="modbus", place="/machines/press", job=job)
    path = kept_values.file_of(plan)
    said: list[str] = []
    assert path is not None
    os.close(kept_file.lock_file(path))
    for end in range(len(DATA)):
        path.write_bytes(DATA[:end])
        assert kept_values.take_over(plan, said.append) == {}
        assert said[-1].startswith("the kept values of the last run are lost: the file is ")
    kept_file.write(path, DATA)
    assert kept_values.take_over(plan, said.append) == VALUES.sections
    assert len(said) == len(DATA)
    assert len([*path.parent.glob("*.aside-*")]) == kept_file.MAX_ASIDE


def test_every_end_of_a_file_is_refused() -> None:
    for begin in range(1, len(DATA)):
        with pytest.raises(KeptFileError):
            kept_file.load(DATA[begin:])


@pytest.mark.parametrize("bit", [1, 2, 4, 8, 16, 32, 64, 128])
def test_a_file_with_a_bit_flipped_in_any_byte_is_refused(bit: int) -> None:
    for at in range(len(DATA)):
        with pytest.raises(KeptFileError):
            kept_file.load(DATA[:at] + bytes([DATA[at] ^ bit]) + DATA[at + 1 :])


@given(at=some.integers(0, len(DATA)), length=some.integers(0, 40), other=some.binary(max_size=40))
def test_a_file_with_other_bytes_in_it_is_refused(at: int, length: int, other: bytes) -> None:
    changed = DATA[:at] + other + DATA[at + length :]
    if changed != DATA:
        with pytest.raises(KeptFileError):
            kept_file.load(changed)


NUMBER = {"value": 1, "unit": "", "type": "int"}
FOREIGN: list[Any] = [
    {},
    {"version": 2, **asdict(VALUES)},
    asdict(VALUES),
    {"version": 1},
    {"version": 1, **asdict(VALUES), "more": 1},
    {"version": 1, **asdict(VALUES), "station": 3},
    {"version": 1, **asdict(VALUES), "utc": "noon"},
    {"version": 1, **asdict(VALUES), "utc": 1e300},
    {"version": 1, **asdict(VALUES), "sections": []},
    {"version": 1, **asdict(VALUES), "sections": {"numbers": [1]}},
    {"version": 1, **asdict(VALUES), "sections": {"alarms": {"worn": []}}},
    {"version": 1, **asdict(VALUES), "sections": {"numbers": {"count": 3}}},
    {"version": 1, **asdict(VALUES), "sections": {"numbers": {"count": {"value": 3}}}},
    {"version": 1, **asdict(VALUES), "sections": {"numbers": {"count": NUMBER | {"unit": 3}}}},
    {"version": 1, **asdict(VALUES), "sections": {"alarms": {"full": [1]}}},
    {"version": 1, **asdict(VALUES), "sections": {"alarms": {"full": True}}},
    {"version": 1, **asdict(VALUES), "sections": {"states": {"filler.unit": 6}}},
]


@pytest.mark.parametrize("content", FOREIGN)
def test_a_file_of_another_kind_is_refused_though_its_checksum_fits(content: Any) -> None:
    with pytest.raises(KeptFileError):
        kept_file.load(kept_file.encode(content))


@pytest.mark.parametrize("data", [b"", b"null", b"[]", b"{}", b"\xff", b"[" * 100_000, b'{"content": {}}', b"7"])
def test_what_is_no_such_file_is_refused(data: bytes) -> None:
    with pytest.raises(KeptFileError):
        kept_file.load(data)


JSON = some.recursive(
    some.none() | some.booleans() | some.floats() | some.text() | some.integers(),
    lambda each: some.lists(each) | some.dictionaries(some.text(), each),
)


@given(JSON)
def test_any_other_json_is_refused(value: Any) -> None:
    with pytest.raises(KeptFileError):
        kept_file.load(json.dumps(value).encode())


def test_what_is_no_file_of_this_user_is_refused(tmp_path: Path) -> None:
    assert kept_file.read(tmp_path / "none") is None
    (tmp_path / "folder").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "folder")
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "long").write_bytes(b" " * (kept_file.MAX_BYTES + 1))
    for name in ("folder", "link", "pipe", "long"):
        with pytest.raises(KeptFileError):
            kept_file.read(tmp_path / name)


def test_the_damaged_files_that_are_kept_aside_are_few(tmp_path: Path) -> None:
    for number in range(kept_file.MAX_ASIDE + 3):
        (tmp_path / "kept.json").write_text(str(number))
        kept_file.set_aside(tmp_path / "kept.json", 1.7e9 + number)
    texts = sorted(int(path.read_text()) for path in tmp_path.iterdir())
    assert texts == list(range(3, kept_file.MAX_ASIDE + 3))


# Going down ---------------------------------------------------------------------------------------------


class Down(Exception):
    """The computer goes down."""


class Disk:
    """A file system that goes down after some calls. Of a file that was not synced any beginning may be left; a name
    that was given, while its folder was not synced, may be given or not. It writes a few bytes at a time."""

    def __init__(self, calls: int, fails: bool = False, first: bool = False) -> None:
        self.calls, self.fails = calls, fails
        self.names: list[dict[str, int]] = [{} if first else {"kept.json": 0}]
        """What the folder may hold on the disk, the last one is what processes see."""
        self.files = [bytearray(b"old")]
        self.synced = [3]
        self._open: dict[int, int | None] = {}

    def _call(self) -> None:
        self.calls -= 1
        if self.calls < 0:
            raise OSError(28, "No space left on device") if self.fails else Down

    def open(self, path: Path, flags: int, mode: int = 0o777) -> int:
        self._call()
        number: int | None = None
        if flags & os.O_CREAT:
            number = len(self.files)
            self.files.append(bytearray())
            self.synced.append(0)
            self.names.append({**self.names[-1], path.name: number})
        self._open[len(self._open)] = number
        return len(self._open) - 1

    def write(self, file: int, data: bytes) -> int:
        self._call()
        self.files[self._open[file] or 0] += data[:50]
        return len(data[:50])

    def fsync(self, file: int) -> None:
        self._call()
        number = self._open[file]
        if number is None:
            self.names = self.names[-1:]
        else:
            self.synced[number] = len(self.files[number])

    def close(self, file: int) -> None:
        pass

    def replace(self, old: Path, new: Path) -> None:
        self._call()
        names = dict(self.names[-1])
        names[new.name] = names.pop(old.name)
        self.names.append(names)

    def left(self) -> Iterator[bytes | None]:
        """Whatever may be found under the name afterwards; None: nothing."""
        for names in self.names:
            if (number := names.get("kept.json")) is None:
                yield None
                continue
            for end in range(self.synced[number], len(self.files[number]) + 1):
                yield bytes(self.files[number][:end])


@pytest.mark.parametrize("old", [b"old", None], ids=["old", "none"])
def test_whenever_the_computer_goes_down_the_old_file_is_left_whole_or_the_new_one(old: bytes | None) -> None:
    for calls in range(100):
        disk = Disk(calls, first=old is None)
        try:
            kept_file.write(Path("kept.json"), DATA, disk)
        except Down:
            assert set(disk.left()) <= {old, DATA}
        else:
            assert set(disk.left()) == {DATA}
            assert calls > 10
            return
    raise AssertionError("it never came to its end")


def test_whichever_call_fails_the_old_file_stays_or_the_new_one_is_there() -> None:
    for calls in range(20):
        disk = Disk(calls, fails=True)
        try:
            kept_file.write(Path("kept.json"), DATA, disk)
        except OSError:
            assert set(disk.left()) <= {b"old", DATA}


def test_a_file_left_by_a_writer_that_was_killed_is_written_over(tmp_path: Path) -> None:
    (tmp_path / ".kept.json.new").write_bytes(b"x" * 10_000)
    kept_file.write(tmp_path / "kept.json", DATA)
    assert kept_file.read(tmp_path / "kept.json") == VALUES
