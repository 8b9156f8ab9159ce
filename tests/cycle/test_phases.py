"""The phases of a period: the table, the order in which they come, and who is bound to each."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from typer.testing import Result

import umo as package
from helpers.machines import actuator, relay, sensor, timer, wired
from umo import BinaryActuator, Compound, DigitalActuator, DigitalSensor, Interlock, connect
from umo.cycle.laid_out import laid_out
from umo.cycle.machine_view import connect_compounds
from umo.cycle.part_periods import PartPeriods
from umo.cycle.period import PHASES, PeriodPhase
from umo.states import OnOff
from umo.testing import Scripted, periods
from umo.wiring import resolve
from umo_command.show.period_table import acting_in

Umo = Callable[..., Result]


class Slow(Compound, every=3):
    heater: DigitalActuator

    def control(self) -> None:
        pass


class Plant(Compound):
    level: DigitalSensor
    valve: BinaryActuator[OnOff]
    slow: Slow
    timer: DigitalSensor

    def control(self) -> None:
        pass

    def interlocks(self) -> Iterator[Interlock]:
        yield Interlock(lambda: self.level.read() > 8.0, [self.valve], reason="level above 8 V")


def plant() -> Plant:
    return Plant(level=sensor(), valve=relay(expires=0.5), slow=Slow(heater=actuator()), timer=timer())


def test_the_phases_come_in_the_order_of_the_table(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a machine with parts of another rate."""
    m = plant()
    connection = connect(m, wired(m, Scripted()))
    seen: list[str] = []
    with connection:
        machine: Any = connection.machine
        period, image = machine.phases, machine.image
        for where, name in (
            (period.before_tick, "BEFORE TICK"),
            (period.receiving, "RECEIVE"),
            (period.commanding, "COMMANDS"),
            (period.before_send, "SEND"),
            (period.showing, "SHOW"),
        ):
            where.append(lambda name=name: seen.append(name))

        def noted(owner: Any, function: str, name: str) -> None:
            real = getattr(owner, function)
            monkeypatch.setattr(owner, function, lambda *given: (seen.append(name), real(*given))[1])

        noted(image, "sample", "SAMPLE")
        noted(period.guards, "evaluate", "GUARD")
        noted(machine.sequences, "advance", "SEQUENCES")
        noted(machine.acting_laws, "act", "LAWS")
        noted(period, "settle", "SETTLE")
        parts = machine.find(PartPeriods)
        noted(parts, "_send_urgent", "OWED")
        on_tick = machine.clock.on_tick
        machine.clock.on_tick = lambda: (seen.append("TICK"), on_tick())
        period.bind()
        connect_compounds(machine, parts.view_of)
        for _ in range(6):
            period.settle_once(lambda: None)
            seen.clear()
            periods(m)
            own = seen[seen.index("TICK") :]
            whole = own[: own.index("SEND") + 1]
            assert whole == ["TICK", "RECEIVE", "SAMPLE", "GUARD", "COMMANDS", "SEQUENCES", "LAWS", "SEND"]
            groups = own[len(whole) :]
            assert groups[:2] == ["SAMPLE", "GUARD"]
            assert groups[-2:] == ["OWED", "SHOW"]
    names = [phase.name for phase in PHASES]
    assert [name for name in names if name in whole] == whole


def test_who_is_bound_is_told_in_words() -> None:
    m = plant()
    with laid_out(m, resolve(m, None)) as machine:
        bound = acting_in(machine)
    assert list(bound) == [phase.name for phase in PHASES]
    assert bound["SAMPLE"] == ["1 sensor on Simulated"]
    assert bound["GUARD"] == ["1 interlock", "1 expiring command"]
    assert bound["LAWS"] == ["the machine (Plant)"]
    assert bound["GROUPS"] == ["slow, every 3 periods"]
    assert bound["SEND LATE"] == bound["RECEIVE"] == bound["BEFORE TICK"] == []
    assert not m.cycle.connected


@pytest.mark.parametrize("station", ["ztheta", "conveyor", "furnace", "batch"])
def test_the_command_shows_every_phase(umo: Umo, station: str) -> None:
    result = umo("show", "period", station)
    assert result.exit_code == 0, result.stderr
    for phase in PHASES:
        assert phase.name in result.stdout


def test_the_command_shows_the_whole_machine_only(umo: Umo) -> None:
    result = umo("show", "period", "ztheta", "z")
    assert result.exit_code == 2
    assert "umo show period shows the whole machine" in " ".join(result.stderr.split())


@pytest.mark.parametrize("phase", PHASES, ids=lambda phase: phase.name)
def test_the_modules_of_a_phase_are_there(phase: PeriodPhase) -> None:
    room = Path(package.__file__).parent
    for where in phase.where.split(", "):
        assert any(path.exists() for path in (room / where, room / f"{where}.py", room / "cycle" / f"{where}.py"))
