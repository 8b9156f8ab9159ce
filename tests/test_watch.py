"""`umo ps` and `umo watch`: running stations seen from another terminal."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from typer.testing import CliRunner, Result

from machines import bench, wired
from umo import FramesError, PathError, connect, published
from umo.cli.app import app
from umo.cli.running import attach, lasting
from umo.cli.watch import Picture, _chosen
from umo.system.record import Record
from umo.testing import Scripted, VirtualTimer, periods


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
        result = umo("ps")
        assert result.exit_code == 0
        for word in ("press (rig)", "running", "1 ms", "20", "2"):
            assert word in result.stdout
        (line,) = json.loads(umo("ps", "--json").stdout)["running"]
        assert (line["station"], line["periods"], line["missed"]) == ("press", 20, 2)
    assert said(umo("ps")) == "no station is running"


def test_ps_names_the_machines_that_stand_stopped() -> None:
    run = Record(["bus 1"], "press", "rig")
    run.begin(False)
    run.stopped("the control process hung", ["motor"])
    found = said(umo("ps"))
    assert "stands stopped: press (rig) on bus 1 was stopped at" in found
    assert "the control process hung; not reached: motor (start it with --acknowledge)" in found


def test_watch_once_shows_every_object_with_its_unit() -> None:
    with running() as m:
        m.motor.write(2.5)
        periods(m)
        result = umo("watch", "--once")
    assert result.exit_code == 0
    text = said(result)
    assert "press (rig)" in text
    assert "motor 2.5 V" in text
    assert "valve OFF" in text
    assert "missed 2" in text


def test_watch_takes_objects_and_compounds() -> None:
    with running(), attach(None) as reader:
        assert [reader.paths[row] for row in _chosen(reader, ["valve", "encoder"])] == ["valve", "encoder"]
        with pytest.raises(PathError, match="did you mean 'motor'"):
            _chosen(reader, ["moter"])
    with running():
        result = umo("watch", "press", "moter")
        assert result.exit_code == 2
        assert "no object or signal 'moter'" in said(result)


def test_watch_takes_paths_alone_where_one_station_runs() -> None:
    with running():
        result = umo("watch", "valve", "--once")
        assert result.exit_code == 0
        assert "valve" in result.stdout
        assert "motor" not in result.stdout


def test_watch_says_which_stations_there_are() -> None:
    result = umo("watch", "press")
    assert (result.exit_code, "no station is running" in said(result)) == (2, True)
    with running():
        result = umo("watch", "pres")
        assert result.exit_code == 2
        assert "'pres' is not running (did you mean 'press'?); running: press" in said(result)
    with running(), running("mill"), pytest.raises(FramesError, match="several stations are running"):
        attach(None)


def test_a_trace_follows_the_values() -> None:
    with running(count=0) as m, attach("press") as reader:
        picture = Picture(reader, _chosen(reader, ["encoder", "valve"]))
        periods(m, 3000)
        picture.take()
        assert picture._frame["number"] > 1000
        low, high = picture._traces[reader.index("encoder")][-1]
        assert low <= high
        from rich.console import Console

        console = Console(width=80, record=True)
        console.print(picture.draw())
        lines = console.export_text().splitlines()
        assert max(map(len, lines)) <= 80
        assert any("encoder" in line and "mm" in line for line in lines)


@pytest.mark.parametrize(
    ("seconds", "text"), [(5, "5 s"), (600, "10 min"), (7500, "2 h 05 min"), (3 * 86400 + 3700, "3 d 1 h")]
)
def test_how_long_is_said_shortly(seconds: float, text: str) -> None:
    assert lasting(seconds) == text


def test_why_without_a_box_says_how_to_get_one() -> None:
    result = umo("why")
    assert result.exit_code == 2
    assert "no black box yet" in said(result)


def test_why_now_keeps_a_box_of_what_runs() -> None:
    with running(count=60):
        result = umo("why", "--now")
    assert result.exit_code == 0
    text = said(result)
    assert "press (rig)" in text
    assert "on demand" in text
    assert umo("why", "press").exit_code == 0
    assert umo("why", "mill").exit_code == 2
    assert umo("why", "--file", "nothing.box").exit_code == 2
