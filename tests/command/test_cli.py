"""The command: what a user types, what is printed, and the exit status."""

from __future__ import annotations

import json
import os
import re
import socket
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path
from types import SimpleNamespace

import pytest
from typer.testing import Result

from helpers.tiers import first
from umo import connect, published
from umo.plant.twin import place_of, twin_of
from umo.process.frames import Reader
from umo.process.station import find, shipped
from umo.stations import ztheta
from umo.system.device_lock import DeviceLock
from umo.system.device_record import DeviceRecord
from umo.testing import periods, station
from umo.wiring import check


def said(result: Result) -> str:
    """All of it, with rich's line breaks undone."""
    return " ".join((result.stdout + result.stderr).split())


# Running ----------------------------------------------------------------------------------------------


def test_a_run_places_all_parts_and_leaves_trace_plot_and_summary(umo, tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    result = umo("run", "ztheta", "--parts", "1", "--seed", "3", "--summary", "sum.json")
    assert result.exit_code == 0, said(result)
    assert "plant: parts placed │ 1" in said(result)
    assert "progress │ 1 of 1, done" in said(result)
    assert "part 1 of 1: picking" in result.stderr
    summary = json.loads((tmp_path / "sum.json").read_text())
    assert set(summary) == {
        "alarms",
        "state",
        "status",
        "failure",
        "stopped_by",
        "progress",
        "equipment_faults",
        "periods",
        "missed_periods",
        "period_us",
        "realtime_factor",
        "reports",
        "result",
    }
    assert (summary["progress"], summary["missed_periods"]) == ({"text": "done", "done": 1, "total": 1}, 0)
    plant = summary["reports"]["plant"]
    assert plant["parts_placed"] == 1
    assert 0 < plant["placing_error_um"] < 200
    assert 0 < plant["placing_error_deg"] < 1
    assert 0 < summary["period_us"]["median"] <= summary["period_us"]["p99"]
    (run,) = (tmp_path / "runs").iterdir()
    assert {"trace.csv", "plot.png", "summary.json"} <= {file.name for file in run.iterdir()}
    header = (run / "trace.csv").read_text().partition("\n")[0]
    assert "z.encoder[um]" in header
    assert "theta.direction[CW=1]" in header


def test_an_option_that_nobody_takes_is_refused(umo, tank: Path) -> None:
    result = umo("run", "tank", "--parts", "2")
    assert result.exit_code == 2
    assert "umo: tank has no option --parts (did you mean 'target'?); it has: --target, --level, --leak" in said(result)
    assert "(did you mean 'level'?)" in said(umo("run", "tank", "--levle=2"))
    assert "Invalid value for '--level': 'high' is not a number" in said(umo("run", "tank", "--level", "high"))


def test_an_exception_in_control_code_is_named_with_its_place_and_the_outputs_are_reset(umo, tank: Path) -> None:
    control = tank / "control.py"
    control.write_text(control.read_text().replace("self.regulator.control()", "self.regulator.control(); 1 / 0"))
    result = umo("run", "tank", "--no-plot")
    assert result.exit_code == 1
    where = r"\(at 0\.05 s, tank/control\.py:\d+ in control\)$"
    assert re.search(rf"umo: ZeroDivisionError: division by zero {where}", said(result))
    assert "Traceback" not in said(result)
    assert "Traceback" in umo("run", "tank", "--traceback", "--no-plot").output + _captured(tank)


def _captured(tank: Path) -> str:
    """The whole traceback is also in the run's folder."""
    return "".join(file.read_text() for file in tank.parent.glob("runs/*/failure.txt"))


def test_a_summary_in_no_folder_is_refused_before_anything_runs(umo, tank: Path) -> None:
    result = umo("run", "tank", "--summary", "nowhere/sum.json")
    assert result.exit_code == 2
    assert "there is no folder nowhere" in said(result)
    result = umo("run", "tank", "--summary", "tank")
    assert result.exit_code == 2
    assert "--summary tank: is a folder" in said(result)
    assert not (tank.parent / "runs").exists()


def test_a_summary_where_nothing_may_be_written_is_refused_before_anything_runs(
    umo, tank: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    access = os.access
    monkeypatch.setattr("os.access", lambda path, mode: Path(path) != Path("closed") and access(path, mode))
    Path("closed").mkdir()
    result = umo("run", "tank", "--summary", "closed/sum.json")
    assert (result.exit_code, "--summary closed/sum.json: cannot be written" in said(result)) == (2, True)
    assert not (tank.parent / "runs").exists()


def test_a_summary_that_cannot_be_written_is_said_and_the_status_is_not_0(umo, tank: Path) -> None:
    full = Path("/dev/full")
    if not full.exists():
        pytest.skip("there is no /dev/full here to stand for a full disk")
    result = umo("run", "tank", "--no-record", "--summary", "/dev/full")
    assert result.exit_code == 4
    assert "/dev/full could not be written: [Errno 28]" in said(result)
    assert "No space left" in said(result)


BOX = """
[drivers.box]
type = "modbus"
port = PORT

[wire]
"timer" = { driver = "timerfd", period = "10 ms" }
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="devices are held on Linux")
def test_whoever_would_drive_a_device_that_is_held_is_told_who_holds_it(umo, tank: Path) -> None:
    channels = {"inlet": "coil:0", "drain": "coil:1", "level": "input:0", "overflow": "discrete:0"}
    wires = [f'"{path}" = {{ driver = "box", channel = "{channel}" }}' for path, channel in channels.items()]
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        (tank / "wiring" / "box.toml").write_text(BOX.replace("PORT", str(port)) + "\n".join(wires) + "\n")
        device = f"modbus tcp 127.0.0.1:{port}"
        kept = DeviceLock([device], "press")
        try:
            commands = (["run", "tank"], ["device", "get", "tank", "level"], ["device", "set", "tank", "inlet", "OPEN"])
            for command in commands:
                result = umo(*command, "-w", "box")
                assert f"{device} is held by " in said(result)
                assert "(press), since " in said(result)
                assert result.exit_code == 2
        finally:
            kept.release()
        server.settimeout(0)
        with pytest.raises(BlockingIOError):
            server.accept()  # nobody has tried to connect


# What a user gets wrong -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["run", "zteta"], "no station 'zteta' (did you mean 'ztheta'?)"),
        (["run", "."], "no objects.py (`umo new station DIR` makes one)"),
        (["run", "ztheta", "-w", "simulatd"], "no wiring 'simulatd' (did you mean 'simulated'?)"),
        (["run", "conveyor", "--untl", "5 s"], "conveyor has no option --untl (did you mean 'until'?)"),
        (["device", "get", "ztheta", "z.encodr"], "no object 'z.encodr' in Manipulator (did you mean 'z.encoder'?)"),
        (
            ["device", "get", "ztheta", "z"],
            "z is a compound object; name one of its parts: encoder, motor, encoder_zero",
        ),
        (["device", "set", "ztheta", "z.encoder", "1"], "z.encoder is a sensor; only actuators can be set"),
        (["device", "set", "ztheta", "gripper.vacuum", "OFFF"], "has no state 'OFFF' (did you mean 'OFF'?)"),
        (["device", "set", "ztheta", "z.motor", "much"], "'much' is not a number in V"),
        (["device", "set", "ztheta", "z.motor", "3 kg"], "'kg' cannot be converted to 'V'"),
        (["device", "set", "ztheta", "z.motor", "0,5"], "z.motor: '0,5' is not a number; write 0.5"),
        (
            ["device", "plant", "ztheta", "--out", "nowhere/r.json"],
            "report can be written to nowhere/r.json: no such file",
        ),
        (["device", "plant", "ztheta", "--out", "/dev/null"], "/dev/null: this is not a regular file"),
        (["device", "plant", "ztheta", "--watchdog", "inf"], "'inf' is not a duration"),
        (["device", "plant", "ztheta", "--faults", "leaky-cap"], "did you mean 'leaky-cup'?"),
    ],
)
def test_a_mistake_is_answered_in_a_line_with_the_nearest_valid_choice(umo, words: list[str], expected: str) -> None:
    pytest.importorskip("mujoco")
    result = umo(*words)
    assert result.exit_code == 2, said(result)
    assert expected in said(result)
    assert len(result.stderr.strip().splitlines()) <= 2
    assert "Traceback" not in said(result)


def test_a_device_that_is_not_there_is_named_with_status_1(umo, tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    wiring = tmp_path / "elsewhere.toml"
    shipped = Path(ztheta.__file__).parent / "wiring" / "modbus.toml"
    wiring.write_text(shipped.read_text().replace("5020", str(port)))
    result = umo("device", "get", "ztheta", "z.encoder", "-w", str(wiring))
    assert result.exit_code == 1
    assert "driver box" in said(result)
    assert f"127.0.0.1:{port}" in said(result)


@pytest.mark.full
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="devices are held on Linux")
@pytest.mark.parametrize(
    "command",
    first(1, ["run tank --no-record", "device get tank level", "device set tank inlet OPEN --for 0"]),
)
def test_a_device_that_stands_stopped_wants_to_be_acknowledged(umo, tank: Path, command: str) -> None:
    plant, card = tank / "plant.py", f"card {os.getpid()}"  # devices are held beyond this test process
    plant.write_text(plant.read_text() + f"\n    def devices(self):\n        return [{card!r}]\n")
    wiring = tank / "wiring" / "simulated.toml"
    wiring.write_text(wiring.read_text().replace('driver = "tank", channel = "tick"', 'driver = "timerfd"'))
    (tank / "application.py").write_text("async def main(m):\n    pass\n")
    before = DeviceRecord([card], "other", "")
    before.begin(False)
    before.stopped("killed", ["ram"])
    words = command.split()
    refused = umo(*words)
    assert refused.exit_code == 2
    assert f"other on {card} was stopped at " in said(refused)
    assert "not reached: ram" in said(refused)
    assert "--acknowledge" in said(refused)
    assert umo(*words, "--acknowledge").exit_code == 0
    assert umo(*words).exit_code == 0


@pytest.mark.parametrize("broken", ["objects", "application", "control"])
def test_a_station_that_does_not_import_is_named(umo, tank: Path, broken: str) -> None:
    (tank / f"{broken}.py").write_text("import nothing_of_that_name\n")
    result = umo("run", "tank")
    assert result.exit_code == 2
    assert "nothing_of_that_name" in said(result)


# Looking ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["ztheta", "conveyor", "furnace", "batch"])
def test_the_wirings_that_ship_fit(umo, name: str) -> None:
    result = umo("check", name, "--all")
    assert result.exit_code == 0
    fits = [line for line in result.stdout.splitlines() if line.startswith("ok: ") and ".toml" in line]
    assert len(fits) == len(find(name).wirings)


def test_check_lists_all_faults_each_with_file_and_key(umo, tank: Path) -> None:
    wiring = tank / "wiring" / "simulated.toml"
    wiring.write_text(wiring.read_text().replace('"adc:level"', '"adc:levl"').replace('"drain"', '"drian"'))
    result = umo("check", "tank")
    assert result.exit_code == 2
    for words in ('wire."level".channel', "'adc:level'", 'wire."drian"', "'drain'", 'wire."drain"'):
        assert words in said(result)
    assert said(result).count("simulated.toml") == 3


def test_set_says_why_an_actuator_stays_at_its_default(umo, tank: Path) -> None:
    control = tank / "control.py"
    locked = "    def interlocks(self):\n        yield Interlock(lambda: True, [self.inlet], 'the hatch is open')\n\n"
    text = control.read_text().replace("    def setup(self)", f"{locked}    def setup(self)")
    control.write_text(text.replace("from umo import ", "from umo import Interlock, ", 1))
    result = umo("device", "set", "tank", "inlet", "OPEN", "--for", "0")
    assert "inlet CLOSED raw 0 ● good (inhibited: the hatch is open)" in said(result)


def test_check_says_how_many_actions_and_tunable_numbers_there_are(umo, tank: Path) -> None:
    control = tank / "control.py"
    control.write_text(re.sub(r" +@action.*\n|, tunable=True", "", control.read_text()))
    assert said(umo("check", "tank", "-w", "simulated")).startswith("ok: ")
    assert "5 objects on 1 driver, period 50 ms not checked: modbus" in said(umo("check", "tank"))
    assert "period 2 ms, 16 actions, 5 tunable numbers" in said(umo("check", "conveyor"))


def test_check_says_what_a_timeout_above_a_second_costs(umo, tank: Path) -> None:
    assert "note:" not in umo("check", "tank", "-w", "modbus").output
    file = tank / "wiring" / "modbus.toml"
    file.write_text(re.sub(r'timeout = ".*?"', 'timeout = "5 s"', file.read_text()))
    result = umo("check", "tank", "-w", "modbus")
    assert result.exit_code == 0, result.stderr
    (note,) = [line for line in result.output.splitlines() if line.startswith("note: ")]
    assert re.fullmatch(
        r"note: drivers\.\w+\.timeout is 5 s, more than 1 s: if nothing answers, a period takes up to 10\.\d+ s, "
        r"and so does a stop; a process that hangs is found after 12\.\d+ s \(process\.hang_timeout\)",
        note,
    )


def test_one_object_on_hardware_beside_a_plant_needs_real_time_only_to_run(umo, tank: Path) -> None:
    text = (tank / "wiring" / "simulated.toml").read_text()
    box = '[drivers.box]\ntype = "modbus"\nhost = "127.0.0.1"\nport = 1\n\n'
    mixed = text.replace('{ driver = "tank", channel = "in:overflow" }', '{ driver = "box", channel = "discrete:0" }')
    (tank / "wiring" / "box.toml").write_text(box + mixed)
    why = "tank runs in virtual time, but driver box controls hardware (modbus tcp 127.0.0.1:1)"
    for words in ("-w", "box"), ("--all",):
        result = umo("check", "tank", *words)
        assert result.exit_code == 0, said(result)
        assert f"note: {why}: this wiring runs with --realtime only" in result.stdout
    assert umo("show", "period", "tank", "-w", "box").exit_code == 0
    assert check(find("tank").machine(), tank / "wiring" / "box.toml") == []
    result = umo("run", "tank", "-w", "box")
    assert result.exit_code == 2
    assert f"{why}; wire the timer to a real clock" in said(result)
    for words in ("run", "--realtime"), ("device", "get", "overflow"):  # both go on to the device, which is not there
        result = umo(*words[:-1], "tank", words[-1], "-w", "box")
        assert result.exit_code == 1 and "127.0.0.1:1" in said(result) and "virtual" not in said(result)


def test_check_asks_whether_a_coulomb_was_meant(umo, tank: Path) -> None:
    for file in (tank / "objects.py", tank / "control.py"):
        file.write_text(file.read_text().replace('"mm"', '"C"'))
    (tank / "twin.py").unlink()
    told = umo("check", "tank", "-w", "simulated").stdout
    assert 'note: level, band and 2 others: the unit "C" is the coulomb; degrees are "degC"' in told


def test_check_says_which_wirings_it_looked_at_and_looks_at_all_on_demand(umo, tank: Path) -> None:
    result = umo("check", "tank")
    assert result.exit_code == 0
    assert result.stdout.splitlines()[1] == "not checked: modbus (-w NAME, or --all)"
    broken = tank / "wiring" / "broken.toml"
    broken.write_text((tank / "wiring" / "simulated.toml").read_text().replace('"adc:level"', '"adc:levl"'))
    assert umo("check", "tank").exit_code == 0
    result = umo("check", "tank", "--all")
    assert result.exit_code == 2
    assert [line.partition(": ")[0] for line in result.stdout.splitlines()] == ["ok", "ok"]
    assert "broken.toml:" in said(result)
    assert "not looked at" not in said(result)
    broken.unlink()
    assert umo("check", "tank", "--all").exit_code == 0
    assert "give --wiring or --all, not both" in said(umo("check", "tank", "--all", "-w", "modbus"))


@pytest.mark.parametrize(
    ("declared", "text"),
    [
        ("@umo.action\n    def dose(self, level: float):\n        pass", "action dose: argument level needs a range"),
        ("@umo.action\n    def dose(self, level):\n        pass", "action dose: argument level must be annotated"),
        ("@umo.action(levl=umo.Range('mm', 0, 1))\n    def dose(self):\n        pass", "has no argument 'levl'"),
        (
            "levl: Annotated[str, umo.Number(tunable=True)] = 'x'",
            "levl: 'x' is not a number; only numbers are tuned",
        ),
        ("tunable = {'levl': umo.Range('mm', 0, 1)}", "give `numbers` as a class keyword"),
    ],
)
def test_check_refuses_actions_and_tunable_numbers_that_make_no_sense(
    umo, tank: Path, declared: str, text: str
) -> None:
    control = tank / "control.py"
    control.write_text(
        "import umo\n" + control.read_text().replace("    def setup(self)", f"    {declared}\n\n    def setup(self)")
    )
    result = umo("check", "tank")
    assert (result.exit_code, text in said(result)) == (2, True), said(result)
    assert len(result.stderr.strip().splitlines()) <= 2


def test_the_tree_shows_units_ranges_and_wiring(umo) -> None:
    text = said(umo("show", "parts", "ztheta", "-w", "second_generation"))
    for words in ("Manipulator", "digital actuator, -10 to 10 V", "plant:pwm:z", "incremental", "asynchronous"):
        assert words in text


def test_the_drivers_are_listed_with_options_and_channels(umo) -> None:
    text = said(umo("device", "drivers"))
    for words in ("modbus", "simulated", "timerfd", "ztheta", "word_order = 'big'", "coil:N"):
        assert words in text


# By hand ----------------------------------------------------------------------------------------------


def test_get_reads_by_path_in_any_unit(umo, tank: Path) -> None:
    assert words(umo("device", "get", "tank", "level", "overflow")) == "level 20.0 mm ● good overflow PASS ● good"
    assert words(umo("device", "get", "tank", "level", "--unit", "cm")) == "level 2.00 cm ● good"


def test_a_unit_that_does_not_fit_is_refused_before_a_device_is_opened(umo, tank: Path) -> None:
    result = umo("device", "get", "tank", "overflow", "level", "--unit", "kg")
    assert result.exit_code == 2
    assert result.stderr == "umo: 'mm' cannot be converted to 'kg'\n"


def test_set_holds_then_resets(umo, tank: Path) -> None:
    assert (
        words(umo("device", "set", "tank", "inlet", "open", "--for", "0.05"))
        == "inlet OPEN raw 1 ● good inlet reset to CLOSED"
    )


def words(result: Result) -> str:
    """Of stdout."""
    return " ".join(result.stdout.split())


@pytest.mark.parametrize(
    ("what", "command"),
    [
        ("write", ["device", "set", "tank", "inlet", "OPEN", "--for", "0"]),
        ("reading", ["device", "get", "tank", "level"]),
    ],
)
def test_of_a_station_that_does_not_run_it_is_said_that_its_devices_are_opened(
    umo, tank: Path, what: str, command: list[str]
) -> None:
    assert umo(*command).stderr == (
        f"umo: tank (simulated) is not running: this {what} opens driver tank, and sets every actuator to its default "
        f"before and afterwards\n"
    )


def test_where_a_station_runs_twice_its_pid_is_asked_for(umo, tank: Path) -> None:
    with ExitStack() as stack:
        for _ in range(2):
            connection = connect(station(tank).machine())
            stack.enter_context(connection)
            stack.enter_context(published(connection, "tank", "simulated", place=tank))
        pid = os.getpid()
        for command in (
            ["device", "set", "tank", "inlet", "OPEN"],
            ["device", "get", "tank", "level"],
            ["do", "tank", "mode"],
        ):
            result = umo(*command)
            assert result.exit_code == 2
            text = f"2 runs of tank are active; give the pid of one instead of the name: {pid}, {pid}"
            assert said(result) == f"umo: {text}"


def test_set_says_that_a_limited_rate_takes_its_time(umo) -> None:
    result = umo("device", "set", "conveyor", "sorter.belt.setpoint", "200 mm/s", "--for", "0.01")
    assert result.exit_code == 0
    assert "(on its way to 0.20000 m/s: its slew rate is limited)" in result.output


def test_set_keeps_up_a_command_that_expires(umo, tank: Path, caplog: pytest.LogCaptureFixture) -> None:
    objects = tank / "objects.py"
    objects.write_text(objects.read_text().replace("CLOSED),", 'CLOSED, expires="0.5 s"),'))
    assert umo("device", "set", "tank", "inlet", "open", "--for", "1").exit_code == 0
    assert "not written" not in caplog.text


def test_set_takes_a_number_with_a_unit_and_a_negative_one(umo) -> None:
    pytest.importorskip("mujoco")
    assert "z.motor 0.500 V raw 102" in said(umo("device", "set", "ztheta", "z.motor", "500 mV", "--for", "0"))
    assert "z.motor -3.000 V raw -614" in said(umo("device", "set", "ztheta", "z.motor", "-3", "--for", "0"))


# A new station ----------------------------------------------------------------------------------------


def test_a_new_station_is_accepted_by_check_and_pytest(umo, tank: Path) -> None:
    assert umo("check", "tank").exit_code == 0
    environment = os.environ | {"PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-m", "pytest", "-q", "-W", "error", "-p", "no:cacheprovider"]
    ended = subprocess.run(command, cwd=tank, env=environment, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stdout
    assert "6 passed" in ended.stdout


def test_a_new_station_has_actions_a_tunable_number_and_a_twin_that_fits(umo, tank: Path) -> None:
    assert "5 objects on 1 driver, period 50 ms, 2 actions, 1 tunable number" in said(umo("check", "tank"))
    connection = connect(station(tank).machine())
    with connection, published(connection, "tank", "simulated", place=tank) as ring:
        periods(connection.root)
        with Reader(ring.path) as reader:
            described = twin_of(reader.layout, place_of(reader.layout))
    assert described is not None
    assert {body["name"] for body in described["bodies"]} >= {"tank", "water", "inlet", "drain", "overflow"}


def test_a_tuned_band_holds_at_once_in_a_new_station(umo, tank: Path) -> None:
    with connect(station(tank).machine()) as m:
        m.aim(300.0)
        m.band = 5.0
        periods(m)
        assert (m.regulator.low, m.regulator.high) == (295.0, 305.0)


def test_the_tests_of_new_stations_have_names_of_their_own_as_pytest_needs_them(umo, tank: Path) -> None:
    assert umo("new", "station", "my-press").exit_code == 0
    found = [path.name for folder in (tank, tank.parent / "my-press") for path in (folder / "tests").glob("test_*.py")]
    assert found == ["test_tank.py", "test_my_press.py"]


@pytest.mark.slow
@pytest.mark.parametrize("name", shipped())
def test_a_copy_of_a_station_that_ships_with_umo_has_its_own_code_wirings_and_tests(umo, name: str) -> None:
    result = umo("new", "station", "mine", "--copy", name)
    assert (result.exit_code, f"mine is a copy of {name}" in said(result)) == (0, True)
    own, source = station("mine"), find(name)
    assert [*own.wirings] == [*source.wirings]
    assert not any('type = "ztheta"' in wiring.read_text() for wiring in own.wirings.values())  # the plant of the copy
    checked = umo("check", "mine", "--all")
    assert checked.exit_code == 0, checked.stderr
    assert (own.path / "tests" / "test_mine.py").is_file()
    assert umo("new", "station", "again", "--copy", "mine").exit_code == 0
    assert [each.name for each in Path("again/tests").glob("test_*.py")] == ["test_again.py"]
    assert 'packages = ["again"]' in Path("again/pyproject.toml").read_text()


@pytest.mark.slow
def test_a_copy_of_a_station_is_tested_by_its_own_tests(umo) -> None:
    assert umo("new", "station", "mine", "--copy", "batch").exit_code == 0
    done = subprocess.run([sys.executable, "-m", "pytest", "-q", "mine"], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout


def test_a_station_is_not_copied_into_itself(umo, tank: Path) -> None:
    result = umo("new", "station", "tank/second", "--copy", str(tank))
    assert "tank/second is a folder of tank" in said(result)
    assert result.exit_code == 2


@pytest.mark.parametrize("words", [("show", "parts", "batch"), ("run", "batch", "--help")])
def test_the_place_of_the_files_of_a_station_is_shown(umo, words: tuple[str, ...]) -> None:
    assert str(find("batch").path) in re.sub(r"[\s│]", "", umo(*words).stdout)


def test_a_new_station_overwrites_nothing(umo, tank: Path) -> None:
    result = umo("new", "station", "tank")
    assert result.exit_code == 2
    assert "tank is not empty; nothing was written" in said(result)


def test_holding_takes_the_time_of_the_wall_clock_whatever_the_timer_does(
    umo, tank: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = [100.0]

    def sleep(seconds: float) -> None:
        clock[0] += max(seconds, 0.01)

    wiring = tank / "wiring" / "virtual.toml"
    wires = [f'"{path}" = {{ driver = "simulated" }}' for path in ("inlet", "drain", "level", "overflow")]
    wiring.write_text("\n".join(["[wire]", *wires, '"timer" = { driver = "simulated", period = "10 ms" }']))
    monkeypatch.setattr("umo_command.device.get_set.time", SimpleNamespace(monotonic=lambda: clock[0], sleep=sleep))
    result = umo("device", "set", "tank", "inlet", "OPEN", "-w", "virtual", "--for", "0.5")
    assert result.exit_code == 0, said(result)
    assert clock[0] == pytest.approx(100.5, abs=0.02)
