"""`umo show stations` and `umo show values`: running stations seen from another terminal."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from io import StringIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rich.console import Console
from typer.testing import CliRunner, Result

from helpers.machines import Bench, actuator, bench, relay, sensor, switch, timer, wired
from umo import BinaryActuator, Compound, DigitalActuator, DigitalSensor, Interlock, connect, published
from umo.clients.page.watched_run import Watched
from umo.duration import lasting
from umo.errors import FramesError, PathError
from umo.objects.presentation.described import Described
from umo.objects.presentation.rows import folded, quality_of, value_of
from umo.states import OnOff
from umo.system.device_record import DeviceRecord, Ended
from umo.testing import Scripted, VirtualTimer, periods
from umo.wiring.patterns import chosen
from umo_command.app import app
from umo_command.run.follow import _name_other_runs
from umo_command.show import stations
from umo_command.show.stations import attach, how_ended
from umo_command.show.traces import Traces, spark, traced_span
from umo_command.show.values_live import WatchScreen, parse, pressed


@contextmanager
def running(name: str = "press", box: Scripted | None = None, count: int = 20) -> Iterator[Any]:
    """A station that this process runs and publishes."""
    m = bench()
    connection = connect(m, wired(m, box or Scripted({"encoder": range(1, 500)}), clock=VirtualTimer([0, 2])))
    with connection, published(connection, name, "rig"):
        periods(m, count)
        yield m


def umo(*words: str) -> Result:
    return CliRunner().invoke(app, words)


def said(result: Result) -> str:
    return " ".join((result.stdout + result.stderr).split())


def test_ps_lists_what_runs() -> None:
    with running():
        result = umo("show", "stations")
        assert result.exit_code == 0
        for word in ("press (rig)", "running", "1 ms", "20", "2"):
            assert word in result.stdout
        (line,) = json.loads(umo("show", "stations", "--json").stdout)["running"]
        assert (line["station"], line["periods"], line["missed"]) == ("press", 20, 2)
        assert (line["state"], line["mode"], line["lease"]) == ("running", None, None)
    assert said(umo("show", "stations")) == "no station is running"


def test_a_station_without_actions_says_so() -> None:
    with running():
        assert said(umo("do", "press", "call")) == "press has no actions"


def test_ps_names_the_machines_that_stand_stopped() -> None:
    run = DeviceRecord(["bus 1"], "press", "rig")
    run.begin(False)
    run.stopped("the control process hung", ["motor"])
    found = said(umo("show", "stations"))
    assert found.startswith("no station is running must be acknowledged: press (rig), not reached: motor, bus 1, 2")
    assert (
        "Inspect the machine. Then start it with --acknowledge, or use `umo do STATION acknowledge`. `umo show "
        "stations --json` shows the causes." in found
    )
    assert '"what": "the control process hung"' in umo("show", "stations", "--json").stdout


def test_ps_says_in_one_line_of_a_machine_what_matters() -> None:
    run = DeviceRecord([f"bus {'1' * 200}"], "press", "rig")
    run.begin(False)
    run.stopped("the control process hung\n" * 20, [f"axis {number}" for number in range(50)])
    (line,) = [line for line in umo("show", "stations").stdout.splitlines() if "press" in line]
    assert line.startswith("must be acknowledged: press (rig), not reached: axis 0, axis 1 and 48 others, bus 1")
    assert len(line) <= 160


def test_while_a_station_runs_many_machines_that_stand_stopped_are_only_counted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ended = [Ended(f"port {n}", "tank", "", "stopped", float(n)) for n in range(8)]
    monkeypatch.setattr(stations, "all_standing", lambda: ended)
    with running():
        for words in ((), ("show", "stations")):
            lines = [line for line in umo(*words).stdout.splitlines() if "acknowledge" in line]
            assert lines == ["must be acknowledged: 8 machines; `umo show stations --json` lists them"]
        assert len(json.loads(umo("show", "stations", "--json").stdout)["stopped"]) == 8


def test_watch_once_shows_every_object_with_its_unit() -> None:
    with running() as m:
        m.motor.write(2.5)
        periods(m)
        result = umo("show", "values", "--once")
    assert result.exit_code == 0
    text = said(result)
    assert "press (rig)" in text
    assert "motor 2.5 V" in text
    assert "valve OFF" in text
    assert "missed: 2" in text


def test_terminal_notebook_and_page_say_the_same_of_a_run() -> None:
    with running() as m:
        m.motor.write(2.5)
        periods(m)
        seen, listed, got = (
            umo("show", "values", "--once").stdout,
            umo("show", "stations").stdout,
            umo("device", "get", "press", "motor", "encoder").stdout,
        )
        with attach("press") as reader, attach("press") as other:
            notebook = reader.html()
            page = json.loads(Watched(other).state(full=True))["facts"]
            facts = {name: text for name, text in reader.facts(reader.latest()).items() if text}
            rows = reader.rows(reader.latest(), [reader.index("motor"), reader.index("encoder")])
    assert list(facts)[:4] == ["state", "time", "period", "missed"]
    for name in ("state", "time", "period", "missed"):
        assert f"{name}: {facts[name]}" in seen
        assert f"{name}: {facts[name]}" in notebook
        assert page[name] == facts[name]
        assert facts[name] in listed or name == "time"
    assert [value_of([row]) for row in rows] == ["2.5 V", "11.0 mm"]
    for row in rows:
        assert value_of([row]) in seen
        assert value_of([row]) in notebook
        assert f"{row.about.path:7}  {value_of([row])}  {quality_of([row])}" in got


class Guarded(Bench):
    def interlocks(self) -> list[Interlock]:
        return [Interlock(lambda: True, [self.motor, self.valve], "the guard is open")]


def test_watch_tells_what_is_inhibited_and_why() -> None:
    m = Guarded(timer=timer(), motor=actuator(), encoder=sensor(), valve=relay(), limit=switch())
    connection = connect(m, wired(m, Scripted({})))
    with connection, published(connection, "press", "rig"):
        periods(m, 2)
        result = umo("show", "values", "press", "--once")
        with attach("press") as reader:
            screen = WatchScreen(reader, chosen(reader.paths, ["encoder", "motor"], "press"))
            lines = drawn(screen.screen(Console(), False))
    assert "motor 0.0 V ⊘ inhibited" in said(result)
    assert "valve OFF ⊘ inhibited" in said(result)
    assert "⊘ inhibited: the guard is open: motor and valve" in said(result)
    assert lines[-2:] == ["⊘ inhibited: the guard is open: motor", lines[-1]]


def test_watch_takes_objects_and_compounds() -> None:
    with running(), attach(None) as reader:
        assert [reader.paths[row] for row in chosen(reader.paths, ["valve", "encoder"], "press")] == [
            "valve",
            "encoder",
        ]
        with pytest.raises(PathError, match="did you mean 'motor'"):
            chosen(reader.paths, ["moter"], "press")
    with running():
        result = umo("show", "values", "press", "moter")
        assert result.exit_code == 2
        assert "there is no object or signal 'moter'" in said(result)


def test_watch_takes_paths_alone_where_one_station_runs() -> None:
    with running():
        result = umo("show", "values", "valve", "--once")
        assert result.exit_code == 0
        assert "valve" in result.stdout
        assert "motor" not in result.stdout


def test_watch_says_which_stations_there_are() -> None:
    result = umo("show", "values", "press")
    assert (result.exit_code, "no station is running" in said(result)) == (2, True)
    assert said(result).endswith("start one in real time with `umo run STATION --realtime`")
    with running():
        result = umo("show", "values", "pres")
        assert result.exit_code == 2
        assert "'pres' is not running (did you mean 'press'?); running: press" in said(result)
    with running(), running("mill"), pytest.raises(FramesError, match="several stations are running"):
        attach(None)


def drawn(shown: Any, width: int = 80, height: int = 24) -> list[str]:
    console = Console(width=width, height=height, record=True, file=StringIO())
    console.print(shown)
    return [line.rstrip() for line in console.export_text().splitlines()]


def test_a_trace_follows_the_values() -> None:
    with running(count=0) as m, attach("press") as reader:
        picture = WatchScreen(reader, chosen(reader.paths, ["encoder", "valve"], "press"))
        periods(m, 3000)
        assert picture.update() is False
        assert picture._frame["number"] > 1000
        low, high = picture.traces.of([0])
        assert len(low) >= 3
        assert (low <= high).all()
        lines = drawn(picture.whole())
        assert max(map(len, lines)) <= 80
        assert any("encoder" in line and "mm" in line for line in lines)


def test_a_trace_keeps_extremes_without_values_that_are_missing() -> None:
    traces, plain = Traces(2), Described({})
    assert spark(traces.of([0]), plain) == traced_span(traces.of([0]), plain) == ""
    times = np.arange(0.0, 40.0, 0.5)
    traces.add(times, np.column_stack([times, np.full(len(times), np.nan)]))
    low, high = traces.of([0, 1])
    assert (low.tolist(), high.tolist()) == (list(range(24, 40)), [second + 0.5 for second in range(24, 40)])
    assert traced_span((low, high), plain) == "24 to 39.5"
    assert traced_span((low, high), Described({"resolution": 0.25})) == "24.00 to 39.50"
    assert spark((low, high), plain) == "▁▁▂▂▃▃▄▄▅▅▆▆▇▇██"
    assert len(traces.of([1])[0]) == 0


def test_a_trace_of_a_slow_station_covers_no_more_than_its_heading_says() -> None:
    traces = Traces(1)
    for second in range(0, 90, 6):
        traces.add(np.array([float(second)]), np.array([[float(second)]]))
    assert traces.of([0])[0].tolist() == [72.0, 78.0, 84.0]
    traces.add(np.array([1000.0]), np.array([[1.0]]))
    assert traces.of([0])[0].tolist() == [1.0]


@pytest.mark.parametrize(
    ("error", "text", "style"),
    [
        (None, "press has ended: the application has ended", ""),
        (KeyError("x"), "press has ended: KeyError: 'x'", "red"),
    ],
)
def test_the_end_of_a_run_is_told_with_its_cause(error: Exception | None, text: str, style: str) -> None:
    with suppress(KeyError), running(count=2):
        reader = attach("press")
        if error is not None:
            raise error
    with reader:
        told = how_ended(reader)
    assert told.plain.startswith(text)
    assert told.style == style


class Zone(Compound):
    heater: DigitalActuator
    temperature: DigitalSensor
    fan: BinaryActuator[OnOff]


class Furnace(Compound):
    zones: tuple[Zone, ...]
    alarm: BinaryActuator[OnOff]
    timer: DigitalSensor


@contextmanager
def furnace(count: int = 40) -> Iterator[tuple[Furnace, WatchScreen]]:
    """All temperatures differ; that of the last zone but one is out of range."""
    zones = (Zone(heater=actuator(), temperature=sensor(), fan=relay()) for _ in range(count))
    m = Furnace(zones=tuple(zones), alarm=relay(), timer=timer())
    box = Scripted({f"zones.{i}.temperature": i for i in range(count)})
    connection = connect(m, wired(m, box))
    with connection, published(connection, "furnace", ""):
        box.set(f"zones.{count - 2}.temperature", 300)
        m.zones[1].fan.write(OnOff.ON)
        periods(m, 2)
        with attach("furnace") as reader:
            picture = WatchScreen(reader, list(range(len(reader.paths))))
            picture.update()
            yield m, picture


def test_the_like_objects_of_a_list_are_one_line_with_range_and_worst_quality() -> None:
    with furnace() as (_, picture):
        lines = drawn(picture.screen(Console(height=24), keys=True), 100)
    (temperature,) = (line for line in lines if "temperature" in line)
    assert temperature.split()[:7] == ["▸", "zones[0..39].temperature", "0.0", "to", "150.0", "mm", "▲"]
    assert "▲ 1 out of range" in temperature
    (fan,) = (line for line in lines if "fan" in line)
    assert "▸ zones[0..39].fan" in fan
    assert "1 ON, 39 OFF" in fan
    assert "lines 1 to 5 of 5" in lines[-1]
    assert len(lines) < 24


def test_a_family_is_unfolded_and_scrolled_by_keys() -> None:
    with furnace() as (_, picture):
        console, view = Console(height=24), picture.view
        names = lambda: [line.name for line in view.visible(18)]  # noqa: E731
        while "temperature" not in view.lines[view.cursor].name:
            view.press("down", 18)
        at = view.cursor
        view.press("enter", 18)
        assert len(view.lines) == 45
        assert names()[at : at + 2] == ["▾ zones[0..39].temperature", "  zones.0.temperature"]
        view.press("end", 18)
        assert names()[-1] == view.lines[-1].name
        assert len(names()) == 18
        lines = drawn(picture.screen(console, keys=True), 100)
        assert len(lines) == 24
        assert "lines 28 to 45 of 45" in lines[-1]
        view.press("page up", 18)
        view.press("up", 18)
        assert view.lines[view.cursor].name in names()
        view.press("home", 18)
        view.press("up", 18)
        names()
        assert (view.cursor, view.top) == (0, 0)
        view.press("all", 18)
        assert len(view.lines) == 5
        view.press("all", 18)
        assert len(view.lines) == 3 + 40 * 3 + 2


@pytest.mark.parametrize("width", [60, 70, 80, 100, 120])
def test_columns_that_do_not_fit_are_left_out_and_no_value_is_cut(width: int) -> None:
    with furnace() as (_, picture):
        lines = drawn(picture.screen(Console(width=width, height=24)), width)
    assert all("0.0 to 150.0 mm ▲ 1 out of range" in line for line in lines if "temperature" in line)
    assert not any("…" in line for line in lines[:-1])
    assert ("raw" in lines[3]) == (width >= 100)


def test_one_line_is_seen_even_on_the_smallest_terminal() -> None:
    with furnace() as (_, picture):
        assert any("zones" in line for line in drawn(picture.screen(Console(height=3)), 100, 3))


def test_patterns_choose_and_what_is_not_shown_is_said() -> None:
    with furnace(3):
        result = umo("show", "values", "zones.*.temperature", "--once")
        assert result.exit_code == 0
        assert [line.split()[0] for line in result.stdout.splitlines() if "temperature" in line] == [
            f"zones.{i}.temperature" for i in range(3)
        ]
        assert "8 others not shown" in result.stdout
        assert "not shown" not in umo("show", "values", "--once").stdout
        result = umo("show", "values", "zones.*.temperatur", "--once")
        assert result.exit_code == 2
        assert "did you mean 'zones.*.temperature'?" in said(result)


@pytest.mark.parametrize(
    ("wanted", "found"),
    [
        ([], [0, 1, 2, 3, 4]),
        (["z"], [4]),
        (["zones.1"], [2, 3]),
        (["*.1"], [2, 3]),
        (["zones.*.t", "zones"], [0, 2, 1, 3]),
        (["*"], [0, 1, 2, 3, 4]),
    ],
)
def test_paths_name_objects_compounds_and_patterns_each_once(wanted: list[str], found: list[int]) -> None:
    known = ["zones.0.t", "zones.0.fan", "zones.1.t", "zones.1.fan", "z"]
    assert chosen(known, wanted, "press") == found


@pytest.mark.parametrize("missing", ["zone", "zones.*.*.*", "zones.2", ""])
def test_a_path_that_names_nothing_is_refused(missing: str) -> None:
    with pytest.raises(PathError, match="there is no object or signal"):
        chosen(["zones.0.t", "zones.1.t"], [missing], "press")


def test_a_family_is_named_by_the_spans_of_its_numbers() -> None:
    assert folded(["zones.0.t", "zones.1.t", "zones.12.t"]) == "zones[0..1, 12].t"
    assert folded(["zones.9.t", "zones.10.t", "zones.11.t"]) == "zones[9..11].t"
    assert folded(["cells.2.axes.0.m", "cells.2.axes.1.m"]) == "cells.2.axes[0..1].m"


def test_keys_are_told_apart_in_what_a_terminal_sends() -> None:
    assert parse(b"\x1b[A\x1b[B\x1b[5~\x1b[6~\x1b[H\x1bOFq") == [
        "up", "down", "page up", "page down", "home", "end", "quit",
    ]  # fmt: skip
    assert parse(b"\x1b[1;5Cx\x1b\xc3\xa4 \x1b[200") == ["enter"]


def test_without_a_terminal_there_are_no_keys() -> None:
    with pressed() as wait:
        assert wait is None


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="keys are read on Linux")
def test_a_terminal_gives_keys_and_is_left_as_it_was(monkeypatch: pytest.MonkeyPatch) -> None:
    import termios

    keyboard, terminal = os.openpty()
    with os.fdopen(terminal) as stdin, os.fdopen(keyboard, "wb", buffering=0) as writer:
        monkeypatch.setattr(sys, "stdin", stdin)
        before = termios.tcgetattr(stdin)
        with pressed() as wait:
            assert wait is not None
            assert wait(0.0) == []
            writer.write(b"q")
            assert wait(5.0) == ["quit"]
        assert termios.tcgetattr(stdin) == before


@pytest.mark.parametrize(
    ("seconds", "text"), [(5, "5 s"), (600, "10 min"), (7500, "2 h 05 min"), (3 * 86400 + 3700, "3 d 1 h")]
)
def test_how_long_is_said_shortly(seconds: float, text: str) -> None:
    assert lasting(seconds) == text


def test_why_without_a_box_says_how_to_get_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # no run is recorded there
    result = umo("show", "why")
    assert result.exit_code == 2
    assert "no black box yet" in said(result)


def test_why_now_keeps_a_box_of_what_runs() -> None:
    with running(count=60):
        result = umo("show", "why", "--now")
    assert result.exit_code == 0
    text = said(result)
    assert "press (rig)" in text
    assert "on demand" in text
    assert umo("show", "why", "press").exit_code == 0
    assert umo("show", "why", "mill").exit_code == 2
    assert umo("show", "why", "--file", "nothing.box").exit_code == 2


def test_another_run_of_the_station_is_named_with_the_pids_that_commands_need(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with running(), running("mill"), attach("press") as reader:
        started: Any = SimpleNamespace(frames=reader, pid=os.getpid())
        _name_other_runs(started)
        assert capsys.readouterr().err == ""  # it is this run itself
        started.pid = 4711
        _name_other_runs(started)
    text = " ".join(capsys.readouterr().err.split())
    assert text.startswith(f"umo: press runs already (pid {os.getpid()}); each run has its own devices or simulation. ")
    assert text.endswith("This run has pid 4711: use the pid instead of the name in commands, as in umo do 4711")
