"""The options of a station: the parameters of its application and of its drivers."""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum
from pathlib import Path
from typing import Any, Literal, get_args

import pytest
from rich.console import Console

from umo.errors import OptionError
from umo.objects import atoms
from umo.process.job import Job, Plan
from umo.process.station import Station, find
from umo.stations.furnace.plant import FAULTS
from umo.stations.ztheta.plant import Breakage
from umo_command.station_options import Option, help_panel, machine_and_words, options_of, parse


async def described(m: object, strokes: int = 3, force: float = 2.5) -> None:
    """Press.

    Options:
        strokes: how many.
    """


def test_the_help_shows_what_the_docstring_says_of_an_option() -> None:
    console = Console(width=120)
    with console.capture() as captured:
        console.print(help_panel(station(described), None))
    strokes, force = (line for line in captured.get().splitlines() if "--" in line)
    assert "how many  [default: 3]" in strokes
    assert "application  [default: 2.5]" in force


class Colour(Enum):
    RED = "red"
    BLUE = "blue"


class Bare(Station):
    """A station that is an application only."""

    main: Any = None
    make: Any = staticmethod(lambda: None)

    def wiring(self, name: str | None) -> None:
        return None


def station(main: Any) -> Station:
    made = Bare("press", Path())
    object.__setattr__(made, "main", main)
    return made


async def work(
    m: object,
    strokes: int = 3,
    force: float = 2.5,
    name: str = "a",
    dry: bool = False,
    report: Path | None = None,
    mode: Literal["slow", "fast"] = "slow",
    colour: Colour = Colour.RED,
    skip: Sequence[int] = (),
    *,
    deep_draw: int | None = None,
) -> None: ...


@pytest.mark.parametrize(
    ("arguments", "given"),
    [
        ([], {}),
        (["--strokes", "4", "--force=1e3"], {"strokes": 4, "force": 1000.0}),
        (["--dry"], {"dry": True}),
        (["--no-dry"], {"dry": False}),
        (["--mode", "fast", "--colour", "blue"], {"mode": "fast", "colour": "blue"}),
        (["--skip", "1", "--skip", "5"], {"skip": [1, 5]}),
        (["--deep-draw", "7", "--report", "a b"], {"deep_draw": 7, "report": "a b"}),
        (["--force", "-2"], {"force": -2.0}),
    ],
)
def test_the_parameters_of_an_application_are_options_by_name_and_type(
    arguments: list[str], given: dict[str, Any]
) -> None:
    assert parse(station(work), None, arguments) == given


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--strokes", "many"], "press: Invalid value for '--strokes': 'many' is not"),
        (["--strokes"], "press: Option '--strokes' requires an argument"),
        (["--mode", "medium"], "press: Invalid value for '--mode': 'medium' is not one of"),
        (["--stroke", "3"], "press has no option --stroke (did you mean 'strokes'?); it has: --strokes, --force"),
        (["stray"], "press: unexpected argument 'stray'"),
    ],
)
def test_what_a_station_does_not_take_is_named(arguments: list[str], message: str) -> None:
    with pytest.raises(OptionError) as caught:
        parse(station(work), None, arguments)
    assert str(caught.value).startswith(message)


def test_without_an_application_there_are_no_options() -> None:
    assert options_of(station(None), None) == []
    with pytest.raises(OptionError, match=r"press has no option --parts$"):
        parse(station(None), None, ["--parts", "2"])


def test_an_option_of_application_and_driver_is_one() -> None:
    async def main(m: object, seed: int = 7) -> None: ...

    class Drives(Bare):
        def wiring(self, name: str | None) -> Any:
            return {"drivers": {"plant": {"type": "ztheta"}}, "wire": {"timer": {"driver": "plant", "channel": "tick"}}}

    made = Drives("press", Path())
    object.__setattr__(made, "main", main)
    options = options_of(made, None)
    assert [(each.name, each.taker) for each in options][:3] == [
        ("seed", "application"),
        ("parts", "ztheta"),
        ("preset", "ztheta"),
    ]
    assert options[0].default == 7
    assert "realtime" not in [each.name for each in options]


def test_the_help_shows_names_types_and_defaults() -> None:
    console = Console(width=100, record=True)
    console.print(help_panel(station(work), None))
    lines = [line.strip("│ \n").split() for line in console.export_text().splitlines()]
    assert ["--strokes", "INTEGER", "application", "[default:", "3]"] in lines
    assert ["--mode", "slow|fast", "application", "[default:", "slow]"] in lines
    assert ["--colour", "red|blue", "application", "[default:", "red]"] in lines
    assert ["--deep-draw", "INTEGER", "application"] in lines


def shown_help(name: str, width: int) -> str:
    console = Console(width=width)
    with console.capture() as captured:
        console.print(help_panel(find(name), None))
    return captured.get()


def test_the_help_wraps_long_choices_and_cuts_nothing() -> None:
    told = shown_help("ztheta", 80)
    assert "…" not in told and all(kind in told for kind in get_args(Breakage))


def test_the_help_lists_the_kinds_of_failures_of_the_furnace() -> None:
    told = " ".join(shown_help("furnace", 160).replace("│", " ").split())
    assert ", ".join(FAULTS) in told


def test_the_help_says_which_options_may_be_repeated() -> None:
    recipe, others = shown_help("batch", 160).split("--batches")
    assert "may be repeated" in " ".join(recipe.replace("│", " ").split()) and "be repeated" not in others


def test_a_type_that_cannot_be_shown_is_text() -> None:
    assert Option("x", Any, None, "application").metavar == "TEXT"


OBJECTS = """
from umo import Compound, DigitalSensor


class Row(Compound):
    gauges: list[DigitalSensor]


def machine(gauges: int = 2, kind: type[Row] = Row, top: float = 10.0) -> Row:
    if gauges < 1:
        raise ValueError("a row needs a gauge")
    return kind(gauges=[DigitalSensor("mm", minimum=0, maximum=top, resolution=1) for _ in range(gauges)])
"""


@pytest.fixture
def row(tmp_path: Path) -> Path:
    folder = tmp_path / "row"
    folder.mkdir()
    (folder / "objects.py").write_text(OBJECTS)
    return folder


def test_the_parameters_of_the_machine_that_a_text_can_give_are_options(row: Path) -> None:
    found = find(row)
    assert [(each.name, each.taker) for each in options_of(found, None)] == [("gauges", "machine"), ("top", "machine")]
    machine, words = machine_and_words(found, ["gauges.3", "--gauges", "4", "--top=5"])
    assert words == ["gauges.3"]
    assert [(each.path, each.maximum) for each in atoms(machine)][-1] == ("gauges.3", 5.0)  # type: ignore[attr-defined]


def test_every_command_takes_the_options_of_the_machine(umo: Any, row: Path) -> None:
    assert "3 objects" in umo("check", str(row), "--gauges", "3").output
    assert "gauges[0..4]" in umo("show", "parts", str(row), "--gauges", "5").output
    assert (
        umo("device", "get", str(row), "gauges.4", "--gauges", "5", "--unit", "m").stdout
        == "gauges.4  0.000 m  ● good\n"
    )
    assert "gauges.4 is a sensor" in umo("device", "set", str(row), "gauges.4", "1", "--gauges", "5").stderr


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ("check", "row", "--gauge", "3"),
            "row has no option --gauge (did you mean 'gauges'?); it has: --gauges, --top",
        ),
        (("show", "parts", "row", "--gauges", "x"), "row: Invalid value for '--gauges': 'x' is not"),
        (("check", "row", "x"), "unexpected argument 'x'"),
        (("device", "get", "row", "gauges.0", "--nonsense"), "row has no option --nonsense"),
        (("check", "row", "--gauges", "0"), "a row needs a gauge"),
        (("check", "row", "--kind", "3"), "row has no option --kind"),
        (
            ("device", "conform", "row", "--minutes", "3"),
            "; `umo device conform --help` lists the options of the command",
        ),
        (("device", "conform", "row", "--dirver", "x"), "row has no option --dirver (did you mean 'driver'?)"),
    ],
)
def test_a_wrong_option_of_the_machine_is_a_mistake_of_the_user(
    umo: Any, row: Path, words: tuple[str, ...], message: str
) -> None:
    result = umo(*(str(row) if word == "row" else word for word in words))
    assert (result.exit_code, message in result.stderr) == (2, True), result.stderr


def test_a_job_makes_the_same_machine_in_every_process(row: Path) -> None:
    job = Job.load(Job(str(row), options={"gauges": 7}).dump())
    assert len(list(atoms(Plan(job).machine))) == 7
    with pytest.raises(OptionError, match=r"--gauge: unknown option \(did you mean 'gauges'\?\)"):
        Plan(Job(str(row), options={"gauge": 7}))


def test_a_function_that_makes_the_machine_takes_options_too() -> None:
    plan = Plan(Job(machine="umo.stations.furnace.objects:machine", options={"zones": 3}))
    assert len(list(atoms(plan.machine))) == 10
