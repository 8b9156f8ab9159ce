"""The rows of `make bench` do the same work: same readings and commands in, same values and raw integers out."""

from __future__ import annotations

from contextlib import AsyncExitStack, ExitStack
from types import SimpleNamespace
from typing import Any

import pytest
from rich.console import Console

from bench import against, bounds, faces, native, report, scan, zones
from bench.driver import Fill, Loop
from bench.drivers import kernel
from bench.drivers import table as drivers
from bench.drivers.case import SIZES, Case, NotHere
from bench.mix import layout, readings

needs_compiler = pytest.mark.skipif(native.missing() is not None, reason=str(native.missing()))
COUNTS = [13, 116]  # one manipulator; many, the last one cut off


def results(one: Any, count: int, seed: int) -> tuple[list[float], list[int]]:
    """Sensors' values and actuators' raw integers after one period, and after another in the three verbs."""
    plan = layout(count)
    one.load(readings(plan, seed))
    one.period(1)
    first = one.values(), one.raws()
    one.load(readings(plan, seed))
    one.write(2)
    one.sample_update(2)
    assert (one.values(), one.raws()) == first
    return first


@pytest.mark.parametrize("driver", [Loop, Fill])
@pytest.mark.parametrize("count", COUNTS)
def test_umo_and_the_hand_written_python_agree(count, driver):
    with ExitStack() as stack:
        rows = scan.implementations(count, driver, stack)
        values, raws = results(rows["a"], count, seed=7)
        assert (values, raws) == results(rows["d"], count, seed=7)
        assert len(values) + len(raws) == count
        assert len(set(values)) > 3
        assert len(set(raws)) > 2
        image = rows["a"].connection.image
        quality = image.quality[image.sampled]
        assert not any(quality), "no reading is out of range: the measured way is the good one"


@needs_compiler
@pytest.mark.parametrize("count", COUNTS)
def test_c_and_cpp_agree_with_umo(count):
    with ExitStack() as stack:
        rows = scan.implementations(count, Fill, stack)
        expected = results(rows["a"], count, seed=3)
        assert results(rows["b"], count, seed=3) == expected
        assert results(rows["c"], count, seed=3) == expected


@pytest.mark.parametrize("count", COUNTS)
def test_vectors_write_what_the_objects_write_one_by_one(count):
    with ExitStack() as stack:
        umo = scan.implementations(count, Fill, stack)["a"]
        umo.period(1)
        written = umo.raws()
        umo.plant.reset()
        umo.write_vectors(1)
        umo.plant.update()
        assert umo.raws() == written


def test_a_short_run_fills_every_cell_of_the_table():
    table = scan.measure(1, sizes=(13,))
    rows = "abcd" if native.missing() is None else "ad"
    for work in (scan.PERIOD, scan.SCAN_LOOP, scan.SCAN_FILL, scan.WRITE, scan.VECTOR):
        for row in rows:
            figure = table[work, 13, row]
            assert 0 < figure.minimum <= figure.median
    assert report.main_grid(table).row_count == 5


@pytest.mark.parametrize("kind", zones.KINDS)
def test_zones_on_vectors_do_what_the_hand_written_numpy_does(kind):
    with ExitStack() as stack:
        on_vectors, in_numpy = zones.make(50, kind, stack)
        for _ in range(100):
            on_vectors.period(1)
            in_numpy.period(1)
            assert on_vectors.driver.outputs.tolist() == in_numpy.driver.outputs.tolist()
        assert len(set(in_numpy.driver.outputs.tolist())) > 10


def test_the_rows_of_a_driver_are_measured_beside_its_library_and_counted_on_the_wire():
    pytest.importorskip("pymodbus")
    with ExitStack() as stack:
        try:
            rows = [row for count in (2, 13) for row in drivers.module("modbus").cases(count, stack)]
        except NotHere as error:
            pytest.skip(str(error))
        for row in rows:
            row.measure(2)
            assert [len(times) for times in row.times.values()] == [2, 2]
            assert row.transfers == 2, "all registers of a table lie side by side"
    assert "modbus, TCP" in {row.driver for row in rows}


@pytest.mark.full
def test_a_driver_whose_device_is_not_here_is_named_and_the_others_are_measured(monkeypatch):
    def cases(channels, stack):
        raise NotHere("there is no chip")

    def one(channels, stack):
        yield Case("one", "library", channels, lambda: None, lambda: None, 3)

    modules = {"gone": cases, "there": one}
    monkeypatch.setattr(drivers, "names", lambda: list(modules))
    monkeypatch.setattr(drivers, "module", lambda name: SimpleNamespace(cases=modules[name]))
    figures, missing = drivers.measure(rounds=1)
    assert missing == ["gone: not measured: there is no chip"]
    assert [(row.driver, row.channels, row.transfers) for row in figures] == [("one", n, 3) for n in SIZES]
    assert drivers.grid(figures).row_count == len(SIZES)
    assert drivers.measure(rounds=1, only="gon")[1] == missing
    assert drivers.measure(rounds=1, only="her")[1] == []


def test_a_test_kernel_that_is_not_built_is_said_in_one_line_with_the_command(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    _, (reason,) = kernel.measured(["gpio", "spi"], quick=True)
    assert reason.startswith("gpio, spi: not measured: they need the test kernel: make kernel, then tests/kernel/boot ")
    assert "\n" not in reason


def test_a_row_is_worse_only_if_its_whole_interval_is():
    rows = {
        name: against.Row(name, [(here, 1.0) for here in figures])
        for name, figures in {
            "worse": [1.05 + i * 1e-3 for i in range(30)],
            "not told apart": [0.9 + i * 1e-2 for i in range(30)],
            "not worse": [0.99 + i * 1e-3 for i in range(30)],
            "better": [0.9 + i * 1e-3 for i in range(30)],
        }.items()
    }
    assert {row.verdict: name for name, row in rows.items()} == {name: name for name in rows}


@pytest.mark.parametrize(("count", "rank"), [(1, 0), (5, 0), (6, 0), (9, 1), (30, 9)])
def test_the_interval_of_a_median_is_that_of_the_tables(count, rank):
    """Conover, Practical Nonparametric Statistics, 3.2: of 30 values the 10th and the 21st."""
    assert against.lower_rank(count) == rank


def test_a_face_whose_client_is_not_installed_is_named_and_left_out(monkeypatch):
    class Missing(faces.CLIENTS[0]):
        def __init__(self, folder):
            raise NotHere("Debian's package prometheus")

    monkeypatch.setattr(faces, "CLIENTS", (Missing, Missing))
    monkeypatch.setattr(faces, "running", lambda *given: AsyncExitStack())
    [row] = faces.measure(30, lambda what: None)
    assert (row.what, row.verdict) == ("prometheus", "left out: Debian's package prometheus")


def test_the_command_has_all_that_it_names(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    from bench import __main__ as command  # it imports every bench

    monkeypatch.setattr("sys.argv", ["bench", "--help"])
    with pytest.raises(SystemExit) as ended:
        command.main()
    assert ended.value.code == 0
    assert "--recording" in capsys.readouterr().out


@pytest.mark.full
def test_bounds_are_measured_at_every_size_and_a_broken_one_is_told(monkeypatch, capsys):
    console = Console(width=200)
    names = ("four writes to misspelt", "an interlock over all valves begins")
    assert bounds.run(console, 1, only=names[0], sizes=(20, 40)) == 0
    shown = capsys.readouterr().out
    assert names[0] in shown and "2 ms" in shown
    monkeypatch.setattr(bounds, "RESET_RATIO", -1000.0)
    assert bounds.run(console, 1, only=names[1], sizes=(20,)) == 1
    assert f"broken: {names[1]}: at the defaults after" in capsys.readouterr().out
