"""Who drives an actuator: ranks, as the machine, its frames and `umo show why` tell them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from typer.testing import Result

from helpers.machines import relay, sensor, timer, wired
from helpers.operator import Operator
from umo import BinaryActuator, Compound, DigitalSensor, Interlock, TaskFailed, connect, published
from umo.objects.claims import NEXT, WHO, Rank
from umo.operation.commands.client_commands import Mode
from umo.process.frames import Reader
from umo.states import OnOff
from umo.testing import Scripted, periods

Umo = Callable[..., Result]


class Cell(Compound, equipment=True):
    level: DigitalSensor
    valve: BinaryActuator[OnOff]

    def interlocks(self) -> Iterator[Interlock]:
        yield Interlock(lambda: self.level.read() > 8.0, [self.valve], reason="level above 8 V", latched=True)


class Plant(Compound):
    cell: Cell
    pump: BinaryActuator[OnOff]
    timer: DigitalSensor


class Rig:
    """A running plant with its operator and its frames."""

    def __init__(self) -> None:
        self.plant = Plant(cell=Cell(level=sensor(), valve=relay(expires=0.5)), pump=relay(), timer=timer())
        self.box = Scripted()
        self.connection = connect(self.plant, wired(self.plant, self.box))

    def seen(self, path: str = "cell.valve") -> Any:
        """The claim by the machine, which is that of its newest frame."""
        periods(self.m)
        item = self.m.cell.valve if path == "cell.valve" else self.m.pump
        claim = self.reader.claim(self.reader.latest(), self.reader.index(path))
        assert claim == item.claim
        return claim


@pytest.fixture
def rig() -> Iterator[Rig]:
    rig = Rig()
    with rig.connection as rig.m, published(rig.connection, "plant") as ring, Reader(ring.path) as rig.reader:
        periods(rig.m)
        yield rig


def test_each_rank_has_its_reason_and_ends_as_the_table_says(rig: Rig) -> None:
    m = rig.m
    assert rig.seen() == (Rank.PROGRAM, "")
    operator = Operator(m, Mode.MANUAL)
    operator.do("lease", seconds=60.0)
    operator.do("write", "cell.valve", "ON")
    operator.sign()
    assert (rig.seen().rank, m.cell.valve.claim.reason) == (Rank.CLIENT, "taken by client: ann")
    assert not m.cell.valve.write(OnOff.ON)
    rig.box.set("cell.level", 900)
    assert rig.seen() == (Rank.INTERLOCK, "level above 8 V")
    rig.connection.machine.equipment.contain(m.cell, TaskFailed("it was asked to"))
    assert rig.seen() == (Rank.FAULT, "cell is in fault")
    m.cell.cycle.clear()
    assert rig.seen().rank is Rank.INTERLOCK
    rig.box.set("cell.level", 0)
    assert rig.seen().reason.startswith("level above 8 V")
    m.cell.acknowledge()
    assert rig.seen().rank is Rank.PROGRAM
    assert m.cell.valve.pending is OnOff.OFF, "nothing comes back by itself"


def test_a_reset_by_the_program_ends_what_a_client_has_taken_and_the_client_is_told(rig: Rig) -> None:
    operator = Operator(rig.m, Mode.MANUAL)
    operator.do("lease", seconds=60.0)
    number = operator.send("write", "cell.valve", "ON")
    operator.run()
    assert rig.m.cell.valve.claim.rank is Rank.CLIENT
    rig.m.cell.reset()
    operator.run(2)
    assert rig.m.cell.valve.claim.rank is Rank.PROGRAM
    told = [event.text for event in operator.events if event.command == number]
    assert any("it was reset" in text for text in told), told


def test_every_rank_has_words_which_are_those_of_the_page() -> None:
    page = Path(__file__).parents[2].joinpath("docs", "howto-guard-an-actuator.md").read_text("utf-8")
    for rank in Rank:
        assert f"| {rank.name} | {WHO[rank]} | {NEXT[rank]} |" in page


def test_the_command_shows_who_drives_why_and_what_comes_next(umo: Umo, rig: Rig) -> None:
    rig.box.set("cell.level", 900)
    periods(rig.m, 2)
    shown = " ".join(umo("show", "why", "plant", "cell.valve").stdout.split())
    for part in (
        "an interlock: level above 8 V",
        "acknowledged if the interlock is latched",
        "default │ OFF",
        "500 ms after the last write",
    ):
        assert part in shown


@pytest.mark.parametrize(
    ("path", "told"),
    [
        ("cell.level", "cell.level is a sensor, which cannot be driven; `umo device get plant cell.level` shows it"),
        ("cell.vlave", "no object 'cell.vlave' (did you mean 'cell.valve'?)"),
    ],
)
def test_what_nobody_drives_is_told_in_a_line(umo: Umo, rig: Rig, path: str, told: str) -> None:
    result = umo("show", "why", "plant", path)
    assert result.exit_code == 2
    assert told in " ".join(result.stderr.split())


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (["plant", "cell.valve", "--now"], "--now is about missed periods, cell.valve is an actuator"),
        (["plant", "cell.valve", "--file", "kept.box"], "--file is about missed periods, cell.valve is an actuator"),
        (["plant", "--file", "kept.box"], "--file: kept.box names its station itself: leave plant out"),
        (["--now", "--file", "kept.box"], "--now writes a black box, --file reads one"),
    ],
)
def test_what_an_option_has_no_meaning_for_is_refused(umo: Umo, given: list[str], told: str) -> None:
    result = umo("show", "why", *given)
    assert result.exit_code == 2
    assert told in " ".join(result.stderr.split())
