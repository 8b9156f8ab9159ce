"""The declaration of twins: what is drawn of a machine, moved by which values."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from typer.testing import Result

from umo import BinaryActuator, Compound, DigitalSensor, Number, connect
from umo.cycle.frame import signals_of
from umo.errors import DeclarationError
from umo.objects import atoms, described, numbers_of
from umo.plant.twin import (
    Body,
    Capsule,
    Carried,
    Colour,
    Cuboid,
    Cylinder,
    Drive,
    Ellipsoid,
    Hinge,
    Mesh,
    Shape,
    Slide,
    Sphere,
    Twin,
    Viewpoint,
    Visible,
    place_of,
    turned,
    twin_of,
)
from umo.plant.twin.declared import declared_by
from umo.process.frames import Layout, Reader, published
from umo.process.frames.layout import describe_signals
from umo.process.station import StationError, find
from umo.states import OnOff

STATIONS = ("ztheta", "conveyor", "furnace", "batch")


class Press(Compound, numbers={"load": Number("mm", shown=True)}):
    ram: DigitalSensor
    table: DigitalSensor
    level: DigitalSensor
    speed: DigitalSensor
    valve: BinaryActuator[OnOff]
    load: float = 0.0


def press() -> Press:
    return Press(
        ram=DigitalSensor("mm", minimum=0, maximum=500, resolution=0.1),
        table=DigitalSensor("deg", minimum=-180, maximum=180, resolution=0.1),
        level=DigitalSensor("dBm", minimum=-100, maximum=100, resolution=0.1),
        speed=DigitalSensor("mm/s", minimum=-100, maximum=100, resolution=0.1),
        valve=BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF),
    )


def body(*drives: Any, shapes: tuple[Shape, ...] = ()) -> dict[str, Any]:
    """The description of one body with these drives."""
    found: dict[str, Any] = Twin([Body("ram", shapes, drives=drives)]).describe(press())["bodies"][0]
    return found


def wrong(*drives: Any) -> str:
    with pytest.raises(DeclarationError) as caught:
        body(*drives)
    return str(caught.value)


# Units ---------------------------------------------------------------------------------------------


def line(drive: Slide | Hinge) -> tuple[float, float]:
    (joint,) = body(drive)["joints"]
    return joint["factor"], joint["offset"]


def test_a_slide_converts_lengths_to_m_and_a_hinge_angles_to_rad() -> None:
    assert line(Slide("ram")) == pytest.approx((1e-3, 0.0))
    assert line(Hinge("table")) == pytest.approx((math.radians(1), 0.0))


def test_scale_and_offset_apply_to_the_converted_value() -> None:
    assert line(Slide("ram", scale=-2.0, offset=0.5)) == pytest.approx((-2e-3, 0.5))


def test_per_names_the_unit_that_scale_is_for() -> None:
    assert line(Hinge("ram", scale=math.tau, per="m")) == pytest.approx((math.tau * 1e-3, 0.0))


def test_a_binary_object_counts_one_in_its_state_one() -> None:
    assert line(Slide("valve", scale=0.03, offset=0.01)) == pytest.approx((0.03, 0.01))


def test_a_signal_drives_a_joint_as_an_object_does() -> None:
    assert line(Slide("load")) == pytest.approx((1e-3, 0.0))


def test_a_value_of_another_dimension_is_refused_with_what_to_write() -> None:
    message = wrong(Slide("table", per="mm"))
    assert "twin: body 'ram': 'table' is in 'deg'" in message
    assert wrong(Slide("speed")) == (
        "twin: body 'ram': 'speed' is in 'mm/s', which is not a length: give `scale` for one unit of it, "
        "and `per='mm/s'`"
    )
    assert "not an angle" in wrong(Hinge("ram"))
    assert "not a speed" in wrong(Carried("valve", "ON", speed="ram", over=1.0, size=(0.1, 0.1)))


def test_a_logarithmic_unit_is_refused() -> None:
    assert "is not linear" in wrong(Slide("level", per="mW"))


def test_per_is_a_unit() -> None:
    with pytest.raises(DeclarationError, match="'metre_long' is not a unit"):
        Slide("ram", per="metre_long")


# Names ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "drive",
    [
        Slide("rm"),
        Hinge("rm"),
        Colour("rm", {0: "#000000", 1: "#ffffff"}),
        Visible("rm", "ON"),
        Carried("rm", "ON", speed="speed", over=1.0, size=(0.1, 0.1)),
    ],
    ids=lambda drive: type(drive).__name__,
)
def test_a_path_that_is_not_there_is_named_with_the_body_and_the_nearest_one(drive: Any) -> None:
    assert wrong(drive) == "twin: body 'ram': there is no object or signal 'rm' (did you mean 'ram'?)"


def test_a_state_that_is_not_there_is_named_with_those_that_are() -> None:
    assert wrong(Visible("valve", "ONN")).endswith("'valve' has no state 'ONN' (did you mean 'ON'?): OFF, ON")
    assert "'ram' is a number in 'mm'; it has no state 'ON'" in wrong(Visible("ram", "ON"))
    assert "'valve' has states, not numbers" in wrong(Colour("valve", {0: "#000000", 1: "#ffffff"}))


def test_a_state_is_described_by_its_level() -> None:
    assert body(Visible("valve", "OFF"))["visible"] == [{"path": "valve", "level": 0.0}]
    (colour,) = body(Colour("valve", {"ON": "#00ff00", "OFF": "#333333"}))["colours"]
    assert colour["stops"] == [[0.0, "#333333"], [1.0, "#00ff00"]]


# The structure -------------------------------------------------------------------------------------


def test_names_of_bodies_are_unique_and_parents_are_there() -> None:
    with pytest.raises(DeclarationError, match="2 bodies are named 'arm'"):
        Twin([Body("arm"), Body("arm")])
    with pytest.raises(DeclarationError, match=r"body 'hand' has no parent 'am' \(did you mean 'arm'\?\)"):
        Twin([Body("arm"), Body("hand", parent="am")])
    with pytest.raises(DeclarationError, match="body 'a' is carried by itself: a < b"):
        Twin([Body("a", parent="b"), Body("b", parent="a")])


@pytest.mark.parametrize(
    "make",
    [
        lambda: Cuboid((0.1, 0.1)),
        lambda: Cuboid((0.1, 0.1, 0.0)),
        lambda: Sphere(-1.0),
        lambda: Sphere(math.nan),
        lambda: Cylinder(0.1, math.inf),
        lambda: Cuboid((1, 1, 1), colour="red"),
        lambda: Cuboid((1, 1, 1), opacity=2.0),
        lambda: Cuboid((1, 1, 1), position=(0, 0)),
        lambda: Cuboid((1, 1, 1), rotation=(1, 1, 0, 0)),
        lambda: Mesh([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 3)]),
        lambda: Mesh([(0, 0)], []),
        lambda: Slide("x", axis=(0, 0, 0)),
        lambda: Slide("x", range=(1.0, 0.0)),
        lambda: Slide("x", scale=math.nan),
        lambda: Hinge("x", anchor=(0, 0)),
        lambda: Colour("x", {0: "#000000"}),
        lambda: Colour("x", {0: "#000000", 1: "white"}),
        lambda: Carried("x", "ON", speed="y", over=0.0, size=(1, 1)),
        lambda: Carried("x", "ON", speed="y", over=1.0, size=(1,)),
        lambda: Body("x", position=(0, math.nan, 0)),
        lambda: Body("x", [Slide("y")]),  # type: ignore[list-item]
        lambda: Body("x", drives=[Sphere(1.0)]),  # type: ignore[list-item]
        lambda: Body("x", [Sphere(1.0)], drives=[Colour("y", {0: "#000000", 1: "#ffffff"}, shape=1)]),
        lambda: Viewpoint((0, 0, 0), (0, 0, 0)),
        lambda: turned((0, 0, 0), 90),
    ],
)
def test_a_wrong_number_or_kind_is_an_error_of_the_declaration(make: Callable[[], object]) -> None:
    with pytest.raises(DeclarationError):
        make()


def test_a_rotation_is_about_its_axis() -> None:
    assert turned((0, 0, 2), 90) == pytest.approx((math.sqrt(0.5), 0, 0, math.sqrt(0.5)))


def test_the_description_is_json_with_every_shape_and_the_entries_of_the_paths() -> None:
    shapes = [Cuboid((1, 2, 3)), Ellipsoid((1, 2, 3)), Sphere(1), Cylinder(1, 2), Capsule(1, 2),
              Mesh([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)])]  # fmt: skip
    drives = [Slide("ram"), Visible("valve", "ON"), Carried("valve", "ON", speed="speed", over=1.0, size=(0.1, 0.1))]
    twin = Twin([Body("all", shapes, drives=drives)], floor=None, view=Viewpoint((1, 1, 1), (0, 0, 0)))
    found = json.loads(json.dumps(twin.describe(press()), allow_nan=False))
    assert [shape["kind"] for shape in found["bodies"][0]["shapes"]] == [
        "box", "ellipsoid", "sphere", "cylinder", "capsule", "mesh"
    ]  # fmt: skip
    assert [entry["path"] for entry in found["paths"]] == ["ram", "speed", "valve"]
    assert found["paths"][0]["unit"] == "mm"
    assert (found["floor"], found["view"]) == (None, {"eye": [1, 1, 1], "target": [0, 0, 0]})


# MuJoCo --------------------------------------------------------------------------------------------

ARM = """<mujoco><compiler angle="radian"/><asset><material name="steel" rgba=".2 .4 .6 1"/>
 <mesh name="wedge" vertex="0 0 0 1 0 0 0 1 0 0 0 1"/></asset>
<worldbody><geom type="plane" size="1 1 .1" pos="0 0 -.2"/><camera pos="1 0 0" xyaxes="0 1 0 0 0 1"/>
 <body name="arm" pos="0 0 1"><joint name="tilt" axis="0 1 0" pos="0 0 .1" range="-1 1" limited="true"/>
  <joint name="lift" type="slide" axis="0 0 1" ref=".5"/><geom type="capsule" size=".1 .2" material="steel"/>
  <geom type="mesh" mesh="wedge"/><geom type="sphere" size=".1" rgba="1 0 0 0"/>
  <body><joint name="ball" type="ball"/><geom type="ellipsoid" size=".1 .2 .3" rgba="1 0 0 .5"/></body></body>
</worldbody></mujoco>"""


@pytest.fixture
def arm() -> str:
    pytest.importorskip("mujoco")
    return ARM


def test_a_mujoco_model_gives_bodies_shapes_and_joints(arm: str, tmp_path: Path) -> None:
    twin = Twin.from_mujoco(arm, {"lift": "ram", "tilt": Drive("table", scale=-1.0, offset=0.2)})
    world, upper, lower = twin.describe(press())["bodies"]
    assert (world["name"], upper["parent"], lower["parent"], lower["name"]) == ("world", "world", "arm", "body 2")
    tilt, lift = upper["joints"]  # in the order of the model
    assert (tilt["kind"], tilt["anchor"], tilt["range"]) == ("hinge", [0, 0, 0.1], [-1, 1])
    assert (tilt["factor"], tilt["offset"]) == pytest.approx((-math.radians(1), 0.2))
    assert (lift["kind"], lift["range"]) == ("slide", None)
    assert (lift["factor"], lift["offset"]) == pytest.approx((1e-3, -0.5)), "the model's coordinate is `ref` at first"
    capsule, mesh = upper["shapes"]  # what is transparent is not drawn
    assert (capsule["kind"], capsule["size"], capsule["colour"]) == ("capsule", [0.1, 0.4], "#336699")
    assert (mesh["kind"], len(mesh["vertices"]), len(mesh["faces"])) == ("mesh", 12, 12)
    assert (lower["shapes"][0]["size"], lower["shapes"][0]["opacity"]) == ([0.2, 0.4, 0.6], 0.5)
    assert (twin.floor, twin.view and twin.view.eye) == (-0.2, (1, 0, 0))
    file = tmp_path / "arm.xml"
    file.write_text(arm)
    assert Twin.from_mujoco(file, {"lift": "ram"}).describe(press())["bodies"][0] == world


def test_faults_of_a_mujoco_model_are_named(arm: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(DeclarationError, match=r"no joint 'lft' \(did you mean 'lift'\?\)"):
        Twin.from_mujoco(arm, {"lft": "ram"})
    with pytest.raises(DeclarationError, match="'ball' of the MuJoCo model is neither a slide nor a hinge"):
        Twin.from_mujoco(arm, {"ball": "ram"})
    with pytest.raises(DeclarationError, match="there is no file"):
        Twin.from_mujoco(tmp_path / "none.xml", {})
    with pytest.raises(DeclarationError, match="cannot be read"):
        Twin.from_mujoco("<mujoco><nonsense/></mujoco>", {})
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(DeclarationError, match=r'pip install "\.\[plant\]" in the clone of umo'):
        Twin.from_mujoco(arm, {})


def test_the_declaration_does_not_import_mujoco_or_the_page() -> None:
    code = "import sys, umo.plant.twin; print({'mujoco', 'starlette', 'umo.clients.page'} & set(sys.modules))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout == "set()\n"


# Stations ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", STATIONS)
def test_the_twin_of_a_station_that_ships_fits_its_machine(name: str) -> None:
    if name == "ztheta":
        pytest.importorskip("mujoco")
    station = find(name)
    twin = declared_by(station)
    assert twin is not None
    found = twin.describe(station.machine())
    assert found["paths"], "every path was found in the machine"
    json.dumps(found, allow_nan=False)


def layout_of(machine: Compound, **about: Any) -> Layout:
    objects = tuple(described(each).plain for each in atoms(machine))
    return Layout(objects, (), about, describe_signals(signals_of(numbers_of(machine))))


def test_the_twin_is_of_the_machine_that_runs_with_its_options() -> None:
    station = find("furnace")
    layout = layout_of(station.machine(zones=7), place=str(station.path), options={"zones": 7})
    found = twin_of(layout, place_of(layout))
    assert found is not None
    assert len(found["bodies"]) == 21


def test_the_frames_tell_the_place_and_the_options_of_a_station(tmp_path: Path) -> None:
    connection = connect(press())
    with (
        connection,
        published(connection, "press", place=tmp_path, options={"zones": 7}) as ring,
        Reader(ring.path) as reader,
    ):
        assert (reader.about["place"], reader.about["options"]) == (str(tmp_path), {"zones": 7})


def test_a_machine_without_a_station_and_a_station_without_twin_py_have_none(tank: Path) -> None:
    assert twin_of(layout_of(press()), Path("-")) is None
    (tank / "twin.py").unlink()
    assert declared_by(find(tank)) is None
    assert twin_of(layout_of(find(tank).machine()), tank) is None


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("def twn(machine): ...", r"twin.py has no twin\(\) \(did you mean 'twn'\?\)"),
        ("def twin(machine): return []", r"twin\(\) of .* returned \[\], not a Twin"),
        ("def twin(machine): return 1 / 0", r"twin\(\) of .* failed: ZeroDivisionError"),
        ("import nothing_such", "twin.py cannot be imported"),
    ],
)
def test_a_wrong_twin_py_is_named_with_its_file(
    umo: Callable[..., Result], tmp_path: Path, text: str, message: str
) -> None:
    name = f"station_{abs(hash(text))}"
    assert umo("new", "station", name).exit_code == 0
    (tmp_path / name / "twin.py").write_text(text + "\n")
    with pytest.raises(StationError, match=message):
        declared_by(find(tmp_path / name))


def test_a_declaration_that_does_not_fit_is_told_to_the_page(umo: Callable[..., Result], tmp_path: Path) -> None:
    describe = pytest.importorskip("umo.clients.page.watched_run").described_twin
    assert umo("new", "station", "plainmachine").exit_code == 0
    place = tmp_path / "plainmachine"
    (place / "twin.py").write_text(
        "from umo.plant.twin import Body, Slide, Twin\n"
        "def twin(m): return Twin([Body('x', drives=[Slide('nothing')])])\n"
    )
    layout = layout_of(find(place).machine())
    assert describe(SimpleNamespace(is_elsewhere=False, own_twin=partial(twin_of, layout, place)), None) == {
        "error": "twin: body 'x': there is no object or signal 'nothing'"
    }


@pytest.mark.parametrize(
    "declare",
    [
        lambda: Carried(sensor="s", state="ON", speed="v", over=math.inf, size=(0.1, 0.1)),
        lambda: Carried(sensor="s", state="ON", speed="v", over="2", size=(0.1, 0.1)),  # type: ignore[arg-type]
        lambda: Sphere(radius="1"),  # type: ignore[arg-type]
        lambda: Sphere(radius=0.1, opacity=None),  # type: ignore[arg-type]
        lambda: Colour("s", ["#000000", "#ffffff"]),  # type: ignore[arg-type]
        lambda: Twin([], floor=math.inf),
    ],
)
def test_what_cannot_be_drawn_is_refused_where_it_is_declared(declare: Callable[[], object]) -> None:
    with pytest.raises(DeclarationError):
        declare()


def test_numbers_of_numpy_are_drawn() -> None:
    body = Body("arm", [Sphere(radius=np.float32(0.1))], position=np.array([0, 0, 1]))  # type: ignore[arg-type]
    described = Twin([body], floor=np.float64(0.5)).describe(Layout((), (), {}))
    assert json.loads(json.dumps(described))["bodies"][0]["position"] == [0.0, 0.0, 1.0]


def test_the_twin_of_a_station_is_that_of_the_machine_with_its_options() -> None:
    station = find("furnace")
    machine = station.machine(zones=3)
    twin = declared_by(station, machine)
    assert twin is not None
    assert twin.describe(machine)["bodies"]
