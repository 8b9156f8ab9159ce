"""Whatever goes wrong in what a user wrote, named or plugged in: a line or two, the right status, never a traceback."""

from __future__ import annotations

import io
import os
import sys
import threading
from collections.abc import Callable
from datetime import datetime
from pathlib import Path

import pytest
import typer
from rich.console import Console
from typer.testing import Result

from helpers.machines import bench
from helpers.tiers import first
from umo import connect
from umo.process.frames import Reader, blackbox, published
from umo.testing import periods
from umo.text import MAX_WORD
from umo_command.shared import guarded
from umo_command.show import latency

Umo = Callable[..., Result]


def said(result: Result) -> str:
    return " ".join((result.stdout + result.stderr).split())


def refused(result: Result, *words: str, status: int = 2) -> None:
    assert result.exit_code == status, said(result)
    assert isinstance(result.exception, SystemExit), result.exception
    assert 1 <= len(result.stderr.strip().splitlines()) <= 2, result.stderr
    assert "Traceback" not in result.stderr
    for word in words:
        assert word in said(result)


def change(file: Path, before: str, after: str) -> None:
    text = file.read_text()
    assert before in text
    file.write_text(text.replace(before, after))


# A station's own code ---------------------------------------------------------------------------------

FAILURES = {
    "1 / 0": "ZeroDivisionError: division by zero",
    "__import__('sys').exit(0)": "SystemExit: 0",
    "raise GeneratorExit": "GeneratorExit",
    "raise type('Own', (BaseException,), {})(7)": "Own: 7",
    "raise type('Mute', (Exception,), {'__str__': lambda self: 1 / 0})": "its text cannot be shown",
}
BARE = ("GeneratorExit", "Own: 7")
"""Not errors, and nobody's way to leave Python either."""
failures = pytest.mark.parametrize(("failing", "words"), first(1, FAILURES.items()), ids=lambda text: text[:20])


@failures
@pytest.mark.parametrize("module", ["objects", "control", "application"])
def test_a_module_that_fails_at_its_import(umo: Umo, tank: Path, module: str, failing: str, words: str) -> None:
    file = tank / f"{module}.py"
    file.write_text(f"{failing}\n{file.read_text()}")
    for command in ("run", "check"):
        refused(umo(command, "tank"), "cannot be imported: ", words, f"{module}.py:")


@failures
@pytest.mark.parametrize(
    "command", ["run tank", "check tank", "show parts tank", "device get tank level", "device set tank inlet OPEN"]
)
def test_a_machine_that_fails_to_be_made(umo: Umo, tank: Path, command: str, failing: str, words: str) -> None:
    change(tank / "objects.py", "    return Tank(", f"    {failing}\n    return Tank(")
    refused(umo(*command.split()), "machine() of", words, "objects.py:")


@failures
def test_a_setup_that_fails(umo: Umo, tank: Path, failing: str, words: str) -> None:
    change(tank / "control.py", "    def setup(self) -> None:\n", f"    def setup(self) -> None:\n        {failing}\n")
    refused(umo("run", "tank"), "machine() of", words, "control.py:")


@failures
@pytest.mark.parametrize("command", ["run tank", "check tank", "device get tank level"])
def test_interlocks_that_fail(umo: Umo, tank: Path, command: str, failing: str, words: str) -> None:
    odd = f"    def interlocks(self):\n        {failing}\n\n    def setup(self)"
    change(tank / "control.py", "    def setup(self)", odd)
    refused(umo(*command.split()), "Tank.interlocks failed: ", words, "control.py:")


@failures
@pytest.mark.parametrize(
    ("file", "before", "after"),
    [
        ("control.py", "self.regulator.control()", "self.regulator.control(); {}"),
        ("application.py", "await ", "{}; await "),
    ],
)
def test_code_of_the_station_that_fails_in_virtual_time(
    umo: Umo, tank: Path, file: str, before: str, after: str, failing: str, words: str
) -> None:
    change(tank / file, before, after.format(failing))
    result = umo("run", "tank", "--no-plot")
    assert result.exit_code == 1
    assert words in said(result)
    assert f"{file}:" in said(result)


@pytest.mark.parametrize(("failing", "words"), [each for each in FAILURES.items() if each[1] not in BARE])
def test_a_driver_that_fails_at_its_import_or_in_its_constructor(
    umo: Umo, tank: Path, failing: str, words: str
) -> None:
    wiring = tank / "wiring" / "simulated.toml"
    wiring.write_text(wiring.read_text() + '\n[drivers.own]\ntype = ".own_box:Box"\n')
    made = "from umo.drivers import Driver\n\n\nclass Box(Driver):\n    def __init__(self):\n        {}\n"
    made += "\n    def channel(self, text):\n        pass\n"
    for code in (failing, made.format(failing)):
        (tank / "own_box.py").write_text(code)
        for command in ("run", "check"):
            refused(umo(command, "tank"), "drivers.own", words.removeprefix("ZeroDivisionError: "))


# Files and folders ------------------------------------------------------------------------------------


def test_what_may_not_be_read_or_written_is_a_line(
    umo: Umo, tank: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    locked = tmp_path / "locked"
    locked.mkdir()
    real = os.stat

    def stat(path, *args, **options):  # as for anybody but root
        if str(path).startswith((str(locked) + "/", "locked/")):
            raise PermissionError(13, "Permission denied", str(path))
        return real(path, *args, **options)

    monkeypatch.setattr(os, "stat", stat)
    for words in (
        ["check", "locked/there"],
        ["check", "tank", "-w", "locked/box.toml"],
        ["run", "tank", "--summary", "locked/there/sum.json"],
        ["new", "station", "locked/mine"],
        ["show", "why", "--file", "locked/kept.box"],
        ["show", "latency", "--out", "locked/there/figures.json"],
        ["device", "plant", "ztheta", "--out", "locked/there/report.json"],
    ):
        result = umo(*words)
        refused(result, "locked/")
        assert "permission denied" in said(result).lower()


LONG = "x" * 300


def test_names_that_no_file_system_takes_are_a_line(umo: Umo, tank: Path, tmp_path: Path) -> None:
    (tmp_path / "loop").symlink_to("loop")
    for name in (LONG, "loop", f"loop/{LONG}"):
        for words in (
            ["check", name],
            ["run", "tank", "-w", name],
            ["new", "station", name],
            ["show", "values", name],
            ["show", "why", name],
            ["show", "why", "--file", name],
            ["run", "tank", "--summary", f"{name}/sum.json"],
            ["device", "plant", "ztheta", "--out", f"{name}/report.json"],
            ["show", "latency", "--out", f"{name}/figures.json"],
        ):
            refused(umo(*words))


def test_a_wiring_nested_500_deep_is_a_line(umo: Umo, tank: Path, tmp_path: Path) -> None:
    (tmp_path / "deep.toml").write_text("x = " + "[" * 500 + "]" * 500)
    for command in (["check", "tank"], ["run", "tank"], ["device", "get", "tank", "level"]):
        refused(umo(*command, "-w", "deep.toml"), "deep.toml: cannot be read: it is nested too deeply")


def test_brackets_in_names_are_shown_as_they_are(
    umo: Umo, tank: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("umo_command.run.plot.save_plot", lambda *given: "")
    own = tank.rename(tmp_path / "[red]tank")
    wiring = own / "wiring" / "simulated.toml"
    wiring = wiring.rename(wiring.with_name("[bold]:star:.toml"))
    assert "[bold]:star:.toml" in said(umo("check", "[red]tank"))
    assert "[bold]:star:" in said(umo("show", "parts", "[red]tank"))
    result = umo("run", "[red]tank")
    assert result.exit_code == 0
    assert "umo run [red]tank, [bold]:star:" in said(result)
    assert "trace and plot: runs/[red]tank-" in said(result)
    (tmp_path / "[green]new").mkdir()
    assert "[green]new is a station" in said(umo("new", "station", "[green]new"))


def test_the_hint_to_install_matplotlib_names_the_extra(umo: Umo, tank: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "umo_command.run.plot", None)
    assert 'pip install ".[plot]" in the clone of umo' in said(umo("run", "tank"))


def test_a_plot_that_cannot_be_drawn_costs_the_plot_alone(
    umo: Umo, tank: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*args: object) -> None:
        raise ValueError("$z_ is not mathematics")

    monkeypatch.setattr("umo_command.run.plot.save_plot", fail)
    result = umo("run", "tank")
    assert result.exit_code == 0
    assert "umo: the plot could not be drawn: ValueError: $z_ is not mathematics" in said(result)


def test_runs_that_end_in_the_same_second_have_a_folder_each(
    umo: Umo, tank: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Stopped(datetime):
        @classmethod
        def now(cls, tz: object = None) -> Stopped:
            return cls(2026, 1, 2, 3, 4, 5)

    monkeypatch.setattr("umo_command.run.run_folder.datetime", Stopped)
    for _ in range(3):
        assert umo("run", "tank", "--no-plot").exit_code == 0
    names = sorted(path.name for path in (tmp_path / "runs").iterdir())
    assert names == ["tank-20260102-030405", "tank-20260102-030405-2", "tank-20260102-030405-3"]
    assert all((tmp_path / "runs" / name / "trace.csv").exists() for name in names)


# Black boxes ------------------------------------------------------------------------------------------


def test_a_black_box_that_is_a_folder_or_damaged_is_a_line(umo: Umo, tank: Path, tmp_path: Path) -> None:
    connection = connect(bench())
    box = tmp_path / "kept.box"
    with connection as m, published(connection, "bench") as ring:
        periods(m, 5)
        with Reader(ring.path) as reader:
            blackbox.save(reader, box, "on demand")
    assert umo("show", "why", "--file", "kept.box").exit_code == 0
    refused(umo("show", "why", "--file", "tank"), "tank is not a file")
    refused(umo("show", "why", "--file", "none.box"), "none.box")
    whole = box.read_bytes()
    begin = whole.index(b"{")
    for damaged in (
        whole[:100],
        whole.replace(b'"station"', b'"nothing"'),
        whole[:begin] + b"[" + whole[begin + 1 :],
        whole[:begin] + b"\xff" + whole[begin + 1 :],
        whole.replace(b'"phases"', b'"things"'),
        b"",
    ):
        box.write_bytes(damaged)
        refused(umo("show", "why", "--file", "kept.box"))


# Numbers and units ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "words",
    [
        ["show", "latency", "--for"],
        ["device", "plant", "ztheta", "--watchdog"],
        ["show", "values", "--for"],
        ["device", "set", "tank", "inlet", "OPEN", "--for"],
    ],
)
def test_a_time_is_a_finite_number(umo: Umo, tank: Path, words: list[str]) -> None:
    assert umo(*words, "nan").exit_code == 2
    result = umo(*words, "inf")
    assert result.exit_code == 2
    assert "inf" in said(result)


def test_a_unit_is_not_calculated(umo: Umo, tank: Path) -> None:
    for unit in ("9**9**9*mm", "9**9**9"):
        refused(umo("device", "get", "tank", "level", "--unit", unit), "is not a unit that pint knows")


def test_decibels_are_written_as_the_power_that_they_are(umo: Umo, tmp_path: Path) -> None:
    station = tmp_path / "rf"
    station.mkdir()
    (station / "objects.py").write_text(
        "from umo import Compound, DigitalActuator\n\n\nclass Sender(Compound):\n    out: DigitalActuator\n\n\n"
        "def machine() -> Sender:\n"
        "    return Sender(out=DigitalActuator('mW', default=0.0, minimum=0.0, maximum=1000.0, resolution=1.0))\n"
    )
    assert "out 1000 mW raw 1000 ● good" in said(umo("device", "set", "rf", "out", "30 dBm", "--for", "0"))
    refused(umo("device", "set", "rf", "out", "31 dBm", "--for", "0"), "out: 1258.93 mW is outside 0 to 1000")
    refused(umo("device", "get", "rf", "out", "--unit", "dBm"), "0 mW cannot be expressed in dBm")


def test_the_tree_of_a_broken_wiring_shows_its_faults(umo: Umo, tank: Path, tmp_path: Path) -> None:
    broken = tmp_path / "broken.toml"
    for text in ("[wire", '[wire]\n"levle" = { driver = "simulated" }\n'):
        broken.write_text(text)
        result = umo("show", "parts", "tank", "-w", "broken.toml")
        assert result.exit_code == 2
        assert "broken.toml:" in result.stderr
        assert "overflow" in result.stdout


# Usage ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("words", "text"),
    [
        ("do", "umo do: missing argument 'STATION'; `umo do --help` shows what it takes"),
        ("show page --port 99999", "umo show page: invalid value for '--port': "),
        ("show page --prot 8300", "umo show page: no such option: --prot (did you mean '--port'?)"),
        ("do x mode --taek", "umo do: no such option: --taek (did you mean '--take'?)"),
        ("show page --port", "option '--port' requires an argument"),
        ("show stations extra", "umo show stations: got unexpected extra argument"),
        ("run", "umo run: invalid value for STATION: give the folder of a station"),
        ("do x call --for long", "umo do: invalid value for '--for': "),
        ("rnu ztheta", "umo: no such command 'rnu' (did you mean 'run'?); `umo --help` shows what it takes"),
        ("show whi", "umo show: no such command 'whi' (did you mean 'why'?); `umo show --help` shows what it takes"),
        ("--verison", "umo: no such option: --verison (did you mean '--version'?)"),
    ],
)
def test_a_usage_error_is_one_line(umo: Umo, words: str, text: str) -> None:
    result = umo(*words.split())
    refused(result, text)
    assert result.stdout == ""


def test_a_group_alone_shows_its_help(umo: Umo) -> None:
    result = umo("show")
    assert result.exit_code == 2
    assert "Usage: umo show" in result.stdout


# The central place ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("error", "status"),
    [
        (PermissionError(13, "Permission denied", "there"), 2),
        (OSError("no more"), 2),
        (UnicodeEncodeError("utf-8", "\udce9", 0, 1, "surrogates not allowed"), 2),
        (RecursionError("too deep"), 1),
        (GeneratorExit(), 1),
        (SystemExit(0), 1),
        (KeyboardInterrupt(), 130),
    ],
)
def test_guarded_ends_with_a_line_and_a_status_whatever_is_raised(
    error: BaseException, status: int, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail() -> None:
        raise error

    with pytest.raises(typer.Exit) as caught:
        guarded(fail)
    assert caught.value.exit_code == status
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert status != 1 or f"{type(error).__name__}" in lines[0]


def test_nothing_draws_beside_the_measurement(monkeypatch: pytest.MonkeyPatch) -> None:
    threads: list[str] = []

    def measure(*args: object, **options: object) -> None:
        threads.extend(thread.name for thread in threading.enumerate())
        raise KeyboardInterrupt

    monkeypatch.setattr(latency, "err", Console(file=io.StringIO(), force_terminal=True))
    monkeypatch.setattr(latency, "measure", measure)
    before = [thread.name for thread in threading.enumerate()]
    with pytest.raises(KeyboardInterrupt):
        latency.latency(0.001, 1.0, False, None)
    assert threads == before


def test_an_application_without_main_is_named(umo: Umo, tank: Path) -> None:
    file = tank / "application.py"
    file.write_text(file.read_text().replace("async def main(", "async def mian("))
    result = umo("run", str(tank))
    assert result.exit_code == 2
    assert "application.py has no main() (did you mean 'mian'?)" in result.stderr.replace("\n", "")


LONG = "x" * 5000
GIVEN = [
    *(
        "run LONG",
        "run STATION -w LONG",
        "run STATION --LONG 3",
        "run STATION --until LONG",
        "get STATION LONG",
        "LONG",
    ),
    *("run STATION --fault LONG", "check LONG", "check LONG/LONG", "set STATION LONG 3", "set STATION valve LONG"),
    *("call LONG x", "watch LONG", "ps LONG", "info LONG", "acknowledge LONG", "why LONG", "new LONG", "face LONG"),
    *("latency --period LONG", "LONG"),
]


@pytest.mark.parametrize("line", first(2, GIVEN))
def test_what_a_user_has_written_is_echoed_cut(umo: Umo, tank: Path, line: str) -> None:
    """A misspelt path of 5,000 characters filled the terminal."""
    result = umo(*line.replace("LONG", LONG).replace("STATION", str(tank)).split())
    assert result.exit_code in (1, 2)
    assert max(map(len, result.stderr.split())) < 4 * MAX_WORD
    assert len(result.stderr) < 1500


@pytest.mark.parametrize("command", ["run", "check", "show parts", "device plant"])
def test_a_command_without_a_station_says_that_the_current_folder_is_one(
    umo: Umo, tank: Path, monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    words = command.split()
    refused(umo(*words), "STATION")
    assert "the current folder is one" not in said(umo(*words))
    monkeypatch.chdir(tank)
    refused(umo(*words), f"(the current folder is one: `umo {command} .`)")


def test_a_path_in_the_place_of_the_station_is_named(umo: Umo) -> None:
    refused(umo("device", "get", "level"), "missing argument 'PATH...' (level was taken for the STATION)")
