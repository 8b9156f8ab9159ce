"""What the functions of a station receive for the options that a user gives."""

from __future__ import annotations

import re
import sys
from functools import partial
from pathlib import Path
from typing import Any

import pytest

import umo
from umo.errors import OptionError, UmoError
from umo.process.job import Job, Plan
from umo.process.station import StationError, find
from umo.signature import parameters_of
from umo.system import packages
from umo_command.station_options import options_of, parse

OBJECTS = """
from enum import Enum
from umo import Compound, DigitalSensor


class Size(Enum):
    SMALL = 1
    LARGE = 2


class Row(Compound):
    gauges: list[DigitalSensor]
    timer: DigitalSensor


def machine(n=2, size: Size = Size.SMALL) -> Row:
    assert isinstance(size, Size)
    gauges = [DigitalSensor("mm", minimum=0, maximum=size.value, resolution=1) for _ in range(n)]
    timer = DigitalSensor("sampling_period", minimum=0, maximum=99_999, resolution=1, synchronous=False)
    return Row(gauges=gauges, timer=timer)
"""
APPLICATION = """
from __future__ import annotations

from enum import Enum
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from .objects import Row, Recipe


class Mode(Enum):
    FAST = "fast"
    SLOW = "slow"


GIVEN = {}


async def main(
    m: Row,
    parts: int = 3,
    quick: bool = False,
    *,
    strokes=3,
    gap: Unknown = 0.5,
    mode: Mode | None = None,
    report: Path = Path("x"),
    k: Literal[1, 2] = 1,
    turn: float = 0.0,
    marks: tuple[Mode, ...] = (),
    limits: dict[str, float] = {},
    recipe: Recipe | None = None,
) -> None:
    GIVEN.update({name: value for name, value in locals().items() if name != "m"})
"""
REQUIRED = "async def main(m, deep_draw: int, name='a'): ...\n"


@pytest.fixture(autouse=True)
def fresh_modules(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in sys.modules if name.startswith(packages.PREFIX)]:
        monkeypatch.delitem(sys.modules, name)


@pytest.fixture
def row(tmp_path: Path) -> Path:
    return station(tmp_path, APPLICATION)


def station(tmp_path: Path, application: str, objects: str = OBJECTS) -> Path:
    folder = tmp_path / "row"
    folder.mkdir()
    (folder / "objects.py").write_text(objects)
    (folder / "application.py").write_text(application)
    return folder


def received(folder: Path, *words: str) -> dict[str, Any]:
    """What the application receives after the way to another process."""
    found = find(folder)
    job = Job.load(Job(str(folder), options=parse(found, None, words)).dump())
    plan = Plan(job)
    assert plan.application is not None
    with pytest.raises(StopIteration):
        plan.application(plan.machine).send(None)
    application: Any = found.module("application")
    return dict(application.GIVEN)


@pytest.mark.parametrize(
    ("words", "name", "value"),
    [
        (("--parts", "3"), "parts", 3),
        (("--quick",), "quick", True),
        (("--strokes", "4"), "strokes", 4),
        (("--gap", "0.25"), "gap", 0.25),
        (("--report", "a b"), "report", Path("a b")),
        (("--k", "2"), "k", 2),
        (("--turn", "-1e-3"), "turn", -0.001),
        (("--turn", "-.5E+2"), "turn", -50.0),
    ],
)
def test_an_application_receives_the_types_of_its_parameters(
    row: Path, words: tuple[str, ...], name: str, value: Any
) -> None:
    got = received(row, *words)[name]
    assert (got, type(got)) == (value, type(value))


def test_an_application_receives_members_of_an_enum(row: Path) -> None:
    got = received(row, "--mode", "slow", "--marks", "fast", "--marks", "slow")
    mode = type(got["mode"])
    assert (got["mode"], got["marks"]) == (mode.SLOW, (mode.FAST, mode.SLOW))


def test_a_machine_receives_the_types_of_its_parameters(umo: Any, row: Path) -> None:
    plan = Plan(Job(str(row), options=parse(find(row), None, ["--n", "3", "--size", "2"])))
    assert [gauge.maximum for gauge in plan.machine.gauges] == [2.0] * 3  # type: ignore[attr-defined]
    assert (
        "gauges[0..2]  3 x digital sensor, 0 to 2 mm"
        in umo("show", "parts", str(row), "--n", "3", "--size", "2").output
    )


def test_enums_and_paths_of_a_program_reach_another_process(row: Path) -> None:
    mode: Any = find(row).module("application").Mode  # type: ignore[union-attr]
    job = Job.load(Job(str(row), options={"mode": mode.SLOW, "report": Path("r")}).dump())
    assert job.options == {"mode": "slow", "report": "r"}
    with pytest.raises(UmoError, match="options and wiring must be plain data"):
        Job(str(row), options={"mode": object()}).dump()


@pytest.mark.full
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="runs in its own processes on Linux only")
def test_an_application_in_its_own_process_receives_members_of_an_enum(row: Path) -> None:
    (row / "application.py").write_text(
        f"{APPLICATION}    return [mode is Mode.SLOW, str(report), marks == (Mode.FAST,)]\n"
    )
    with umo.start(row, realtime=True, mode="slow", report=Path("r"), marks=["fast"]) as machine:
        assert machine.wait().result == [True, "r", True]


def test_a_value_that_a_type_does_not_have_is_named(row: Path) -> None:
    with pytest.raises(OptionError, match="--mode: input should be 'fast' or 'slow', not 'medium'"):
        Plan(Job(str(row), options={"mode": "medium"}))
    with pytest.raises(OptionError, match=r"Invalid value for '--k': '3' is not one of '1', '2'"):
        parse(find(row), None, ["--k", "3"])


def test_parameters_that_a_text_cannot_give_are_not_options_of_the_command_line(row: Path) -> None:
    names = [option.name for option in options_of(find(row), None)]
    assert "parts" in names
    assert not {"limits", "recipe"} & set(names)
    plan = Plan(Job(str(row), options={"limits": {"a": 1.0}}))
    assert plan.application is not None


def test_a_partial_and_a_callable_object_are_functions_too(tmp_path: Path) -> None:
    called = "class Call:\n    async def __call__(self, m: Row, parts: int = 3, quick=False): GIVEN['parts'] = parts\n"
    made = f"{APPLICATION}\nwork = main\nmain = partial(work, parts=5)\n"
    assert received(station(tmp_path, made), "--mode", "slow", "--parts", "7")["parts"] == 7
    (other := tmp_path / "other").mkdir()
    assert received(station(other, f"{APPLICATION}\n{called}main = Call()\n"), "--parts", "8") == {"parts": 8}


def test_a_class_has_the_parameters_of_its_constructor() -> None:
    class Work:
        def __init__(self, n: int, path: Path | None = None, *rest: Any, **others: Any) -> None: ...

    assert {name: each.annotation for name, each in parameters_of(partial(Work)).items()} == {
        "n": int,
        "path": Path | None,
    }


@pytest.mark.parametrize(
    ("objects", "application", "message"),
    [
        (OBJECTS, REQUIRED, "--deep-draw is missing: the application requires it"),
        (OBJECTS.replace("n=2", "n: int"), APPLICATION, "--n is missing: the machine requires it"),
    ],
)
def test_a_required_option_that_is_missing_is_a_mistake_of_the_user(
    umo: Any, tmp_path: Path, objects: str, application: str, message: str
) -> None:
    folder = station(tmp_path, application, objects)
    result = umo("run", str(folder))
    assert (result.exit_code, result.stderr) == (2, f"umo: {message}\n")
    option = message.split()[0]
    shown = umo("run", str(folder), "--help").output
    assert re.search(rf"{option} .*\[required\]", shown)
    assert umo("run", str(folder), option, "3").exit_code == 0


def test_every_command_names_a_required_option_of_the_machine(umo: Any, tmp_path: Path) -> None:
    folder = station(tmp_path, APPLICATION, OBJECTS.replace("n=2", "n: int"))
    for words in (("check", folder), ("show", "parts", folder), ("device", "get", folder, "gauges.0")):
        result = umo(*map(str, words))
        assert (result.exit_code, result.stderr) == (2, "umo: --n is missing: the machine requires it\n")


def test_a_broken_init_of_a_station_fails_every_time(row: Path) -> None:
    (row / "__init__.py").write_text("import nothing_of_this_name\n")
    for _ in range(2):
        with pytest.raises(StationError, match=r"objects.py cannot be imported: .*nothing_of_this_name"):
            find(row).make  # noqa: B018
    (row / "__init__.py").write_text("")
    assert callable(find(row).make)


def test_a_wiring_whose_station_has_a_broken_init_has_a_fault(row: Path) -> None:
    machine = find(row).machine()
    (row / "wiring").mkdir()
    file = row / "wiring" / "card.toml"
    wires = '[wire]\n"gauges.*" = { driver = "card" }\ntimer = { driver = "simulated", period = "1 ms" }\n'
    file.write_text(f'[drivers.card]\ntype = ".card:Card"\n{wires}')
    for name in [name for name in sys.modules if name.startswith(packages.PREFIX)]:
        del sys.modules[name]
    (row / "__init__.py").write_text("import nothing_of_this_name\n")
    for _ in range(2):
        found = {fault.key: fault.message for fault in umo.check(machine, file)}
        assert list(found) == ["drivers.card.type"], found
        assert "nothing_of_this_name" in found["drivers.card.type"]
