"""`umo device conform` on a controller: a good one keeps every rule of the link, a wrong one breaks the one that it
must."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path

import pytest
from typer.testing import Result

from helpers.generating import needs_a_compiler
from helpers.split_parts import (
    CONTROLLER,
    HOST_TIMEOUT,
    PEERS,
    PERIOD,
    ZONE,
    RunningController,
    controller_of,
    program_of,
)
from umo.cycle.laid_out import wired_numbers
from umo.drivers.wrapping import bare
from umo.stations.furnace.objects import machine
from umo.testing.conformance.certificate import Finding, Judgement
from umo.testing.link_rules import RULES, LinkTrial, findings
from umo.wiring import resolve

pytestmark = needs_a_compiler
Umo = Callable[..., Result]
GUIDE = Path(__file__).parents[3] / "docs" / "howto-split.md"
OPTIONS = ("--zones", "1", "--laws", "1")
MUTANTS = (
    ("silence", "umo_link.c", "if (l->silent <= LINK_HOST_TIMEOUT)", "if (l->silent <= 2 * LINK_HOST_TIMEOUT)"),
    ("silence", "umo_link.c", "!l->session || session != l->session ||", "session != l->session ||"),
    ("repeated frame", "umo_link.c", "|| !is_after(number, l->heard)) {", "|| number == 0) {"),
    ("not started", "umo_link.c", "session == l->offered && session != l->begun", "session != l->begun"),
    ("second host", "umo_link.c", "!l->session || session != l->session ||", "!l->session ||"),
    ("items", "umo_link.c", " || (!stops && !items(l, body, FIRST, length, true))", ""),
    ("stop", "umo_link.c", "l->mode = LINK_RESTING;", "l->mode = LINK_RUNNING;"),
    ("greeting", "umo_link.c", "put_u16(l, l->offered);\n    send", "put_u16(l, 1);\n    send"),
    ("damaged frame", "umo_frames.c", "!= (uint8_t)(crc >> 8 * i)", "!= (uint8_t)(crc >> 8 * i) && r->left"),
)  # fmt: skip
"""Rules, each with the mistake in a controller's C that breaks it: a file, what stands there, and what is put there."""


def wiring(folder: Path, port: int) -> Path:
    file = folder / "split.toml"
    file.write_text(f"""
[drivers.drive]
type = "{CONTROLLER}"
port = {port}
host_timeout = "{HOST_TIMEOUT}"
[wire]
"timer" = {{ driver = "timerfd", period = "{PERIOD}" }}
"zones.0" = {{ controller = "drive" }}
""")
    return file


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("zone")
    ZONE.program(made)
    return made


def tried(rule: str, program: Path, folder: Path) -> Finding:
    with controller_of(program) as controller:
        root = machine(1, 1)
        wired = resolve(root, wiring(folder, controller.port))
        driver = bare(wired.drivers["drive"])
        with wired_numbers(root, wired):
            trial = LinkTrial(driver, driver.take_part(root.zones[0], wired))  # type: ignore[attr-defined]
            return next(findings(trial, [rule]))


def test_a_part_is_generated_from_its_wiring_and_its_link_is_proved(umo: Umo, tmp_path: Path) -> None:
    made, file = tmp_path / "made", wiring(tmp_path, 1)
    done = umo(
        "new",
        "controller",
        "furnace",
        *OPTIONS,
        "-w",
        str(file),
        "--controller",
        "drive",
        "--target",
        "host",
        "-o",
        str(made),
    )
    assert done.exit_code == 0, done.output
    shutil.copy(PEERS / ZONE.plant, made / "umo_plant.c")
    with controller_of(program_of(made)) as controller:
        file = wiring(tmp_path, controller.port)
        done = umo(
            "device", "conform", "furnace", *OPTIONS, "-w", str(file), "--driver", "drive", "--out", "found.json"
        )
        assert done.exit_code == 0, done.output
        found = json.loads((tmp_path / "found.json").read_text())
        assert {each["rule"]: each["verdict"] for each in found["findings"]} == dict.fromkeys(RULES, "passed")
        assert found["outputs"] == ["zones.0.heater, inhibited", "zones.0.fan, inhibited"]
        record = controller.recorded()
        assert next(record).outputs == ZONE.defaults


@pytest.mark.full
@pytest.mark.parametrize(("rule", "name", "right", "wrong"), MUTANTS)
def test_a_mistake_of_a_controller_is_found(
    rule: str, name: str, right: str, wrong: str, folder: Path, tmp_path: Path
) -> None:
    broken = tmp_path / "broken"
    shutil.copytree(folder, broken)
    text = (broken / name).read_text()
    assert text.count(right) == 1
    (broken / name).write_text(text.replace(right, wrong))
    found = tried(rule, program_of(broken), tmp_path)
    assert found.verdict is Judgement.FAILED, found


@pytest.fixture
def guide(umo: Umo, tmp_path: Path) -> dict[str, str]:
    """The blocks of the guide's example by language; its program is generated."""
    text = GUIDE.read_text().partition("## Try it on")[2].partition("\n## ")[0]
    blocks = dict(re.findall(r"```(toml|c|python)(?: controller)?\n(.*?)```", text, re.DOTALL))
    file, to = tmp_path / "split.toml", ("--target", "host", "-o", str(tmp_path / "program"))
    file.write_text(blocks["toml"])
    assert umo("new", "controller", "ztheta", "--controller", "drive", "-w", str(file), *to).exit_code == 0
    return blocks


def guide_controller(folder: Path) -> AbstractContextManager[RunningController]:
    """Its controller, which runs on a free port."""
    subprocess.run(["make", "-s", "-C", folder / "program", "CC=cc -Werror"], check=True)
    return controller_of(folder / "program" / "machine")


def at_port(guide: dict[str, str], port: int) -> str:
    return guide["toml"].replace('"controller" ', f'"controller"\nport = {port}')


@pytest.mark.full
def test_a_board_that_is_not_filled_in_is_told_with_what_it_cannot_read(
    guide: dict[str, str], umo: Umo, tmp_path: Path
) -> None:
    with guide_controller(tmp_path) as controller:
        (tmp_path / "split.toml").write_text(at_port(guide, controller.port))
        umo(
            "device",
            "conform",
            "ztheta",
            "-w",
            str(tmp_path / "split.toml"),
            "--driver",
            "drive",
            "--out",
            "found.json",
        )
        (values,) = (
            each for each in json.loads(Path("found.json").read_text())["findings"] if each["rule"] == "values"
        )
        assert values["why"] == "the part does not run: it is FAULTED: theta.encoder: DriverError: could not be read"


@pytest.mark.full  # in real time, with the timeouts of the page: too short beside three other tests
def test_the_example_of_the_guide_moves_its_axis(guide: dict[str, str], tmp_path: Path) -> None:
    (tmp_path / "program" / "io_board.c").write_text(guide["c"])
    (tmp_path / "move.py").write_text(guide["python"])
    with guide_controller(tmp_path) as controller:
        (tmp_path / "split.toml").write_text(at_port(guide, controller.port))
        command = [sys.executable, "-I", tmp_path / "move.py"]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
        assert done.stderr == ""
        assert float(done.stdout) == pytest.approx(240.0, abs=0.2)
