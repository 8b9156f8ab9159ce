"""What notebooks show of objects, machines and running stations; live tables and scopes."""

from __future__ import annotations

import gc
import re
import subprocess
import sys
import threading
import time
import weakref
from collections.abc import Iterator
from contextlib import contextmanager
from html.parser import HTMLParser
from pathlib import Path
from types import ModuleType
from typing import Annotated, Any

import numpy as np
import pytest

import umo
from helpers.documents import ROOT, blocks
from helpers.machines import bench, relay, sensor, switch, wired
from helpers.patient import conveyor
from helpers.waiting import until
from umo import Compound, DigitalSensor, Number, Vector, connect, published
from umo.clients.remote import RemoteStation
from umo.errors import DeclarationError, FramesError, PathError, RangeError
from umo.operation.commands.client_commands import Mode
from umo.operation.commands.client_control import ClientControl
from umo.process.frames import Reader, blackbox
from umo.process.frames.client_memory import ClientMemory
from umo.process.frames.command_queue import Receiver
from umo.process.start import LINUX
from umo.recording.scope.svg import Scope
from umo.testing import Scripted, VirtualTimer, periods


class Table(HTMLParser):
    """The rows of a table by the object's path, each with its cells by heading; the text of the heading line. Fails for
    markup that is not closed."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.heading, self.rows, self.columns = "", {}, []
        self._cells: list[str] = []
        self._open: list[str] = []
        self.feed(re.sub(r"<style>.*?</style>", "", html))
        assert self._open == []

    def handle_starttag(self, tag: str, attributes: Any) -> None:
        self._open.append(tag)
        if tag in ("td", "th"):
            self._cells.append("")

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop() == tag
        if tag == "tr" and not self.columns:
            self.columns, self._cells = self._cells, []
        elif tag == "tr":
            self.rows[self._cells[0]] = dict(zip(self.columns[1:], self._cells[1:], strict=True))
            self._cells = []

    def handle_data(self, data: str) -> None:
        if {"td", "th"} & set(self._open):
            self._cells[-1] += data
        else:
            self.heading += data


def shown(thing: Any) -> Table:
    return Table(thing._repr_html_())


@contextmanager
def running(m: Compound | None = None, box: Scripted | None = None, count: int = 20) -> Iterator[tuple[Any, Any]]:
    """A station that this process publishes, and what `attach` gives of it."""
    m = m or bench()
    connection = connect(m, wired(m, box or Scripted({"encoder": range(1, 100_000)}), clock=VirtualTimer()))
    with connection, published(connection, "press", "rig"):
        periods(m, count)
        with umo.attach("press") as station:
            yield m, station


# Declarations and connected machines --------------------------------------------------------------------


def test_a_declaration_shows_kinds_and_ranges() -> None:
    table = shown(bench())
    assert table.heading.split() == ["Bench", "state:", "not", "connected"]
    assert table.rows["motor"] == {"kind": "digital actuator", "range": "-10 to 10 V, default 0 V"}
    assert table.rows["valve"] == {"kind": "binary actuator", "range": "OFF or ON, default OFF"}
    assert shown(bench().encoder).rows == {"encoder": {"kind": "digital sensor", "range": "0 to 100 mm"}}


def test_a_connected_machine_shows_what_was_read_and_sent_last(each_way: None) -> None:
    m = bench()
    box = Scripted({"encoder": [20, 40]})
    connection = connect(m, wired(m, box, clock=VirtualTimer([0, 3]), entries={"valve": {"inverted": True}}))
    with connection:
        m.motor.write(5.0)
        m.cycle.progress("pressing", done=1, total=3)
        periods(m)
        calls = len(box.calls)
        table = shown(m)
        assert table.rows["encoder"] == {"value": "20.0 mm", "quality": "● good", "raw": "40", "wiring": "box:encoder"}
        assert table.rows["motor"]["value"] == "5.0 V"
        assert table.rows["valve"] == {"value": "OFF", "quality": "● good", "raw": "1", "wiring": "box:valve inverted"}
        assert "state: running · progress: pressing, 1 of 3 · time: 0.001 s · missed: 0" in table.heading
        periods(m)
        assert "missed: 3" in shown(connection).heading
        assert shown(m.motor).rows == {"motor": table.rows["motor"]}
        assert list(shown(Vector([m.encoder])).rows) == ["encoder"]
        assert len(box.calls) == calls + 2, "only the loop has called the driver"
    assert "not connected" in shown(m).heading


def test_an_asynchronous_sensor_is_not_read() -> None:
    m = bench(encoder=sensor(synchronous=False))
    box = Scripted()
    with connect(m, wired(m, box, clock=VirtualTimer())):
        calls = len(box.calls)
        shown(m)
        shown(m.encoder)
        assert len(box.calls) == calls


def test_a_value_that_is_not_good_says_why_beside_sign_and_name() -> None:
    m = bench(encoder=sensor(on_error="mark", incremental=True), limit=switch(on_error="mark"))
    with connect(m, wired(m, box := Scripted({"encoder": [300]}), clock=VirtualTimer())):
        periods(m)
        row = shown(m).rows["encoder"]
        assert (row["quality"], row["note"]) == ("◇ unreferenced", "not homed")
        m.encoder.referenced()
        periods(m)
        row = shown(m).rows["encoder"]
        assert (row["quality"], row["note"]) == ("▲ out of range", "beyond its range")
        box.set("encoder", OSError("unplugged"))
        periods(m)
        row = shown(m).rows["encoder"]
        assert (row["quality"], row["note"]) == ("✕ bad", "the device failed, or was not read yet")
        assert "<b>✕ bad</b>" in m._repr_html_()


class Zone(Compound):
    heater: umo.DigitalActuator
    temperature: DigitalSensor


class Oven(Compound):
    """Names and texts that are markup."""

    zones: tuple[Zone, ...]
    fans: dict[str, umo.BinaryActuator[umo.states.OnOff]]
    timer: DigitalSensor
    speed: Annotated[float, Number("m/s", 1.0, 5.0, tunable=True)] = 3.0

    def interlocks(self) -> list[umo.Interlock]:
        return [umo.Interlock(lambda: True, [self.fans["<b>&"]], "door <open> & hot")]


def oven(count: int = 4) -> Oven:
    b = bench()
    zone = type(b.motor)
    zones = tuple(
        Zone(heater=zone("V", default=0.0, minimum=0.0, maximum=10.0, resolution=0.5), temperature=sensor())
        for _ in range(count)
    )
    return Oven(zones=zones, fans={"<b>&": relay()}, timer=DigitalSensor(
        "sampling_period", minimum=0.0, maximum=99_999.9, resolution=1.0, synchronous=False))  # fmt: skip


def test_like_objects_of_lists_share_a_line() -> None:
    with running(oven(), Scripted({f"zones.{i}.temperature": 2 * i for i in range(4)})) as (m, station):
        for table in (shown(m), shown(station)):
            assert table.rows["zones[0..3].temperature"]["value"] == "0.0 to 3.0 mm"
            wiring = table.rows["zones[0..3].temperature"]["wiring"]
            assert wiring == "box:zones.0.temperature .. box:zones.3.temperature"
        assert set(shown(station.zones[1]).rows) == {"zones.1.heater", "zones.1.temperature"}


def test_texts_are_escaped() -> None:
    with running(oven()) as (m, station):
        m.cycle.progress("<script>alert(1)</script>")
        periods(m)
        for html in (m._repr_html_(), station._repr_html_(), Scope(station.reader, ["fans"], 1.0).draw({})):
            assert "<script" not in html
            assert "<b>&" not in html
            assert "&lt;b&gt;&amp;" in html
        row = shown(station).rows["fans.<b>&"]
        assert row["note"] == "⊘ inhibited: door <open> & hot"


def test_a_table_of_very_many_lines_is_cut() -> None:
    row = {"unit": "V"}
    from umo.objects.presentation.described import Described
    from umo.objects.presentation.html_table import html_table
    from umo.objects.presentation.rows import TableRow

    html = html_table("many", {}, [TableRow(Described(row | {"path": f"object{n}x"}), 1.0) for n in range(1000)])
    assert len(Table(html).rows) == 200
    assert "and 800 more" in html


def test_nothing_that_a_table_meets_raises(monkeypatch: pytest.MonkeyPatch) -> None:
    m = bench()
    with connect(m):
        monkeypatch.setattr(type(m._machine), "facts", lambda self: 1 / 0)
        shown = m._repr_html_()
        assert shown.startswith("<div><b>Bench</b> cannot be shown: ZeroDivisionError: division by zero (")


def test_an_object_of_an_attached_station_is_read_in_another_unit_like_that_of_the_machine() -> None:
    with running() as (m, station):
        assert station.encoder.read_in("cm") == m.encoder.read_in("cm") == m.encoder.read() / 10
        assert station.encoder.read_in("mm") == station.encoder.read()
        for encoder in (station.encoder, m.encoder):
            with pytest.raises(DeclarationError, match="'mm' cannot be converted to 'V'"):
                encoder.read_in("V")
        with pytest.raises(RangeError, match="valve has states, so it has no unit"):
            station.valve.read_in("mm")


# Running stations and black boxes -----------------------------------------------------------------------


def test_a_station_its_parts_and_objects_show_the_last_frame() -> None:
    with running() as (_, station):
        table = shown(station)
        assert (
            table.heading.strip()
            == "press (rig) \u2002state: running · time: 0.020 s · period: 1 ms · missed: 0".strip()
        )
        assert table.rows["encoder"] == {"value": "10.5 mm", "quality": "● good", "raw": "21", "wiring": "box:encoder"}
        assert shown(station.encoder).rows == {"encoder": table.rows["encoder"]}
        assert shown(station.reader).rows == table.rows


def test_mode_lease_and_tunable_numbers_are_shown() -> None:
    m = oven()
    connection = connect(m, wired(m, Scripted(), clock=VirtualTimer()))
    with connection, published(connection, "press") as ring:
        reader = Reader(ring.path)
        assert reader.ends is not None
        cells = ClientMemory(reader.ends.cells, reader.layout)
        clients = connection.machine.attach(ClientControl(Receiver(cells), cells, Mode.MANUAL))
        clients.lease.acquire("anna & bert", "key", 60.0, 0.0)
        periods(m)
        with reader:
            assert "mode: manual · lease: anna & bert" in shown(reader).heading
            assert (
                shown(reader).rows["speed"] | {"value": "3 m/s", "note": "tunable, 1 to 5"}
                == shown(reader).rows["speed"]
            )
        assert "mode: manual · lease: anna & bert" in shown(m).heading
        clients.lease.end()
        assert "lease: free" in shown(m).heading
        cells.close()


def test_tunable_numbers_are_there_from_the_first_frame_on() -> None:
    with running(oven(), count=0) as (_, station):
        assert station.speed == 3.0


def test_a_station_that_has_ended_keeps_its_last_values_and_says_so() -> None:
    with running() as (_, station):
        reader = station.reader.again()
    with reader:
        assert "state: ended" in shown(reader).heading
        assert shown(reader).rows["encoder"]["value"] == "10.5 mm"


def test_a_station_that_is_silent_says_for_how_long(monkeypatch: pytest.MonkeyPatch) -> None:
    with running() as (_, station):
        assert "no frame for" not in shown(station).heading
        now = time.monotonic_ns()
        monkeypatch.setattr("umo.process.frames.run_reader.time.monotonic_ns", lambda: now + 5_000_000_000)
        assert re.search(r"no frame for: [5-9] s", shown(station).heading)


def test_a_station_without_a_frame_and_one_that_is_detached_say_so() -> None:
    with running(count=0) as (_, station):
        table = shown(station)
        assert "no period has ended yet" in table.heading
        assert table.rows["encoder"]["value"] == "-"
        encoder = station.encoder
        station.close()
        assert station._repr_html_().endswith("cannot be shown: press (rig) is detached</div>")
        assert repr(station).endswith("detached>")
        assert "press (rig) is detached" in encoder._repr_html_()


def test_a_black_box_says_why_it_was_kept(tmp_path: Path) -> None:
    with running() as (_, station):
        blackbox.save(station.reader, tmp_path / "press.box", "a period was missed")
    with Reader(tmp_path / "press.box") as reader:
        assert "state: ended" in shown(reader).heading
        assert "kept because: a period was missed" in shown(reader).heading
        assert shown(reader).rows["encoder"]["wiring"] == "box:encoder"


def test_keys_and_paths_are_completed_in_brackets() -> None:
    with running(oven()) as (_, station):
        assert {"zones", "speed", "zones.0.heater"} <= set(station._ipython_key_completions_())
        assert {0, 3, "1.temperature"} <= set(station.zones._ipython_key_completions_())
        assert {"zones", "fans", "speed"} <= set(dir(station))


# The scope ----------------------------------------------------------------------------------------------


def test_the_scope_has_a_lane_for_each_unit_and_a_bar_for_each_binary_object() -> None:
    with running() as (_, station):
        html = Scope(station.reader, ["encoder", "motor", "valve", "limit"], 0.02).draw({})
        assert html.count("<g ") == 4
        assert [
            text for text in ("encoder  10.5 mm", "motor  0.0 V", "valve  OFF", "limit  PASS") if text not in html
        ] == []
        assert Scope(station.reader, ["timer", "encoder"], 0.02).draw({}).count("<g ") == 2
        Table(html)  # every element is closed


def test_the_scope_names_the_last_value_not_the_greatest_of_the_last_pixel() -> None:
    with running(box=Scripted({"encoder": [*[200] * 15, 0]})) as (_, station):
        assert "encoder  0.0 mm" in Scope(station.reader, ["encoder"], 60.0).draw({})


def test_one_sample_is_seen_in_a_minute_of_others() -> None:
    m = bench()
    readings = [0] * 3000
    readings[1500] = 200
    with running(m, Scripted({"encoder": readings, "limit": [int(each > 0) for each in readings]}), 1990) as (
        _,
        station,
    ):
        scope = Scope(station.reader, ["encoder", "limit"], 60.0)
        before = scope.draw({})
        (curve,) = re.findall(r'<path d="(M[^"h]+)" fill', before)
        heights = [float(y) for y in re.findall(r"(?:[ML][\d.]+ |V)([\d.]+)", curve)]
        assert min(heights) < 30, "the peak reaches the top of its lane"
        assert sum(y > 115 for y in heights) > 20
        (bar,) = re.findall(r"<rect [^>]*>", before)
        assert 'opacity="0.25"' in bar, "both states within one pixel"


def test_what_is_bad_has_no_value_on_the_scope() -> None:
    m = bench(encoder=sensor(on_error="mark"), limit=switch(on_error="mark"))
    box = Scripted({"encoder": [10]})
    with running(m, box) as (_, station):
        scope = Scope(station.reader, ["encoder"], 0.1)
        scope.draw({})
        box.set("encoder", OSError("unplugged"))
        periods(m, 20)
        assert "encoder  -" in scope.draw({})
        assert np.isnan(scope._history.between(0.03, 0.04, [0])[1]).all()


@pytest.mark.parametrize(
    ("paths", "seconds", "error", "text"),
    [
        (["encodr"], 1.0, PathError, r"there is no object or signal 'encodr' \(did you mean 'encoder'\?\) in press"),
        (["encoder"], 0.0, RangeError, "seconds: 0.0 must be above 0 and at most 300"),
        (["encoder"], float("nan"), RangeError, "seconds: nan"),
    ],
)
def test_a_scope_that_cannot_be_is_refused(paths: list[str], seconds: float, error: type, text: str) -> None:
    with running() as (_, station), pytest.raises(error, match=text):
        Scope(station.reader, paths, seconds)


def test_a_scope_of_too_many_traces_is_refused() -> None:
    with (
        running(oven(20)) as (_, station),
        pytest.raises(PathError, match="40 objects and signals; a scope shows at most"),
    ):
        Scope(station.reader, ["zones"], 1.0)


# Live ---------------------------------------------------------------------------------------------------


class Screen:
    """IPython's display, without IPython."""

    def __init__(self) -> None:
        self.pictures: list[str] = []
        self.gone = False

    def display(self, data: dict[str, str], *, raw: bool, display_id: bool) -> Screen:
        self.update(data, raw=raw)
        return self

    def update(self, data: dict[str, str], *, raw: bool) -> None:
        assert raw
        if self.gone:
            raise RuntimeError("the notebook was closed")
        self.pictures.append(data["text/html"])


@pytest.fixture
def screen(monkeypatch: pytest.MonkeyPatch) -> Screen:
    """A notebook whose pictures are kept; drawn as often as it can be."""
    screen = Screen()
    ipython, display = ModuleType("IPython"), ModuleType("IPython.display")
    vars(ipython)["get_ipython"] = lambda: object()
    vars(display)["display"] = screen.display
    monkeypatch.setitem(sys.modules, "IPython", ipython)
    monkeypatch.setitem(sys.modules, "IPython.display", display)
    monkeypatch.setattr("umo.clients.remote.live_view.MAX_RATE", 200.0)
    monkeypatch.setattr("umo.clients.remote.live_view.PAUSE_RATIO", 0)
    return screen


def test_a_live_table_follows_the_station_and_ends_with_it(screen: Screen) -> None:
    with running() as (m, station):
        table = station.live("encoder", "motor")
        assert set(Table(screen.pictures[0]).rows) == {"encoder", "motor"}
        assert table._ipython_display_() is None, "as the result of a cell it is not shown again"
        periods(m, 10)
        until(lambda: Table(screen.pictures[-1]).rows["encoder"]["value"] == "15.5 mm")
        assert table.live
        with pytest.raises(TimeoutError, match="press is still running"):
            table.wait(0.01)
    table.wait(20)
    assert "state: ended" in Table(screen.pictures[-1]).heading
    assert not table.live
    kept = weakref.ref(table)
    del table
    gc.collect()
    assert kept() is None


def test_a_live_scope_follows_until_it_is_stopped(screen: Screen) -> None:
    with running() as (m, station):
        scope = station.scope("encoder", "valve", seconds=0.1)
        periods(m, 10)
        until(lambda: "encoder  15.5 mm" in screen.pictures[-1])
        scope.stop()
        assert not scope.live
        assert "view: stopped" in screen.pictures[-1]
        count = len(screen.pictures)
        periods(m, 10)
        scope.stop()
        assert len(screen.pictures) == count


def test_a_live_view_ends_when_the_notebook_is_gone(screen: Screen) -> None:
    with running() as (_, station):
        table = station.live()
        screen.gone = True
        table.wait(20)


def test_a_live_view_ends_with_the_program(tmp_path: Path) -> None:
    (tmp_path / "IPython").mkdir()
    (tmp_path / "IPython" / "__init__.py").write_text("get_ipython = object")
    (tmp_path / "IPython" / "display.py").write_text(
        "class Handle:\n    def update(self, data, *, raw): print(data['text/html'], flush=True)\n"
        "def display(data, *, raw, display_id): return Handle()\n"
    )
    code = f"import sys\nsys.path.insert(0, {str(tmp_path)!r})\nimport umo\nview = umo.attach('press').live()"
    with running():
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stderr) == (0, "")
    assert "view: stopped" in Table(done.stdout.splitlines()[-1]).heading


def test_a_live_view_goes_on_when_the_station_was_detached_from(screen: Screen) -> None:
    with running() as (m, station):
        table = station.live("encoder")
        station.close()
        periods(m, 10)
        until(lambda: Table(screen.pictures[-1]).rows["encoder"]["value"] == "15.5 mm")
        table.stop()


def test_what_cannot_be_followed_is_refused_and_leaves_nothing_behind(screen: Screen) -> None:
    threads = threading.active_count()
    with running() as (_, station):
        with pytest.raises(PathError, match="there is no object or signal 'motr'"):
            station.live("motr")
        with pytest.raises(RangeError):
            station.scope("motor", seconds=-1)
        reader = station.reader.again()
        assert screen.pictures == []
    with reader, pytest.raises(FramesError, match="press has ended"):
        RemoteStation(reader).live()
    assert threading.active_count() == threads


def test_outside_of_a_notebook_one_line_says_what_to_do(monkeypatch: pytest.MonkeyPatch, screen: Screen) -> None:
    with running() as (_, station):
        terminal = type("TerminalInteractiveShell", (), {})()
        for shell in (None, terminal):
            monkeypatch.setattr(sys.modules["IPython"], "get_ipython", lambda shell=shell: shell)
            with pytest.raises(FramesError, match="a live view needs a notebook; in a terminal use `umo show values`"):
                station.live()
        monkeypatch.setitem(sys.modules, "IPython", None)
        with pytest.raises(
            FramesError, match=re.escape('a live view needs IPython: pip install ".[notebook]" in the clone of umo')
        ):
            station.scope("encoder")


# In a real notebook -------------------------------------------------------------------------------------


def executed(cells: list[str]) -> list[list[Any]]:
    """The outputs of each cell."""
    nbclient = pytest.importorskip("nbclient", reason="a notebook is run with nbclient, which is not installed")
    pytest.importorskip("ipykernel", reason='a notebook needs ipykernel: pip install ".[notebook]"')
    from nbformat.v4 import new_code_cell, new_notebook

    notebook = new_notebook(cells=[new_code_cell(text) for text in cells])
    nbclient.NotebookClient(notebook, timeout=120, kernel_name="python3").execute()
    return [cell.outputs for cell in notebook.cells]


PROCESSES = pytest.mark.skipif(not LINUX, reason="machines run in other processes on Linux only")


@PROCESSES
def test_a_run_that_failed_says_why() -> None:
    with umo.start("no-such-station") as run:
        until(lambda: run.outcome is not None)
        assert "state: ended · failure: there is no station 'no-such-station'" in shown(run).heading


@pytest.mark.full
@pytest.mark.slow
@PROCESSES
def test_the_cells_of_the_page_do_in_a_notebook_what_it_says(tmp_path: Path) -> None:
    page = ROOT / "docs" / "howto-notebooks.md"
    cells = [text for rest, text in blocks(page, "python")]
    started = 'umo.start("conveyor", '
    assert started in cells[1]
    cells[1] = cells[1].replace(started, f'umo.start("conveyor", {str(conveyor(tmp_path))!r}, ')
    complete = "from IPython import get_ipython\nprint(get_ipython().complete('station[\"sorter.belt.s')[1])"
    cells.insert(3, f"{complete}\nrun")
    outputs = executed(cells)
    (belt,) = outputs[1]
    assert Table(belt["data"]["text/html"]).rows["sorter.belt.speed"]["wiring"] == "plant:drive:speed"
    table, scope = outputs[2]
    assert Table(table["data"]["text/html"]).rows["sorter.diverter"]["value"] == "OFF"
    assert "state: ended" in Table(table["data"]["text/html"]).heading, "it was kept up to date to the end"
    assert "view: stopped" in Table(scope["data"]["text/html"]).heading
    completed = next(each for each in outputs[3] if each.get("name") == "stdout")
    (run,) = (each for each in outputs[3] if "data" in each)
    assert "sorter.belt.speed" in completed["text"]
    assert "state: running · mode: manual" in Table(run["data"]["text/html"]).heading
