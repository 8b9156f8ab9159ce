"""Compound objects: the tree, its declaration and `control`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import pytest

from helpers.machines import actuator, relay, sensor, switch, wired
from umo import BinaryActuator, BinarySensor, Compound, DigitalActuator, DigitalSensor, connect
from umo.drivers import Direction
from umo.errors import DeclarationError, NotConnected, PathError
from umo.objects import atoms, children, find, path_of, walk
from umo.objects.compound import RESERVED
from umo.objects.stop_order import stop_sequence
from umo.states import EnableDisable, OnOff, PassFail
from umo.testing import Scripted, periods

pytestmark = pytest.mark.usefixtures("each_way")


class Axis(Compound):
    motor: DigitalActuator
    encoder: DigitalSensor
    speed: float = 100.0


class Gripper(Compound):
    vacuum: BinaryActuator[OnOff]
    pressure: BinarySensor[PassFail]


class Robot(Compound):
    z: Axis
    axes: list[Axis]
    grippers: dict[str, Gripper]
    release: BinaryActuator[OnOff]
    count = 0
    favourite = None


def axis(**changes: Any) -> Axis:
    return Axis(motor=actuator(), encoder=sensor(), **changes)


def gripper() -> Gripper:
    return Gripper(vacuum=relay(), pressure=switch())


def robot() -> Robot:
    return Robot(z=axis(), axes=[axis(), axis()], grippers={"left": gripper(), "right": gripper()}, release=relay())


PATHS = [
    "z", "z.motor", "z.encoder",
    "axes.0", "axes.0.motor", "axes.0.encoder", "axes.1", "axes.1.motor", "axes.1.encoder",
    "grippers.left", "grippers.left.vacuum", "grippers.left.pressure",
    "grippers.right", "grippers.right.vacuum", "grippers.right.pressure",
    "release",
]  # fmt: skip


# The tree --------------------------------------------------------------------------------------------


def test_paths_come_from_the_tree_without_the_root_in_declared_order():
    machine = robot()
    assert path_of(machine) == ""
    assert [path_of(node) for node in walk(machine)] == PATHS
    assert machine.axes[1].motor.path == "axes.1.motor"
    assert machine.grippers["left"].vacuum.path == "grippers.left.vacuum"


def test_find_gives_the_object_at_a_path_and_also_below_a_part():
    machine = robot()
    for path in PATHS:
        assert path_of(find(machine, path)) == path
    assert find(machine.axes[1], "motor") is machine.axes[1].motor
    assert find(machine, "axes.1.motor") is machine.axes[1].motor


@pytest.mark.parametrize(("path", "near"), [("z.moter", "z.motor"), ("axis.0.motor", "axes.0.motor"), ("", None)])
def test_a_path_of_no_object_is_an_error_with_the_nearest(path, near):
    with pytest.raises(PathError, match=f"did you mean '{near}'" if near else "no object ''"):
        find(robot(), path)


def test_atoms_and_children():
    machine = robot()
    assert [atom.path for atom in atoms(machine.z)] == ["z.motor", "z.encoder"]
    assert list(children(machine)) == ["z", "axes.0", "axes.1", "grippers.left", "grippers.right", "release"]
    assert children(machine)["release"] is machine.release


def test_parts_show_themselves():
    machine = robot()
    assert repr(machine.z) == "<Axis z: motor, encoder>"
    assert repr(machine).startswith("<Robot: z, axes.0")


def test_two_machines_of_a_class_share_nothing():
    one, other = robot(), robot()
    assert one is not other and one != other
    assert one.z.motor is not other.z.motor
    assert len({one, other}) == 2


def test_a_class_may_be_derived_and_its_parts_follow_those_of_the_base():
    class Better(Axis):
        brake: BinaryActuator[OnOff]

    better = Better(motor=actuator(), encoder=sensor(), brake=relay())
    assert [atom.path for atom in atoms(better)] == ["motor", "encoder", "brake"]


def test_an_optional_part_may_be_left_out():
    class Perhaps(Compound):
        motor: DigitalActuator
        brake: BinaryActuator[OnOff] | None = None

    assert [a.path for a in atoms(Perhaps(motor=actuator()))] == ["motor"]
    assert [a.path for a in atoms(Perhaps(motor=actuator(), brake=relay()))] == ["motor", "brake"]


# Declaration errors ----------------------------------------------------------------------------------


def test_an_object_has_one_parent():
    machine = robot()
    with pytest.raises(DeclarationError, match=r"Axis\.motor is already Axis\.motor: an object has one parent"):
        Axis(motor=machine.z.motor, encoder=sensor())


def test_one_object_in_two_places_of_one_compound_is_an_error():
    class Pair(Compound):
        a: DigitalActuator
        b: DigitalActuator

    motor = actuator()
    with pytest.raises(DeclarationError, match="an object has one parent"):
        Pair(a=motor, b=motor)
    part = axis()
    with pytest.raises(DeclarationError, match="an object has one parent"):
        Robot(z=part, axes=[axis(), part], grippers={}, release=relay())


def test_a_cycle_cannot_be_declared():
    class Ring(Compound):
        parts: list[Any]

    ring = Ring(parts=[relay()])
    with pytest.raises(DeclarationError):
        ring.parts = [ring]
    with pytest.raises(DeclarationError, match="an object has one parent"):
        Ring(parts=[inner := Ring(parts=[]), Ring(parts=[inner])])


@pytest.mark.parametrize(
    "wrong",
    [
        {"motor": sensor()}, {"motor": relay()}, {"motor": None}, {"motor": 1.0}, {"encoder": axis()}, {"motor": "dac"},
        {"speed": relay()},
    ],
)  # fmt: skip
def test_a_wrong_child_is_an_error_at_declaration(wrong):
    with pytest.raises(DeclarationError):
        Axis(**({"motor": actuator(), "encoder": sensor()} | wrong))


def test_a_binary_part_of_another_two_state_type_is_an_error_at_declaration():
    enable = BinaryActuator(EnableDisable, one=EnableDisable.ENABLE, default=EnableDisable.DISABLE)
    with pytest.raises(DeclarationError, match=r"Gripper\.vacuum must have the states OnOff, not EnableDisable"):
        Gripper(vacuum=enable, pressure=switch())


def test_a_wrong_child_in_a_list_or_dict_is_an_error_at_declaration():
    with pytest.raises(DeclarationError, match=r"Robot\.axes must be a Axis"):
        Robot(z=axis(), axes=[axis(), gripper()], grippers={}, release=relay())
    with pytest.raises(DeclarationError, match=r"Robot\.grippers must be a Gripper"):
        Robot(z=axis(), axes=[], grippers={"left": axis()}, release=relay())


def test_a_missing_or_unknown_child_is_an_error_at_declaration():
    with pytest.raises(TypeError, match="encoder"):
        Axis(motor=actuator())
    with pytest.raises(TypeError, match="brake"):
        Axis(motor=actuator(), encoder=sensor(), brake=relay())


def test_parts_are_keywords():
    with pytest.raises(TypeError):
        Axis(actuator(), sensor())


class Loose(Compound):
    parts: Any


@pytest.mark.parametrize(
    "parts",
    [
        lambda: [relay(), 1], lambda: {"a": relay(), "b": None}, lambda: [[relay()]], lambda: {"a": {"b": relay()}},
        lambda: {"a": [relay()]}, lambda: [relay(), [relay()]],
    ],
)  # fmt: skip
def test_objects_beside_other_things_or_deeper_in_a_list_are_an_error_not_forgotten(parts):
    with pytest.raises(DeclarationError, match="parts contains objects and other values"):
        Loose(parts=parts())


@pytest.mark.parametrize("parts", [{"a.b": 1}, {1: 2, "1": 3}])
def test_the_keys_of_parts_make_paths_that_name_one_object_each(parts):
    with pytest.raises(DeclarationError, match="different strings without dots"):
        Loose(parts={key: relay() for key in parts})
    assert Loose(parts=parts).parts == parts  # of other things a dict may be as it likes


@pytest.mark.parametrize("name", sorted(RESERVED))
def test_a_part_with_a_reserved_name_is_refused_with_all_of_them_and_another_name(name):
    with pytest.raises(DeclarationError) as caught:
        type("Bad", (Compound,), {"__annotations__": {name: DigitalActuator}})
    assert str(caught.value) == (
        f"Bad.{name}: the name is reserved; choose another, such as '{name}_button'; reserved are: "
        "acknowledge, control, cycle, dt, interlocks, now, on_resume, on_suspend, reset, sample, setup, update"
    )


def test_at_most_twelve_names_of_a_compound_are_reserved():
    """And all that is not reserved is umo's own, which begins with an underscore."""
    names = {name for name in dir(Compound) if not name.startswith("_")}
    assert names | {"cycle"} == RESERVED
    assert len(RESERVED) <= 12


@pytest.mark.parametrize("name", ["now", "dt", "cycle"])
def test_what_a_class_would_hide_of_the_running_cycle_is_refused(name):
    with pytest.raises(DeclarationError, match=f"{name}: the name is reserved"):
        type("Bad", (Compound,), {name: lambda self: None})
    with pytest.raises(DeclarationError, match=f"{name}: the name is reserved"):
        setattr(robot(), name, 3)


def test_names_with_an_underscore_are_umos():
    with pytest.raises(DeclarationError, match="the name is reserved"):
        type("Bad", (Compound,), {"__annotations__": {"_motor": DigitalActuator}})


def test_a_stop_order_of_unknown_objects_is_an_error_at_declaration():
    class Stops(Compound, stop_order=("moter",)):
        motor: DigitalActuator

    with pytest.raises(PathError, match=r"^stop_order: there is no object .* \(did you mean 'motor'"):
        Stops(motor=actuator())


# Frozen ----------------------------------------------------------------------------------------------


def test_parts_are_fixed_at_construction():
    machine = robot()
    with pytest.raises(DeclarationError, match=r"z\.motor is a part; parts cannot be replaced"):
        machine.z.motor = actuator()
    with pytest.raises(DeclarationError, match="parts cannot be replaced"):
        machine.axes = []
    with pytest.raises(TypeError):
        machine.axes[0] = axis()
    with pytest.raises(AttributeError):
        machine.axes.append(axis())
    with pytest.raises(TypeError):
        machine.grippers["left"] = gripper()
    with pytest.raises(TypeError):
        children(machine)["new"] = relay()


def test_the_callers_list_and_dict_are_copied():
    axes, grippers = [axis()], {"left": gripper()}
    machine = Robot(z=axis(), axes=axes, grippers=grippers, release=relay())
    axes.append(axis())
    grippers.clear()
    assert len(machine.axes) == 1
    assert list(machine.grippers) == ["left"]


def test_an_object_added_later_is_an_error_but_numbers_and_laws_are_not():
    machine = robot()
    with pytest.raises(DeclarationError, match="declare an object as an annotated field"):
        machine.extra = relay()
    machine.count = 3
    machine.z.speed = 50.0
    machine.favourite = machine.z.motor  # it has its parent
    assert (machine.count, machine.z.speed) == (3, 50.0)


def test_setup_is_called_once_the_parts_are_in_place():
    class Ready(Compound):
        motor: DigitalActuator

        def setup(self):
            self.seen = self.motor._parent is self, list(children(self))

    assert Ready(motor=actuator()).seen == (True, ["motor"])


# One period ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "use", [lambda m: m.sample(), lambda m: m.update(), lambda m: m.reset(), lambda m: m.cycle.period]
)
def test_outside_connect_a_machine_has_no_hardware(use):
    with pytest.raises(NotConnected, match="Robot is not connected"):
        use(robot())
    machine = robot()
    with connect(machine):
        assert machine.cycle.connected and machine.z.cycle.connected
    assert not (
        machine.cycle.connected or machine.cycle.running or machine.z.cycle.connected or machine.z.motor.connected
    )
    with pytest.raises(NotConnected):
        use(machine)


def test_sample_update_and_reset_of_a_part_move_that_part_only():
    machine, box = robot(), Scripted()
    with connect(machine, wired(machine, box)) as m:
        start = len(box.calls)
        assert m.axes[1].sample() is True
        assert m.axes[1].update() is True
        m.grippers["left"].reset()
        assert [(call.segment, call.channels) for call in box.calls[start:]] == [
            ("read_many", ("axes.1.encoder",)),
            ("write_many", ("axes.1.motor",)),
            ("reset", ("grippers.left.vacuum",)),
            ("reset", ("grippers.left.pressure",)),
        ]


def test_reset_recurses_over_the_actuators_in_stop_order_then_the_sensors():
    machine, box = robot(), Scripted()
    with connect(machine, wired(machine, box)) as m:
        start = len(box.calls)
        m.reset()
        sensors = [item.path for item in atoms(machine) if item.direction is Direction.INPUT]
        expected = [*(item.path for item in stop_sequence(machine)), *sensors]
        assert [call.channels[0] for call in box.calls[start:]] == expected


class Noted:
    """Notes each `control` in the order it is called."""

    log: list[str] = []


class ControlledRelay(BinaryActuator[OnOff]):
    def control(self) -> None:
        Noted.log.append(path_of(self))


class ControlledAxis(Axis):
    def control(self) -> None:
        Noted.log.append(path_of(self))


class FinerAxis(ControlledAxis):
    def control(self) -> None:
        Noted.log.append(f"{path_of(self)} before")
        super().control()
        Noted.log.append(f"{path_of(self)} after")


class Pair(Compound):
    """Has no `control` of its own; its parts have."""

    left: Axis
    right: Axis


class Cell(Compound):
    lamp: BinaryActuator[OnOff]
    pair: Pair
    rows: list[Axis]

    def control(self) -> None:
        Noted.log.append("cell")
        super().control()


def cell() -> Cell:
    return Cell(
        lamp=ControlledRelay(OnOff, one=OnOff.ON, default=OnOff.OFF),
        pair=Pair(left=ControlledAxis(motor=actuator(), encoder=sensor()), right=axis()),
        rows=[FinerAxis(motor=actuator(), encoder=sensor()), ControlledAxis(motor=actuator(), encoder=sensor())],
    )


ALL = ["cell", "lamp", "pair.left", "rows.0 before", "rows.0", "rows.0 after", "rows.1"]


@pytest.fixture(autouse=True)
def _log():
    Noted.log = []


def test_control_recurses_in_declared_order_a_parent_before_its_children_each_once():
    with connect(cell()) as m:
        m.control()
        assert Noted.log == ALL
        m.control()
        assert Noted.log == ALL * 2


def test_control_of_a_part_drives_that_part_and_what_is_below():
    with connect(cell()) as m:
        m.pair.control()
        assert Noted.log == ["pair.left"]
        m.rows[0].control()
        assert Noted.log[1:] == ["rows.0 before", "rows.0", "rows.0 after"]


def test_an_atomic_object_with_control_acts_by_itself_too():
    with connect(cell()) as m:
        m.lamp.control()
        assert Noted.log == ["lamp"]


def test_outside_connect_control_is_the_classs_own():
    machine = cell()
    machine.rows[1].control()
    assert Noted.log == ["rows.1"]
    with connect(machine):
        pass
    Noted.log.clear()
    machine.rows[1].control()
    assert Noted.log == ["rows.1"]


def test_setpoints_flow_down_within_one_period():
    class Follower(Compound):
        motor: DigitalActuator
        goal: float = 0.0

        def control(self) -> None:
            self.motor.write(self.goal)

    class Leader(Compound):
        follower: Follower

        def control(self) -> None:
            self.follower.goal += 1.0

    with connect(Leader(follower=Follower(motor=actuator()))) as m:
        periods(m, 3)
        assert m.follower.motor.read() == 3.0


def test_an_error_in_control_surfaces():
    class Broken(Compound):
        motor: DigitalActuator

        def control(self) -> None:
            raise ZeroDivisionError("control")

    with connect(Broken(motor=actuator())) as m, pytest.raises(ZeroDivisionError, match="control"):
        m.control()


@pytest.mark.parametrize("hint", [Sequence[Axis], tuple[Axis, ...], list[Axis]])
def test_a_list_of_parts_is_a_tuple_whatever_sequence_it_is_annotated(hint: Any) -> None:
    Line = type("Line", (Compound,), {"__annotations__": {"axes": hint}})
    m = Line(axes=[axis(), axis()])
    assert isinstance(m.axes, tuple)
    assert list(children(m)) == ["axes.0", "axes.1"]
    with pytest.raises(DeclarationError, match=r"Line.axes must be a Axis"):
        Line(axes=[axis(), actuator()])
    with pytest.raises(DeclarationError, match=r"Line.axes is annotated .*, not as a Mapping"):
        Line(axes={"left": axis()})


@pytest.mark.parametrize("hint", [Mapping[str, Axis], dict[str, Axis]])
def test_a_dict_of_parts_is_a_read_only_mapping(hint: Any) -> None:
    Line = type("Line", (Compound,), {"__annotations__": {"axes": hint}})
    m = Line(axes={"left": axis()})
    with pytest.raises(TypeError):
        m.axes["right"] = axis()
    with pytest.raises(DeclarationError, match=r"Line.axes must be a Axis"):
        Line(axes={"left": actuator()})
    with pytest.raises(DeclarationError, match=r"Line.axes is annotated .*, not as a Sequence"):
        Line(axes=[axis()])
