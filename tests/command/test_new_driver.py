"""`umo new driver`: a driver with its tests, which run the conformance kit on a device in memory."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest


def run_in(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", *words], cwd=folder, capture_output=True, text=True)


def in_short(tests: Path) -> None:
    """Fewer cycles, and less time for a loop-back to show a level, for make test; the tests below have all."""
    text = tests.read_text()
    for each, shorter in (("cycles=1000", "cycles=50"), ("gone=switched_off", "gone=switched_off, settle=0.2")):
        assert each in text
        text = text.replace(each, shorter)
    tests.write_text(text)


def test_a_new_driver_passes_its_own_tests(umo, tmp_path: Path) -> None:
    result = umo("new", "driver", "valve_island")
    assert result.exit_code == 0, result.stderr
    assert "umo device drivers valve_island:ValveIsland" in result.output
    assert 'type = "valve_island:ValveIsland"' in result.output
    assert sorted(file.name for file in tmp_path.glob("*.py")) == ["test_valve_island.py", "valve_island.py"]
    in_short(tmp_path / "test_valve_island.py")
    tests = run_in(tmp_path, "pytest", "-q", "-p", "no:cacheprovider", "test_valve_island.py")
    assert tests.returncode == 0, tests.stdout
    assert "5 passed" in tests.stdout


LINE = ("answer in pieces", "late answer", "short answer", "garbled answer", "old answer", "error answer", "vanish")
TRIED = f"""
from test_valve_island import subject
from umo.testing.conformance import conform


def test_every_rule_of_the_line_is_tried(subject):
    certificate = conform(subject, only={LINE}, cycles=10, minutes=10)
    assert {{each.rule: str(each.verdict) for each in certificate.findings}} == dict.fromkeys({LINE}, "passed")
"""


def test_a_new_driver_on_a_line_says_that_lines_of_text_need_none(umo) -> None:
    hint = "A device that speaks in lines of text needs no driver of its own: the driver text takes its commands"
    assert hint in umo("new", "driver", "valve_island", "--tcp").output
    assert hint not in umo("new", "driver", "card").output


@pytest.mark.full
@pytest.mark.parametrize("line", ["--tcp", "--serial"])
def test_a_new_driver_on_a_line_has_a_device_and_a_line_on_which_every_rule_is_tried(
    umo, tmp_path: Path, line: str
) -> None:
    result = umo("new", "driver", "valve_island", line)
    assert "valve_island_device.py the device for its tests" in result.output
    files = sorted(file.name for file in tmp_path.glob("*.py"))
    assert files == ["test_valve_island.py", "valve_island.py", "valve_island_device.py"]
    (tmp_path / "test_tried.py").write_text(TRIED)
    tests = run_in(tmp_path, "pytest", "-q", "-p", "no:cacheprovider", "-k", "not contract")
    assert tests.returncode == 0, tests.stdout
    assert "4 passed, 1 deselected" in tests.stdout


@pytest.mark.full
@pytest.mark.parametrize("line", ["--tcp", "--serial"])
def test_a_new_driver_on_a_line_passes_its_own_tests_and_fails_without_its_checksum(
    umo, tmp_path: Path, line: str
) -> None:
    umo("new", "driver", "valve_island", line)
    tests = run_in(tmp_path, "pytest", "-q", "-p", "no:cacheprovider")
    assert "4 passed" in tests.stdout, tests.stdout
    file = tmp_path / "valve_island.py"
    file.write_text(file.read_text().replace("if asked and framed(number, function, items) == frame", "if asked"))
    tests = run_in(tmp_path, "pytest", "-q", "-p", "no:cacheprovider")
    assert "2 failed, 2 passed" in tests.stdout


def test_a_new_driver_is_on_one_line(umo, tmp_path: Path) -> None:
    result = umo("new", "driver", "valve_island", "--tcp", "--serial")
    assert result.exit_code == 2
    assert "give --tcp or --serial, not both" in result.stderr
    assert list(tmp_path.glob("*.py")) == []


def test_on_a_serial_line_nothing_is_left_of_the_network(umo, tmp_path: Path) -> None:
    umo("new", "driver", "valve_island", "--serial")
    for file in ("valve_island.py", "test_valve_island.py"):
        text = (tmp_path / file).read_text()
        assert [word for word in ("TCP", "host", "Host", "port:", "Tcp") if word in text] == []


@pytest.mark.full
def test_the_tests_of_a_new_driver_fail_if_it_breaks_a_rule(umo, tmp_path: Path) -> None:
    umo("new", "driver", "valve_island")
    file = tmp_path / "valve_island.py"
    file.write_text(file.read_text().replace("self.levels[name] = self.levels", "self.levels"))
    assert run_in(tmp_path, "pytest", "-q", "-p", "no:cacheprovider").returncode == 0
    file.write_text(file.read_text().replace("= raw", "= raw & 1"))
    tests = run_in(tmp_path, "pytest", "-q", "-p", "no:cacheprovider")
    assert tests.returncode == 1
    assert "1 failed, 4 passed" in tests.stdout


@pytest.mark.full
@pytest.mark.parametrize("line", [(), ("--tcp",), ("--serial",)])
def test_a_new_driver_is_clean_for_ruff_and_mypy(umo, tmp_path: Path, line: tuple[str, ...]) -> None:
    umo("new", "driver", "valve_island", *line)
    rules = "E,F,W,I,B,UP,SIM,C4,PIE,RET,RUF,PERF"
    for words in (
        ("ruff", "check", "--isolated", "--line-length", "100", "--select", rules, "."),
        ("ruff", "format", "--isolated", "--check", "."),
        ("mypy", "--strict", *(file.name for file in sorted(tmp_path.glob("*.py")))),
    ):
        pytest.importorskip(words[0])
        result = run_in(tmp_path, *words)
        assert result.returncode == 0, result.stdout


@pytest.mark.full
def test_in_a_station_its_type_begins_with_a_dot(umo, tank: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tank)
    result = umo("new", "driver", "pump_card")
    assert 'type = ".pump_card:PumpCard"' in result.output
    assert "dac:0, relay:0, adc:0, switch:0" in umo("device", "drivers", ".pump_card:PumpCard").output
    assert run_in(tank, "pytest", "-q", "-p", "no:cacheprovider", "test_pump_card.py").returncode == 0


def test_a_new_driver_can_be_wired_in_a_station(umo, tank: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tank)
    umo("new", "driver", "pump_card")
    wiring = (tank / "wiring" / "simulated.toml").read_text() + '[drivers.card]\ntype = ".pump_card:PumpCard"\n'
    wiring = wiring.replace('driver = "tank", channel = "out:inlet"', 'driver = "card", channel = "relay:0"')
    wiring = wiring.replace('driver = "tank", channel = "tick"', 'driver = "timerfd"')
    (tank / "wiring" / "bench.toml").write_text(wiring)
    result = umo("check", ".", "-w", "bench")
    assert result.exit_code == 0, result.stderr


@pytest.mark.parametrize(
    ("name", "try_"),
    [("my-card", "my_card"), ("MyCard", "my_card"), ("9 lives", "lives"), ("class", "class_driver"), ("_", "my_card"),
     ("", "my_card"), ("../up", "up"), ("a\x1b[2Jb", "a_2_jb")],
)  # fmt: skip
def test_a_name_that_a_module_cannot_have_gets_the_nearest(umo, tmp_path: Path, name: str, try_: str) -> None:
    result = umo("new", "driver", name)
    assert result.exit_code == 2
    assert "is not the name of a module: small letters, digits and _, beginning with a letter, " in result.stderr
    assert result.stderr.rstrip().endswith(f"try {try_}")
    assert "\x1b" not in result.stderr
    assert list(tmp_path.glob("*.py")) == []


@pytest.mark.parametrize("name", ["select", "numpy", "umo"])
def test_a_name_of_an_installed_module_is_refused(umo, tmp_path: Path, name: str) -> None:
    result = umo("new", "driver", name)
    assert result.exit_code == 2
    assert f"{name} is the name of an installed module" in result.stderr
    assert list(tmp_path.glob("*.py")) == []


@pytest.mark.parametrize("file", ["card.py", "test_card.py"])
def test_a_new_driver_overwrites_nothing(umo, tmp_path: Path, file: str) -> None:
    (tmp_path / file).write_text("mine")
    result = umo("new", "driver", "card")
    assert result.exit_code == 2
    assert f"{file} exists; nothing was written" in result.stderr
    assert [each.read_text() for each in tmp_path.glob("*.py")] == ["mine"]


@pytest.mark.parametrize(("name", "try_"), [("my machine", "my-machine"), (".hidden", "hidden"), ("a;b\x1b", "a-b")])
def test_a_new_station_has_a_name_that_needs_no_quotes(umo, tmp_path: Path, name: str, try_: str) -> None:
    result = umo("new", "station", name)
    assert result.exit_code == 2
    assert result.stderr.rstrip().endswith(f"try {try_}")
    assert not (tmp_path / name).exists()


@pytest.mark.parametrize("name", ["umo", "calendar"])
def test_a_new_station_is_not_named_as_a_module_that_mypy_would_look_at(umo, tmp_path: Path, name: str) -> None:
    result = umo("new", "station", name)
    assert result.exit_code == 2
    assert result.stderr.rstrip().endswith(f"try {name}-machine")
    assert not (tmp_path / name).exists()


def test_a_folder_that_cannot_be_written_is_named(umo, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(self: Path, *_: object) -> None:
        raise PermissionError(13, "Permission denied", str(self))

    monkeypatch.setattr(Path, "write_text", refused)
    result = umo("new", "driver", "card")
    assert result.exit_code == 2
    assert "card.py: Permission denied" in result.stderr
