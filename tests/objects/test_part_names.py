"""Names of parts: a part may have any name but the reserved ones; it may refer to its parent."""

from __future__ import annotations

import dataclasses
import keyword
import unicodedata
from collections.abc import Iterator
from typing import Annotated, Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from helpers.machines import actuator, relay, sensor, switch, timer, wired
from umo import (
    BinaryActuator,
    Compound,
    DigitalActuator,
    DigitalSensor,
    Interlock,
    Number,
    Range,
    action,
    check,
    connect,
    published,
)
from umo.clients.remote import RemoteStation
from umo.control import Servo, state_of
from umo.errors import DeclarationError
from umo.objects import actions_of, atoms, find, path_of, walk
from umo.objects.compound import RESERVED
from umo.process.frames import Reader
from umo.states import OnOff, PassFail
from umo.testing import Scripted, periods, put

FORMER = [
    "start", "stop", "running", "home", "path", "signals", "tunable", "period", "connected", "progress", "walk",
    "atoms", "children", "find", "stop_order", "max_period", "numbers", "read", "write", "mode", "lease", "name",
    "parent", "self",
]  # fmt: skip
"""Names that umo used to have, has elsewhere, or that a machine's parts have most often."""


def is_name(text: str) -> bool:
    return (
        text.isidentifier()
        and not keyword.iskeyword(text)
        and not text.startswith("_")
        and text == unicodedata.normalize("NFKC", text)
        and text not in {*RESERVED, "timer"}
    )


NAMES = st.sampled_from(FORMER) | st.from_regex(r"[^\W\d_]\w{0,8}", fullmatch=True).filter(is_name)


def small(name: str) -> type[Compound]:
    """A compound with a motor of this name, an action and an interlock."""

    @action(by=Range("V", 0.0, 5.0))
    def turn(self: Any, by: float) -> float:
        getattr(self, name).write(by)
        return by

    def interlocks(self: Any) -> Iterator[Interlock]:
        yield Interlock(lambda: False, [self], "never")

    body = {"__annotations__": {name: DigitalActuator}, f"{name}_turn": turn, "interlocks": interlocks}
    return type("Small", (Compound,), body)


@given(st.lists(NAMES, min_size=4, max_size=4, unique=True))
def test_a_machine_whose_parts_have_any_names_runs(names: list[str]) -> None:
    gauge, part, single, many = names
    annotations = {"timer": DigitalSensor, gauge: DigitalSensor, part: Compound, single: BinaryActuator, many: list}
    kind: Any = type("Odd", (Compound,), {"__annotations__": annotations}, stop_order=(single, f"{part}.{gauge}", many))
    inner = small(gauge)
    parts = {gauge: sensor(), part: inner(**{gauge: actuator()}), single: relay(), many: [relay(), relay()]}
    machine = kind(timer=timer(), **parts)
    paths = ["timer", gauge, f"{part}.{gauge}", single, f"{many}.0", f"{many}.1"]
    assert [item.path for item in atoms(machine)] == paths
    wiring = wired(machine, Scripted())
    assert check(machine, wiring) == []
    with connect(machine, wiring) as m:
        put(getattr(m, gauge), 20.0)
        periods(m)
        assert getattr(m, gauge).read() == 20.0
        assert path_of(find(m, f"{part}.{gauge}")) == f"{part}.{gauge}"
        act = actions_of(m)[f"{part}.{gauge}_turn"]
        assert act.call(**act.converted({"by": 2.5})) == 2.5
        periods(m, 2)
        assert getattr(getattr(m, part), gauge).read() == 2.5
        assert m.cycle.running and m.cycle.connected
        m.reset()
        assert getattr(getattr(m, part), gauge).read() == 0.0
        assert "Odd" in m._repr_html_() + repr(m)


@pytest.mark.skipif("sys.platform != 'linux'")
def test_parts_with_the_names_of_a_remote_stations_own_members_are_reached_by_their_paths() -> None:
    names = ["start", "stop", "running", "mode", "lease", "reader", "path", "read"]
    kind: Any = type(
        "Odd", (Compound,), {"__annotations__": {"timer": DigitalSensor} | dict.fromkeys(names, DigitalActuator)}
    )
    machine = kind(timer=timer(), **{name: actuator() for name in names})
    connection = connect(machine, wired(machine, Scripted()))
    with connection, published(connection, "odd") as ring:
        for number, name in enumerate(names):
            getattr(machine, name).write(float(number))
        periods(machine)
        with RemoteStation(Reader(ring.path)) as station:
            assert [station[name].read() for name in names] == [float(number) for number in range(len(names))]


# Parents -------------------------------------------------------------------------------------------------


class Reactor(Compound, numbers={"wanted": Number("V", shown=True)}):
    heater: DigitalActuator
    temperature: DigitalSensor
    gain: Annotated[float, Number("", 0.0, 1.0, tunable=True)] = 0.5
    neighbour: Reactor | None = None
    cell: Cell = dataclasses.field(init=False)
    """The parent sets it."""

    def setup(self) -> None:
        self.servo = Servo(self.temperature, self.heater, gain=self.gain)

    @property
    def wanted(self) -> float:
        return self.cell.wanted

    def control(self) -> None:
        if state_of(self.cell.door) is PassFail.PASS:
            self.heater.write(self.cell.wanted)


class Cell(Compound):
    timer: DigitalSensor
    door: Any
    left: Reactor
    right: Reactor
    wanted: float = 3.0

    def setup(self) -> None:
        for reactor, other in ((self.left, self.right), (self.right, self.left)):
            reactor.cell, reactor.neighbour = self, other


def reactor() -> Reactor:
    return Reactor(heater=actuator(), temperature=sensor())


def test_a_part_may_refer_to_its_parent_and_to_its_neighbour() -> None:
    m = Cell(timer=timer(), door=switch(), left=reactor(), right=reactor())
    assert [path_of(node) for node in walk(m)] == [
        "timer", "door", "left", "left.heater", "left.temperature", "right", "right.heater", "right.temperature",
    ]  # fmt: skip
    wiring = {**wired(m, Scripted()), "parameters": {"wanted": 4.0, "left.gain": 0.25, "right.servo.gain": 0.75}}
    assert check(m, wiring) == []
    with connect(m, wiring):
        put(m.door, PassFail.PASS)
        periods(m, 2)
        assert (m.left.heater.read(), m.left.wanted, m.right.neighbour) == (4.0, 4.0, m.left)
        assert (m.left.servo.gain, m.right.servo.gain) == (0.25, 0.75)
    assert m.left.cell is m


def test_a_part_of_a_part_may_refer_to_the_machine() -> None:
    class Hall(Compound):
        cells: list[Cell]

        def setup(self) -> None:
            for cell in self.cells:
                cell.left.hall = cell.hall = self

    hall = Hall(cells=[Cell(timer=timer(), door=switch(), left=reactor(), right=reactor())])
    assert hall.cells[0].left.hall is hall.cells[0].hall is hall


def test_an_object_of_no_machine_is_no_attribute() -> None:
    m = Cell(timer=timer(), door=switch(), left=reactor(), right=reactor())
    with pytest.raises(DeclarationError, match="declare an object as an annotated field"):
        m.left.spare = relay()
    with pytest.raises(DeclarationError, match="declare an object as an annotated field"):
        m.left.other = Cell(timer=timer(), door=switch(), left=reactor(), right=reactor())


def test_a_station_may_call_its_button_a_reset_button() -> None:
    class Panel(Compound):
        reset_button: BinaryActuator[OnOff]

    assert [item.path for item in atoms(Panel(reset_button=relay()))] == ["reset_button"]
