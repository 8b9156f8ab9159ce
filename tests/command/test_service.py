"""`umo new service`: the unit that it writes, as systemd reads it, and what it says."""

from __future__ import annotations

import configparser
import grp
import os
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import Result

from helpers.tiers import first
from umo.drivers import Driver
from umo.errors import OptionError
from umo.exit_status import ExitStatus
from umo.process.job import Job, Plan
from umo.system.device_record import DeviceRecord
from umo.wiring.wired import ProcessSettings, Wired
from umo_command.app import app
from umo_command.new import service, service_hints
from umo_command.new.service_hints import groups_for
from umo_command.new.systemd_unit import NO_RESTART, SUCCESS, ServiceUnit, plain, quoted, stop_limit, watchdog
from umo_command.shared import keep_only

Umo = Callable[..., Result]


def section(text: str, name: str = "Service") -> dict[str, str]:
    parser = configparser.ConfigParser(interpolation=None, delimiters="=", strict=False)
    parser.optionxform = str  # type: ignore[assignment,method-assign]
    parser.read_string(text)
    return dict(parser[name])


def unit(wired: Wired | None = None, user: str | None = "root", folder: str = "/srv/cell") -> dict[str, str]:
    io = cast(Driver, SimpleNamespace(timeout=0.1))
    wired = Wired({"io": io}, [], hardware={"io": ("tcp 10.0.0.1:502",)}) if wired is None else wired
    return section(ServiceUnit("umo-a", "umo run a", ["/venv/bin/python"], folder, wired, user).text())


# The command -------------------------------------------------------------------------------------------


def test_the_unit_runs_the_station_as_it_was_checked(umo: Umo, tank: Path) -> None:
    result = umo("new", "service", "tank", "-w", "modbus", "--target", "30", "--until", "5 min")
    assert result.exit_code == 0, result.stderr
    words = shlex.split(section(result.stdout)["ExecStart"])
    assert words[:5] == [sys.executable, "-P", "-m", "umo_command", "run"]
    assert words[5:] == [
        *(str(tank), "--wiring", "modbus", "--target", "30", "--until", "5 min"),
        *("--no-plot", "--keep", "200 MB", "--keep-runs", "20"),
    ]
    assert section(result.stdout)["WorkingDirectory"] == str(tank.parent)


def test_the_options_of_a_run_are_known_where_only_the_commands_of_new_are_made(
    umo: Umo, tank: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for kind in ("registered_commands", "registered_groups"):
        monkeypatch.setattr(app, kind, list(getattr(app, kind)))
    keep_only(["new"])  # as in a process of this command
    assert umo("new", "service", "tank").exit_code == 0


def test_a_wiring_of_devices_on_the_network_waits_for_it(umo: Umo, tank: Path) -> None:
    waits = section(umo("new", "service", "tank", "-w", "modbus").stdout, "Unit")
    assert waits["After"] == waits["Wants"] == "network-online.target"
    assert "After" not in section(umo("new", "service", "tank").stdout, "Unit")


@pytest.mark.full
def test_a_wiring_in_virtual_time_is_run_in_real_time(umo: Umo, tank: Path) -> None:
    assert "--realtime" in section(umo("new", "service", "tank").stdout)["ExecStart"]
    assert section(umo("new", "service", "tank", "--manual").stdout)["ExecStart"].count("--realtime") == 0


def test_options_of_the_run_are_not_given_twice(umo: Umo, tank: Path) -> None:
    words = shlex.split(section(umo("new", "service", "tank", "--keep", "1 GB", "--no-plot").stdout)["ExecStart"])
    assert (words.count("--keep"), words.count("--no-plot"), words[words.index("--keep") + 1]) == (1, 1, "1 GB")
    assert "--keep" not in umo("new", "service", "tank", "--no-record").stdout


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("tank", "-w", "modbuss"), "no wiring 'modbuss' (did you mean 'modbus'?)"),
        (("tonk",), "no station 'tonk'"),
        (("tank", "--levle", "3"), "tank has no option --levle (did you mean 'level'?)"),
        (("tank", "--kep", "3"), "tank has no option --kep (did you mean 'keep'?)"),
        (("tank", "--acknowledge"), "--acknowledge: a service must not acknowledge an unsafe end by itself"),
        (("tank", "--fault", "level stuck at 1 s"), "--fault: faults are injected by hand"),
        (("tank", "--fresh"), "--fresh: each start would set the kept values aside"),
        (("tank", "--keep", "much"), "'--keep': 'much' is not a size"),
        (("tank", "--until", "soon"), "--until"),
        (("tank", "--no-record", "--keep-runs", "3"), "leave out --no-record"),
        (("tank", "--user", "--as", "operator"), "give --as or --user, not both"),
        (("tank", "--name", "../x"), "is not a name of a unit"),
        (("tank", "-o", "none/x.service"), "none/x.service: No such file or directory"),
    ],
)
def test_a_mistake_is_told_and_no_unit_is_written(umo: Umo, tank: Path, words: tuple[str, ...], said: str) -> None:
    result = umo("new", "service", *words)
    assert (result.exit_code, result.stdout) == (2, "")
    assert said in " ".join(result.stderr.split())


def test_where_systemd_is_absent_the_same_is_shown_for_the_foreground(
    umo: Umo, tank: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(service, "SYSTEMD", tank / "none")
    result = umo("new", "service", "tank")
    assert "systemd does not run here; the command line for the foreground" in result.stderr
    assert f"cd {tank.parent} && {section(result.stdout)['ExecStart'].split()[0]}" in " ".join(result.stderr.split())
    assert "must not restart the station at all" in " ".join(result.stderr.split())
    said = " ".join(umo("new", "service", "tank", "-w", "modbus").stderr.split())
    assert "must not restart the station after status 2, 3 or 4" in said


def test_where_systemd_runs_the_next_steps_are_shown(umo: Umo, tank: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(service, "SYSTEMD", tank)
    said = umo("new", "service", "tank", "-o", "a.service").stderr
    assert "sudo cp a.service /etc/systemd/system/umo-tank.service && sudo systemctl daemon-reload" in said
    assert "survives a logout: loginctl enable-linger" in umo("new", "service", "tank", "--user").stderr
    assert "sudo loginctl enable-linger operator" in umo("new", "service", "tank", "--as", "operator").stderr
    assert "enable-linger" not in umo("new", "service", "tank", "--as", "root").stderr


@pytest.mark.full
def test_a_unit_for_the_users_own_manager_names_neither_user_nor_groups(umo: Umo, tank: Path) -> None:
    own = section(umo("new", "service", "tank", "--user").stdout)
    assert not own.keys() & {"User", "SupplementaryGroups", "LimitRTPRIO", "ProtectSystem"}
    assert section(umo("new", "service", "tank", "--as", "operator").stdout)["User"] == "operator"


def test_a_place_for_records_of_its_own_is_passed_on(umo: Umo, tank: Path) -> None:
    assert f"UMO_STATE={os.environ['UMO_STATE']}" in umo("new", "service", "tank").stdout


# What it says ------------------------------------------------------------------------------------------


def test_every_status_is_restarted_prevented_or_a_success() -> None:
    """Of the statuses of a run 1 alone is restarted: it has failed, and every actuator was reset."""
    service = unit()
    prevented = set(map(int, service["RestartPreventExitStatus"].split()))
    success = set(map(int, service["SuccessExitStatus"].split())) | {0}
    assert service["Restart"] == "on-failure"
    assert (prevented, success) == ({2, 3, 4}, {0, 124, 129, 130, 143})
    assert set(ExitStatus) - prevented - success == {ExitStatus.FAILED}
    assert set(map(int, NO_RESTART)).isdisjoint(SUCCESS)


def test_a_machine_whose_ends_are_not_recorded_is_not_restarted() -> None:
    service = unit(Wired({}, []))
    assert service["Restart"] == "no"
    assert "143" in service["SuccessExitStatus"]


def test_no_process_is_killed_before_the_wirings_limits_have_passed() -> None:
    slow = Wired({}, [], process=ProcessSettings(hang_timeout=20.0, reset_for=300.0))
    assert stop_limit(slow) - stop_limit(Wired({}, [])) >= 2 * 290 + 3 * 19
    assert stop_limit(Wired({}, [], faces={"prometheus": {}})) == stop_limit(Wired({}, [])) + 6  # faces that hang
    assert unit(slow)["TimeoutStopSec"] == unit(slow)["TimeoutAbortSec"] == str(stop_limit(slow))
    assert (unit()["KillMode"], unit()["KillSignal"], unit()["WatchdogSignal"]) == (
        "control-group",
        "SIGTERM",
        "SIGTERM",
    )


def test_the_guardian_finds_a_hang_before_the_manager_does() -> None:
    slow = Wired({}, [], process=ProcessSettings(hang_timeout=20.0))
    assert watchdog(slow) == 160
    assert watchdog(Wired({}, [])) == 10


@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="real time needs Linux")
def test_a_machine_that_stands_stopped_is_told_and_its_start_has_a_status_that_is_not_restarted(
    umo: Umo, tank: Path
) -> None:
    (device,) = Plan(Job("tank", wiring="modbus")).wired.devices
    record = DeviceRecord([device], "tank", "modbus")
    record.begin(False)
    record.stopped("its guardian was killed", ["pump"])
    result = umo("new", "service", "tank", "-w", "modbus")
    assert "acknowledge these devices before the first start: tank (modbus), not reached: pump" in result.stderr
    status = umo("run", "tank", "-w", "modbus", "--no-plot").exit_code
    assert str(int(status)) in section(result.stdout)["RestartPreventExitStatus"].split()
    assert not (tank.parent / "runs").exists()


def test_a_folder_that_would_become_read_only_stays_writable() -> None:
    assert "ProtectSystem" in unit(folder="/usrs/cell")
    assert "ProtectSystem" not in unit(folder="/usr/local/cell")


def test_groups_that_are_there_are_named_and_others_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(grp, "getgrnam", {"dialout": 20, "gpio": 30}.__getitem__)
    groups, missing = groups_for(["gpio /dev/none", "serial /dev/none", "tcp 1.2.3.4:502", "iio iio:device9"])
    assert groups == ["dialout", "gpio"]
    assert len(missing) == 1
    assert "there is no group iio here" in missing[0]
    assert 'SUBSYSTEM=="iio", GROUP="iio"' in missing[0]


def test_each_device_of_a_kind_has_its_own_group(monkeypatch: pytest.MonkeyPatch) -> None:
    owners = {"serial /dev/ttyAMA0": "tty", "serial /dev/ttyUSB0": "dialout"}
    monkeypatch.setattr(grp, "getgrnam", {"dialout": 20, "tty": 5}.__getitem__)
    monkeypatch.setattr(service_hints, "_owner", owners.get)
    assert groups_for(owners) == (["dialout", "tty"], [])


def test_a_raspberry_pi_is_told_its_overlays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(service_hints, "MODEL", tmp_path / "model")
    assert service_hints.hints(["i2c /dev/i2c-1 address 0x48"]) == []
    (tmp_path / "model").write_bytes(b"Raspberry Pi 5 Model B Rev 1.0\0")
    said = service_hints.hints(["i2c /dev/i2c-1 address 0x48"])
    assert "dtparam=i2c_arm=on" in said[0]
    assert "isolcpus=3" in said[1]


# Words as systemd reads them ---------------------------------------------------------------------------


@given(st.text(st.characters(codec="utf-8")))
def test_a_word_is_read_back_as_it_was(word: str) -> None:
    try:
        text = quoted(word)
    except OptionError:
        assert not word.isprintable() or word != word.strip() or word.endswith("\\")
        return
    inner = text[1:-1] if text.startswith('"') else text
    read = inner.replace("%%", "\0").replace("$$", "\1")
    assert "%" not in read
    assert "$" not in read
    read = read.replace('\\"', "\2").replace("\\\\", "\3") if text.startswith('"') else read
    assert read.translate({0: "%", 1: "$", 2: '"', 3: "\\"}) == word
    assert text.startswith('"') or not set(text) & set(" \"'\\;")


@pytest.mark.parametrize("text", ["a\nUser=root", "\ta", "a ", "a\\", "a\x00"])
def test_what_a_line_cannot_hold_is_refused(text: str) -> None:
    with pytest.raises(OptionError, match="cannot be written in a systemd unit"):
        plain(text)


ANALYZE = shutil.which("systemd-analyze")


@pytest.mark.skipif(ANALYZE is None, reason="systemd-analyze (Debian: systemd) is not installed")
@pytest.mark.parametrize("words", first(1, ["-w modbus --as root", "", "--user"]))
@pytest.mark.parametrize("folder", ["plain", "with a blank, 100% $HOME's"])
def test_systemd_finds_no_fault_in_the_unit(
    umo: Umo, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: str, folder: str
) -> None:
    (tmp_path / folder).mkdir()
    monkeypatch.chdir(tmp_path / folder)
    assert umo("new", "station", "tank").exit_code == 0
    assert umo("new", "service", "tank", *words.split(), "-o", "umo-tank.service").exit_code == 0
    manager = ["--user"] if "--user" in words else []
    command = [str(ANALYZE), *manager, "--man=no", "verify", "./umo-tank.service"]
    result = subprocess.run(command, capture_output=True, text=True, env={"XDG_RUNTIME_DIR": str(tmp_path)})
    said = [line for line in (result.stdout + result.stderr).splitlines() if "umo-tank" in line]
    assert (said, result.returncode) == ([], 0), result.stderr
