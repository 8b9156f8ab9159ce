"""Wirings as others write them: whatever is in the file or in a driver's code comes out as faults."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from helpers.machines import bench
from umo import check
from umo.drivers import Channel, Direction, Driver
from umo.objects import atoms
from umo.wiring import resolve, source


class Recorder(Driver):
    """Options of the kinds that TOML has no literal for, and channels that go wrong."""

    made: dict[str, Any] = {}

    def __init__(
        self,
        folder: Path = Path(),
        limits: tuple[float, float] = (0.0, 1.0),
        units: Sequence[int] = (),
        ports: tuple[Path, ...] | None = None,
    ) -> None:
        Recorder.made = {"folder": folder, "limits": limits, "units": units, "ports": ports}

    def channel(self, text: str) -> Channel:
        if text == "nothing":
            return None  # type: ignore[return-value]
        if text == "leave":
            sys.exit(0)
        if text == "mute":
            raise Mute
        return Channel(text, Direction.BOTH, 16, signed=True)


class Mute(Exception):
    def __str__(self) -> str:
        raise RuntimeError("no words")


class Leaver(Recorder):
    def __init__(self) -> None:
        sys.exit(0)


def written(tmp_path: Path, text: str) -> Path:
    file = tmp_path / "box.toml"
    lines = [f'"{item.path}" = {{ driver = "simulated" }}' for item in atoms(bench()) if item.path != "timer"]
    lines.append('timer = { driver = "simulated", period = "1 ms" }')
    file.write_text("[wire]\n" + "\n".join(lines) + "\n" + text)
    return file


def faults(file: Path | dict[str, Any]) -> list[tuple[str, str]]:
    return [(fault.key, fault.message) for fault in check(bench(), file)]


def test_a_text_is_a_path_and_a_list_is_a_tuple_where_a_driver_wants_one(tmp_path: Path) -> None:
    options = 'folder = "/var/log"\nlimits = [-1, 2.5]\nunits = [1, 2]\nports = ["/dev/ttyS0"]'
    file = written(tmp_path, f'[drivers.log]\ntype = "{__name__}:Recorder"\n{options}\n')
    resolve(bench(), file)
    assert Recorder.made["folder"] == Path("/var/log")
    assert Recorder.made["limits"] == (-1.0, 2.5)
    assert list(Recorder.made["units"]) == [1, 2]
    assert Recorder.made["ports"] == (Path("/dev/ttyS0"),)


@pytest.mark.parametrize("wrong", ["folder = 5", "limits = [1]", 'limits = ["1", "2"]', "units = [1.5]", 'ports = "x"'])
def test_other_values_are_not_converted(tmp_path: Path, wrong: str) -> None:
    file = written(tmp_path, f'[drivers.log]\ntype = "{__name__}:Recorder"\n{wrong}\n')
    found = [key for key, _ in faults(file)]
    assert found
    option = f"drivers.log.{wrong.partition(' ')[0]}"
    assert all(key == option or key.startswith(f"{option}.") for key in found)  # a list: its item


def test_a_mapping_may_hold_what_a_file_cannot() -> None:
    wire = {item.path: {"driver": "simulated"} for item in atoms(bench())} | {
        "timer": {"driver": "simulated", "period": "1 ms"}
    }
    table = {"type": f"{__name__}:Recorder", "folder": Path("here"), "limits": (0.0, 5.0)}
    resolve(bench(), {"wire": wire, "drivers": {"log": table}})
    assert Recorder.made["folder"] == Path("here")


@pytest.mark.parametrize(
    ("channel", "expected"),
    [
        ("nothing", "Recorder.channel returned None, not a Channel"),
        ("leave", "SystemExit: 0 ("),
        ("mute", "Mute: its text cannot be shown"),
    ],
)
def test_a_channel_that_a_driver_cannot_make_is_a_fault(tmp_path: Path, channel: str, expected: str) -> None:
    file = written(tmp_path, f'[drivers.log]\ntype = "{__name__}:Recorder"\n')
    text = file.read_text().replace(
        '"motor" = { driver = "simulated" }', f'"motor" = {{ driver = "log", channel = "{channel}" }}'
    )
    file.write_text(text)
    ((key, message),) = faults(file)
    assert key == 'wire."motor".channel'
    assert message.startswith(expected)


def test_a_driver_that_ends_python_is_a_fault_with_its_place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "leaving.py").write_text("import sys\nsys.exit(0)\n")
    monkeypatch.syspath_prepend(tmp_path)
    file = written(tmp_path, f'[drivers.a]\ntype = "leaving:Box"\n[drivers.b]\ntype = "{__name__}:Leaver"\n')
    imported, made = faults(file)
    assert imported[0] == "drivers.a.type"
    assert imported[1].endswith("leaving.py:2)")
    assert made[0] == "drivers.b"
    assert re.match(r"SystemExit: 0 \(\S*test_wiring_from_outside.py:", made[1])


@pytest.mark.parametrize("text", ["x = " + "[" * 500 + "]" * 500, "[wire." + ".".join("a" * 3000) + "]\nb = 1"])
def test_a_file_that_is_nested_too_deeply_is_a_fault(tmp_path: Path, text: str) -> None:
    file = tmp_path / "deep.toml"
    file.write_text(text)
    assert ("", "cannot be read: it is nested too deeply") in faults(file)


def test_a_thousand_wrong_names_are_reported_without_a_search_for_each(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[str] = []
    monkeypatch.setattr(source, "did_you_mean", lambda name, known: asked.append(name) or f" (near {name})")
    wrong = "\n".join(f'"zones.{i}.heater" = {{ driver = "simulated" }}' for i in range(1000))
    gains = "\n".join(f'"zones.{i}.gain" = 1.0' for i in range(1000))
    found = faults(written(tmp_path, f"{wrong}\n[parameters]\n{gains}\n"))
    assert len(found) == 2000
    assert len(asked) == source.MAX_SUGGESTIONS


def test_import_umo_leaves_what_it_does_not_need_for_later() -> None:
    late = ("pydantic", "typer", "rich", "ruckig", "pint")
    code = f"import sys, umo, umo.control\nprint([name for name in {late!r} if name in sys.modules])"
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ended.stdout.strip() == "[]"


# Drivers in modules of the station ----------------------------------------------------------------------

OWN = (
    "from umo.drivers import Driver\nfrom .parts import NAME\n\nclass Box(Driver):\n    def channel(self, text): ...\n"
)


def with_own_driver(folder: Path, kind: str) -> Path:
    """The wiring of a station that has a driver of its own."""
    for name, text in {"objects.py": "", "box.py": OWN, "parts.py": "NAME = 'own'\n"}.items():
        folder.mkdir(exist_ok=True)
        (folder / name).write_text(text)
    (folder / "wiring").mkdir()
    return written(folder / "wiring", f'[drivers.own]\ntype = "{kind}"\n')


def test_a_driver_may_be_in_a_module_of_the_station_whatever_its_folder_is_called(tmp_path: Path) -> None:
    for name in ("press", "2nd press", "also"):
        file = with_own_driver(tmp_path / name, ".box:Box")
        assert [fault.key for fault in check(bench(), file)] == []


def test_two_stations_of_one_name_have_drivers_of_their_own(tmp_path: Path) -> None:
    found = []
    for place in ("a", "b"):
        (tmp_path / place).mkdir()
        file = with_own_driver(tmp_path / place / "press", ".box:Box")
        found.append(type(resolve(bench(), file).drivers["own"]))
    assert found[0] is not found[1]


def test_a_module_of_the_station_is_named_with_a_dot(tmp_path: Path) -> None:
    (fault,) = check(bench(), with_own_driver(tmp_path / "press", "box:Box"))
    assert fault.message.endswith("No module named 'box'; for a module of the station write '.box:Box'")


def test_a_wiring_outside_of_a_station_has_no_modules(tmp_path: Path) -> None:
    faults = check(bench(), written(tmp_path, '[drivers.own]\ntype = ".box:Box"\n'))
    assert "is not in a station" in faults[0].message
