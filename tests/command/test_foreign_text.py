"""Texts and numbers of other processes and users never reach the terminal raw, and end no command of umo's."""

from __future__ import annotations

import dataclasses
import json
import os
import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner, Result

from helpers.machines import actuator, bench, wired
from umo import Compound, connect, published
from umo.errors import DeclarationError
from umo.process.frames import Reader, blackbox
from umo.process.frames.layout import Layout
from umo.system import device_lock, device_record
from umo.system.device_lock import DeviceLock, holder
from umo.system.device_record import DeviceRecord, all_standing
from umo.testing import Scripted, VirtualTimer, periods
from umo.text import time_of_day
from umo_command.app import app
from umo_command.console import PrintableConsole

ESCAPE = "\x1b[2J\x1b]0;title\x07\x9b31m\r\x7f"
hostile_texts = st.one_of(
    st.just(ESCAPE), st.text(st.sampled_from("\x1b[]\x9b\x07\r\n\t\x00\x7f\u202ea;m0[bold]")), st.just("x" * 3000)
)
INFINITE = float("inf")
absurd_numbers = st.sampled_from([INFINITE, -INFINITE, float("nan"), 1e300, -1e300, -1, 0, 10**400, 2**63, True])
anything: Any = st.one_of(hostile_texts, absurd_numbers, st.none(), st.just([]), st.just({}), st.just([[ESCAPE]]))

FIELDS = ("station", "wiring", "when", "what", "state", "id", "device", "unreached", "seen", "user", "mine")


def umo(*words: str) -> Result:
    return CliRunner().invoke(app, words)


def harmless(result: Result) -> None:
    """A line or a picture, and nothing that a terminal would obey."""
    assert result.exit_code in (0, 2), (result.output, result.exception)
    assert result.exception is None or isinstance(result.exception, SystemExit)
    assert all(c.isprintable() or c == "\n" for c in result.stdout + result.stderr), ascii(result.output)


# One gate to the terminal ------------------------------------------------------------------------------


@given(st.text())
def test_the_console_shows_no_control_character(text: str) -> None:
    console = PrintableConsole(width=40, highlight=False, markup=False, emoji=False, force_terminal=False)
    with console.capture() as captured:
        console.print(text)
        console.print(text, soft_wrap=True, style="red")
    assert all(c.isprintable() or c == "\n" for c in captured.get())


@given(anything)
def test_any_time_is_a_text(seconds: Any) -> None:
    assert time_of_day(seconds).isprintable()


# Devices ------------------------------------------------------------------------------------------------


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="devices are held on Linux")
@given(since=st.sampled_from(["inf", "nan", "1e300", "-1e300", "soon", ""]), purpose=st.just(ESCAPE))
@settings(max_examples=12)
def test_the_holder_of_a_device_may_have_noted_anything(since: str, purpose: str) -> None:
    """Any user may bind such a socket."""
    held = DeviceLock(["a device"], "press")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as note:
        try:
            held._notes.pop().close()
            note.bind(f"\0{device_lock._note('a device', os.getpid())}{since} {purpose}"[:107].encode())
            text = holder("a device")
        finally:
            held.release()
    assert text.isprintable()
    assert text.startswith("this program itself")


@given(st.fixed_dictionaries({}, optional=dict.fromkeys(FIELDS, anything)))
@settings(max_examples=12, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])
def test_the_record_of_another_run_may_hold_anything(tmp_path: Path, changes: dict[str, Any]) -> None:
    run = DeviceRecord(["bus 1"], "press", "rig")
    run.begin(True)
    run.stopped("killed", ["motor"])
    (file,) = (device_record.state_folder() / device_record.FOLDER).iterdir()
    file.write_text(json.dumps(json.loads(file.read_text()) | changes))
    for ended in all_standing():
        assert str(ended).isprintable() and ended.brief.isprintable()
    harmless(umo("show", "stations"))
    harmless(result := umo("show", "stations", "--json"))
    json.loads(result.stdout)
    file.unlink()


# Running stations and black boxes -----------------------------------------------------------------------


@contextmanager
def running(name: str = "press") -> Iterator[Any]:
    machine = bench()
    connection = connect(machine, wired(machine, Scripted({"encoder": range(500)}), clock=VirtualTimer()))
    with connection, published(connection, name, "rig") as ring:
        periods(machine, 5)
        yield ring


def test_a_station_whose_name_has_escapes_is_shown_without_them() -> None:
    with running(f"press{ESCAPE}"):
        for words in (
            ["show", "stations"],
            ["show", "values", "--once"],
            ["do", "pres", "mode"],
            ["device", "get", f"press{ESCAPE}", "motor"],
        ):
            harmless(result := umo(*words))
            assert "press?[2J" in result.output


@pytest.fixture
def pressing(tmp_path: Path) -> Iterator[Path]:
    """A run, and a black box of it."""
    with running() as ring:
        with Reader(ring.path) as reader:
            blackbox.save(reader, tmp_path / "kept.box", "on demand")
        yield tmp_path / "kept.box"


def changed(data: Any, where: list[int], value: Any) -> Any:
    """Plain data with one of its leaves, or branches, replaced."""
    if not where or not isinstance(data, dict | list | tuple) or not data:
        return value
    if isinstance(data, dict):
        keys = list(data)
        key = keys[where[0] % len(keys)]
        return data | {key: changed(data[key], where[1:], value)}
    items = list(data)
    items[where[0] % len(items)] = changed(items[where[0] % len(items)], where[1:], value)
    return type(data)(items)


PARTS = ("about", "objects", "signals", "phases", "interlocks", "actions", "tunables")


@pytest.mark.full
@given(
    part=st.sampled_from(PARTS),
    where=st.lists(st.integers(0, 30), min_size=1, max_size=3),
    value=anything,
    odd=st.sampled_from(["", "time", "missed", "execution", "wake", "values", "done"]),
    number=absurd_numbers,
)
@settings(max_examples=20, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])
def test_what_frames_say_of_themselves_may_be_anything(
    pressing: Path, part: str, where: list[int], value: Any, odd: str, number: Any
) -> None:
    """`umo show stations`, `umo show values` and `umo show why` of a description and of frames with escapes and absurd
    numbers."""
    parse, copy = Layout.parse, Reader._copy

    def odd_parse(description: bytes) -> Layout:
        layout = parse(description)
        return dataclasses.replace(layout, **{part: changed(getattr(layout, part), where, value)})

    def odd_copy(self: Reader, *words: Any) -> Any:
        rows = copy(self, *words)
        if odd and len(rows):
            rows = rows.copy()
            with np.errstate(all="ignore"):
                try:
                    rows[odd][-1] = number
                except (OverflowError, ValueError):
                    rows[odd][-1] = -(2**63) if rows[odd].dtype.kind == "i" else INFINITE
        return rows

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Layout, "parse", odd_parse)
        patch.setattr(Reader, "_copy", odd_copy)
        for words in (
            ["show", "stations"],
            ["show", "stations", "--json"],
            ["show", "values", "--once"],
            ["show", "why", "--file", str(pressing)],
        ):
            harmless(umo(*words))


def test_a_damaged_run_does_not_hide_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    parse = Layout.parse

    def odd(description: bytes) -> Layout:
        layout = parse(description)
        if layout.about["station"] != "mill":
            return layout
        return dataclasses.replace(layout, about=layout.about | {"started": float("inf")})

    monkeypatch.setattr(Layout, "parse", odd)
    with running("mill"), running("press"):
        result, alone = umo("show", "stations"), umo()
    assert result.exit_code == 0
    assert "press (rig)" in result.stdout
    assert "cannot be read" in result.stderr
    assert alone.stderr.count("cannot be read") == 1
    with running("mill"):
        result = umo("show", "stations")
    assert result.stdout == "no station that can be read is running\n"
    assert "cannot be read" in result.stderr


class Rack(Compound):
    parts: dict[str, Any]


@pytest.mark.parametrize("key", ["a\x1b[2J", "a\nb", "a.b"])
def test_the_keys_of_parts_are_printable(key: str) -> None:
    with pytest.raises(DeclarationError, match="different strings without dots and control characters"):
        Rack(parts={key: actuator()})
