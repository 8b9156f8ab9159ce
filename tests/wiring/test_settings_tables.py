"""Tables of settings: what a key may be, and how mistakes are told."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import pytest

from umo.errors import OptionError
from umo.wiring.settings import (
    SettingsError,
    a_number,
    a_size,
    a_text,
    a_time,
    a_whole,
    one_of,
    read_settings,
    settings_of,
    values_of,
)


@dataclass(frozen=True)
class Table:
    keep: Annotated[float, a_time(1.0)] = 60.0
    room: Annotated[int | None, a_size(10**5)] = None
    rate: Annotated[float, a_number(0.1, 100.0)] = 10.0
    cores: Annotated[int, a_whole(1)] = 1
    way: Annotated[str, one_of("fast", "slow")] = "fast"
    name: Annotated[str | None, a_text("a name")] = None
    commands: bool = False
    bands: Mapping[str, Annotated[float, a_number(0.0, 9.0)]] = field(default_factory=dict)


def test_what_is_not_given_has_its_default_and_texts_become_numbers() -> None:
    found = settings_of(Table, {"keep": "5 min", "room": "200 MB", "rate": 5, "bands": {"z": 2}}, "x.toml")
    assert found == Table(keep=300.0, room=200_000_000, rate=5.0, bands={"z": 2.0})
    assert settings_of(Table, {}, "x.toml") == Table()


@pytest.mark.parametrize(
    ("table", "told"),
    [
        ({"keep": "1 ms"}, "keep: '1 ms' is less than 1 s"),
        ({"keep": "fast"}, "keep: 'fast' is not a duration"),
        ({"keep": True}, "keep: True is not a duration"),
        ({"room": "7"}, "room: '7' is not a size such as '200 MB'"),
        ({"rate": 0}, "rate: must be a number from 0.1 to 100, not 0"),
        ({"rate": float("nan")}, "rate: must be a number from 0.1 to 100, not nan"),
        ({"cores": 0}, "cores: must be a whole number from 1 on, not 0"),
        ({"cores": 1.0}, "cores: must be a whole number from 1 on, not 1.0"),
        ({"way": "fats"}, "way: must be one of fast, slow, not 'fats' (did you mean 'fast'?)"),
        ({"name": " "}, "name: must be a name, not ' '"),
        ({"commands": 1}, "commands: must be true or false, not 1"),
        ({"bands": {"z": -1}}, "bands.z: must be a number from 0 to 9, not -1"),
        ({"bands": 3}, "bands: must be a table, not 3"),
        ({"raet": 3}, "raet: unknown key (did you mean 'rate'?); known: keep, room, rate"),
    ],
)
def test_a_mistake_says_what_the_key_takes(table: dict[str, Any], told: str) -> None:
    with pytest.raises(SettingsError) as caught:
        settings_of(Table, table, "x.toml", "record")
    assert str(caught.value).startswith(f"x.toml: record.{told}")


def test_all_mistakes_are_told_at_once_and_what_is_right_is_taken() -> None:
    values, mistakes = values_of(Table, {"rate": 0, "cores": 2, "wy": 1})
    assert values == {"cores": 2}
    assert [key for key, _ in mistakes] == ["rate", "wy"]


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig"])  # Windows may begin a file with a mark
def test_a_mistake_of_a_file_has_its_line(tmp_path: Path, encoding: str) -> None:
    file = tmp_path / "x.toml"
    file.write_text("# a comment\ncores = 2\n\n[bands]\nz = 1\ny = 20\n", encoding=encoding)
    with pytest.raises(SettingsError) as caught:
        read_settings(Table, file)
    assert str(caught.value) == f"{file}:6: bands.y: must be a number from 0 to 9, not 20"


def test_a_file_that_is_not_there_is_none_and_a_link_that_leads_nowhere_is_a_mistake(tmp_path: Path) -> None:
    assert read_settings(Table, tmp_path / "none.toml") is None
    (tmp_path / "link.toml").symlink_to(tmp_path / "none.toml")
    with pytest.raises(OptionError, match="is a link to a file that does not exist"):
        read_settings(Table, tmp_path / "link.toml")


@pytest.mark.parametrize(
    ("data", "told"),
    [(b"cores = ", "x.toml: Invalid value"), (b"\xff", "x.toml: 'utf-8'"), (b"#" * 200, "longer than 100 bytes")],
)
def test_a_file_that_cannot_be_read_is_told(tmp_path: Path, data: bytes, told: str) -> None:
    file = tmp_path / "x.toml"
    file.write_bytes(data)
    with pytest.raises(OptionError, match=told):
        read_settings(Table, file, 100)


def test_a_key_that_is_given_twice_is_named_with_its_first_line(tmp_path: Path) -> None:
    (tmp_path / "x.toml").write_text('keep = "5 min"\nrate = 1\nkeep = "6 min"\n')
    with pytest.raises(OptionError, match="give each key only once: keep is also in line 1"):
        read_settings(Table, tmp_path / "x.toml")


def test_a_secret_that_others_may_write_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "x.toml"
    file.write_text("cores = 2\n")
    file.chmod(0o666)
    with pytest.raises(OptionError, match="other users can write the file"):
        read_settings(Table, file, secret=True)
    file.chmod(0o600)
    assert read_settings(Table, file, secret=True) == Table(cores=2)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no pipes")
def test_a_pipe_in_the_place_of_a_file_does_not_block(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "x.toml")
    assert read_settings(Table, tmp_path / "x.toml") == Table()
