"""The options of a station: the parameters of its application and of its drivers."""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum
from pathlib import Path
from typing import Any, Literal

import pytest
from rich.console import Console

from umo.cli.station_options import Option, help_panel, options_of, parse
from umo.process.station import Station, StationError


class Colour(Enum):
    RED = "red"
    BLUE = "blue"


class Bare(Station):
    """A station that is an application only."""

    main: Any = None

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
        (["--strokes", "many"], "press: argument --strokes: invalid int value: 'many'"),
        (["--strokes"], "press: argument --strokes: expected one argument"),
        (["--mode", "medium"], "press: argument --mode: invalid choice: 'medium'"),
        (["--stroke", "3"], "press has no option --stroke (did you mean 'strokes'?); it has: --strokes, --force"),
        (["stray"], "press has no option stray"),
    ],
)
def test_what_a_station_does_not_take_is_named(arguments: list[str], message: str) -> None:
    with pytest.raises(StationError) as caught:
        parse(station(work), None, arguments)
    assert str(caught.value).startswith(message)


def test_without_an_application_there_are_no_options() -> None:
    assert options_of(station(None), None) == []
    with pytest.raises(StationError, match=r"press has no option --parts$"):
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


def test_a_type_that_cannot_be_shown_is_text() -> None:
    assert Option("x", Any, None, "application").metavar == "TEXT"
