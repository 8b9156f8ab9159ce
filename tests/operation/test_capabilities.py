"""What is attached to a machine by the contract: the order of its calls, hour meters, the trace of writes."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, NoReturn

import pytest

from helpers.machines import actuator, relay, sensor, timer, wired
from helpers.operator import Operator
from umo import BinaryActuator, Compound, DigitalActuator, DigitalSensor, Interlock, action, connect
from umo.control import next_period
from umo.cycle.capability import Capability
from umo.cycle.showing import frame_of
from umo.errors import DeclarationError
from umo.operation.capabilities import AttachedPart, HourMeters, WriteTrace
from umo.operation.commands.client_commands import Mode
from umo.states import OnOff
from umo.testing import Scripted, periods


class Cell(Compound):
    level: DigitalSensor
    valve: BinaryActuator[OnOff]
    heater: DigitalActuator

    def setup(self) -> None:
        self.wanted = 0.0

    def control(self) -> None:
        self.heater.write(self.wanted)

    @action
    def fill(self) -> None:
        """Open the valve."""
        self.valve.write(OnOff.ON)

    def interlocks(self) -> Iterator[Interlock]:
        yield Interlock(lambda: self.level.read() > 8.0, [self.valve], reason="level above 8 V")


class Plant(Compound):
    cell: Cell
    pump: BinaryActuator[OnOff]
    meters: HourMeters
    writes: WriteTrace
    timer: DigitalSensor


def plant() -> Plant:
    return Plant(
        cell=Cell(level=sensor(), valve=relay(), heater=actuator()),
        pump=relay(),
        meters=HourMeters(),
        writes=WriteTrace(),
        timer=timer(),
    )


@pytest.fixture
def box() -> Scripted:
    return Scripted()


@pytest.fixture
def m(box: Scripted) -> Iterator[Any]:
    machine = plant()
    with connect(machine, wired(machine, box)) as m:
        periods(m)
        yield m


def test_an_hour_meter_counts_the_time_away_from_the_default(m: Any) -> None:
    m.pump.write(OnOff.ON)
    periods(m, 1801)
    m.pump.write(OnOff.OFF)
    periods(m, 100)
    assert m.meters.pump.hours == pytest.approx(1.801 / 3600, abs=0.002 / 3600)
    assert m.meters.cell.valve.hours == m.meters.cell.heater.hours == 0.0


def test_the_hours_are_shown_and_kept() -> None:
    machine = plant()
    connection = connect(machine, wired(machine, Scripted()))
    connection.kept = {"meters.pump.hours": {"value": 12.5, "unit": "h", "type": "float"}}
    with connection as m:
        directory = connection.machine.directory
        assert set(directory.kept) == {f"meters.{path}.hours" for path in ("cell.valve", "cell.heater", "pump")}
        assert not connection.not_restored
        assert m.meters.pump.hours == 12.5
        periods(m)
        assert "meters.pump.hours" in {signal.path for signal in frame_of(connection.machine).signals}


def test_a_path_that_no_actuator_has_is_an_attribute_error(m: Any) -> None:
    with pytest.raises(AttributeError, match=r"there is no actuator at cell\.level"):
        _ = m.meters.cell.level


async def fill(m: Any) -> None:
    m.cell.valve.write(OnOff.ON)
    await next_period()


def test_each_write_is_there_with_who_wrote_it(m: Any, box: Scripted) -> None:
    m.pump.write(OnOff.ON)
    m.cell.wanted = 3.0
    m.cycle.start(fill(m))
    periods(m, 2)
    assert [(each["value"], each["who"]) for each in m.writes.last("pump", 1)] == [("ON", "the program")]
    assert m.writes.last("cell.heater")[-1]["who"] == "control of cell"
    assert m.writes.last("cell.valve")[-1]["who"].startswith("sequence fill")
    box.set("cell.level", 900)
    periods(m, 2)
    newest = m.writes.last("cell.valve")[-1]
    assert (newest["value"], newest["who"]) == ("OFF", "default: an interlock")
    m.cell.valve.write(OnOff.ON)
    assert m.writes.last("cell.valve")[-1] == {"time": m.now, "value": "ON", "who": "the program", "taken": False}


def test_a_client_asks_for_the_trace_and_is_named_in_it(m: Any) -> None:
    operator = Operator(m, Mode.MANUAL)
    operator.do("lease", seconds=60.0)
    operator.do("write", "pump", "ON")
    told = operator.do("call", "writes.last", arguments={"path": "pump", "count": 1})
    assert '"who": "client ann"' in told.text, told


def test_an_action_that_a_client_calls_is_named_in_the_trace(m: Any) -> None:
    operator = Operator(m, Mode.MANUAL)
    operator.do("lease", seconds=60.0)
    operator.do("call", "cell.fill")
    newest = m.writes.last("cell.valve")[-1]
    assert (newest["value"], newest["who"]) == ("ON", "action cell.fill")


def test_so_many_writes_are_kept_of_each(m: Any) -> None:
    for number in range(250):
        m.cell.wanted = number / 100
        periods(m)
    found = m.writes.last("cell.heater", 10_000)
    assert len(found) == 100
    assert found[-1]["value"] == 2.49


def test_the_calls_of_the_contract_come_in_their_order() -> None:
    calls: list[str] = []

    class Looks(AttachedPart):
        def attach(self, machine: Any) -> None:
            calls.append("attach")
            machine.phases.showing.append(lambda: calls.append("show"))

        def begin(self) -> None:
            calls.append("begin")

        def end(self) -> None:
            calls.append("end")

        def refuse(self, instead: Callable[..., NoReturn]) -> None:
            calls.append("refuse")

    class Watched(Compound):
        pump: BinaryActuator[OnOff]
        looks: Looks
        timer: DigitalSensor

    machine = Watched(pump=relay(), looks=Looks(), timer=timer())
    connection = connect(machine, wired(machine, Scripted()))
    with connection as m:
        periods(m, 2)
    assert calls == ["attach", "begin", "show", "show", "end"]


def test_laws_bring_the_capability_of_their_class_once_for_all_of_them() -> None:
    calls: list[Any] = []

    class Counts(AttachedPart):
        def __init__(self, laws: Any) -> None:
            calls.append([path for path, _ in laws])

        def attach(self, machine: Any) -> None:
            calls.append("attach")

    class Law:
        _capability = Counts

    class Loop(Compound):
        pump: BinaryActuator[OnOff]

        def setup(self) -> None:
            self.law = Law()

    class Two(Compound):
        loops: list[Loop]
        timer: DigitalSensor

    machine = Two(loops=[Loop(pump=relay()) for _ in range(2)], timer=timer())
    with connect(machine, wired(machine, Scripted())):
        pass
    assert calls == [["loops.0.law", "loops.1.law"], "attach"]


class Counted(Capability):
    """Counts its calls, and the stops."""

    def __init__(self) -> None:
        self.begun, self.calls, self.stops = 0, 0, 0

    def attach(self, machine: Any) -> None:
        machine.phases.commanding.append(self.count)
        machine.under_way.before_cancel.append(self.stop)
        machine.facts.append(lambda: {"counted": str(self.calls)})

    def begin(self) -> None:
        self.begun += 1

    def count(self) -> None:
        self.calls += 1

    def stop(self) -> None:
        self.stops += 1


def test_one_is_attached_while_the_machine_runs_and_found_by_its_class(box: Scripted) -> None:
    machine = plant()
    connection = connect(machine, wired(machine, box))
    with connection as m:
        running = connection.machine
        assert running.find(Counted) is None
        counted = running.attach(Counted())
        assert running.find(Counted) is counted
        periods(m, 3)
        assert (counted.begun, counted.calls, counted.stops) == (1, 3, 0)
        assert re.search(r"counted\W.*?\b3\b", connection._repr_html_(), re.DOTALL)
    assert counted.stops == 1


def test_one_that_is_attached_before_the_machine_begins_begins_with_it(box: Scripted) -> None:
    machine, counted = plant(), Counted()
    connection = connect(machine, wired(machine, box))
    begun: list[int] = []
    connection.laid_out = lambda running: begun.append(running.attach(counted).begun)
    with connection:
        assert (begun, counted.begun) == ([0], 1)


def test_one_that_cannot_be_attached_is_not_there(m: Any) -> None:
    class Refusing(Capability):
        def attach(self, machine: Any) -> None:
            raise DeclarationError("not here")

    with pytest.raises(DeclarationError):
        m._machine.whole.attach(Refusing())
    assert m._machine.whole.find(Refusing) is None


def test_what_a_machine_does_not_have_is_not_imported() -> None:
    """Capabilities, alarms, clients, controllers, frames."""
    import subprocess
    import sys

    code = """
import sys, umo
from umo import BinaryActuator, Compound, connect
from umo.states import OnOff
class Small(Compound):
    pump: BinaryActuator[OnOff]
with connect(Small(pump=BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF))) as m:
    m.sample(), m.control(), m.update()
rooms = {name.split(".")[1] for name in sys.modules if name.startswith("umo.")}
optional = {"capabilities", "alarms", "clients", "operation", "split", "generate", "frames", "recording"}
sys.exit(" ".join(rooms & optional))
"""
    done = subprocess.run([sys.executable, "-c", code], check=False, capture_output=True, text=True)
    assert done.stderr.strip() == ""


# What fails in a capability -----------------------------------------------------------------------------


class Failing(AttachedPart):
    """Its functions fail where it is told to."""

    where: str = ""

    def attach(self, machine: Any) -> None:
        machine.commands.watch(self.note)

    def note(self, slot: int, value: float, source: str, taken: bool) -> None:
        if self.where == source:
            raise RuntimeError("it is broken")

    def end(self) -> None:
        if self.where == "end":
            raise KeyboardInterrupt


class Guarded(Compound):
    pump: BinaryActuator[OnOff]
    level: DigitalSensor
    failing: Failing
    beside: HourMeters
    timer: DigitalSensor

    def interlocks(self) -> Iterator[Interlock]:
        yield Interlock(lambda: self.level.read() > 8.0, [self.pump], reason="level above 8 V")


@pytest.mark.parametrize("where", ["default", "end"])
def test_a_capability_that_fails_keeps_no_output_from_its_default(where: str, box: Scripted) -> None:
    machine = Guarded(pump=relay(), level=sensor(), failing=Failing(where=where), beside=HourMeters(), timer=timer())
    connection = connect(machine, wired(machine, box))
    with connection as m:
        m.pump.write(OnOff.ON)
        periods(m, 2)
        assert box.get("pump") == 1
        if where == "default":
            box.set("level", 18)
            periods(m, 1)
            assert box.get("pump") == 0
    assert connection.reached
    assert box.get("pump") == 0
    (told,) = (event.text for event in connection.machine.events if "failed" in event.text)
    assert ("it is broken" if where == "default" else "Failing.end failed") in told


def test_who_calls_before_the_laws_do_so_beside_each_other(m: Any) -> None:
    called: list[str] = []
    for name in "ab":
        m._machine.whole.phases.before_laws.append(partial(called.append, name))
    periods(m)
    assert called == ["a", "b"]
