"""The bodies of a MuJoCo model. MuJoCo is imported only here; it needs the extra `plant`."""

from __future__ import annotations

import importlib
import os
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from umo.errors import DeclarationError, text_of
from umo.plant.twin.bodies import Body, Viewpoint
from umo.plant.twin.drives import Drive, Hinge, Joint, Slide
from umo.plant.twin.shapes import Capsule, Cuboid, Cylinder, Ellipsoid, Mesh, Shape, Sphere
from umo.system.packages import how_to_install
from umo.text import did_you_mean

WORLD = "world"
UNCOLOURED = (0.5, 0.5, 0.5, 1.0)
"""MuJoCo's colour of a geom for which no colour is declared. Such a geom has the colour of its material."""


def parts(given: Any, joints: Mapping[str, str | Drive]) -> tuple[list[Body], float | None, Viewpoint | None]:
    """Return the bodies, the height of the floor, and the view."""
    mj = _mujoco()
    model = _loaded(mj, given)
    moving = {name: _joint(mj, model, name, drive) for name, drive in joints.items()}
    bodies = [_body(mj, model, number, moving) for number in range(model.nbody)]
    planes = [g for g in range(model.ngeom) if model.geom_type[g] == mj.mjtGeom.mjGEOM_PLANE]
    floor = float(model.geom_pos[planes[0]][2]) if planes else None
    return bodies, floor, _view(model)


def _mujoco() -> Any:
    try:
        return importlib.import_module("mujoco")
    except ImportError as error:
        raise DeclarationError(f"a twin of a MuJoCo model needs MuJoCo ({error}): {how_to_install('plant')}") from None


def _loaded(mj: Any, given: Any) -> Any:
    if isinstance(given, mj.MjModel):
        return given
    try:
        if isinstance(given, str) and given.lstrip().startswith("<"):
            return mj.MjModel.from_xml_string(given)
        if not Path(given).is_file():
            raise DeclarationError(f"there is no file {os.fspath(given)!r} of a MuJoCo model")
        return mj.MjModel.from_xml_path(os.fspath(given))
    except (ValueError, TypeError) as error:
        raise DeclarationError(f"the MuJoCo model cannot be read: {text_of(error)}") from None


def _joint(mj: Any, model: Any, name: str, given: str | Drive) -> tuple[int, Joint]:
    """Return the joint's number, and the joint of the twin. A slide and a hinge of MuJoCo count from their `ref`;
    `qpos0` is the coordinate of the body's declared place."""
    names = [model.joint(number).name for number in range(model.njnt)]
    if name not in names:
        raise DeclarationError(f"the MuJoCo model has no joint {name!r}{did_you_mean(name, names)}")
    number, drive = names.index(name), given if isinstance(given, Drive) else Drive(given)
    kind = {int(mj.mjtJoint.mjJNT_SLIDE): Slide, int(mj.mjtJoint.mjJNT_HINGE): Hinge}.get(int(model.jnt_type[number]))
    if kind is None:
        raise DeclarationError(f"the joint {name!r} of the MuJoCo model is neither a slide nor a hinge")
    start = float(model.qpos0[model.jnt_qposadr[number]])
    options: dict[str, Any] = {"axis": _floats(model.jnt_axis[number])}
    if kind is Hinge:
        options["anchor"] = _floats(model.jnt_pos[number])
    if model.jnt_limited[number]:
        low, high = _floats(model.jnt_range[number])
        options["range"] = (low - start, high - start)
    return number, kind(drive.path, drive.scale, drive.offset - start, drive.per, **options)


def _body(mj: Any, model: Any, number: int, joints: Mapping[str, tuple[int, Joint]]) -> Body:
    geoms = range(model.body_geomadr[number], model.body_geomadr[number] + model.body_geomnum[number])
    shapes = [shape for geom in geoms if (shape := _shape(mj, model, geom)) is not None]
    own = sorted((at, joint) for at, joint in joints.values() if model.jnt_bodyid[at] == number)
    return Body(
        _name(model, number),
        shapes,
        parent=_name(model, int(model.body_parentid[number])) if number else None,
        position=_floats(model.body_pos[number]),
        rotation=_floats(model.body_quat[number]),
        drives=[joint for _, joint in own],
    )


def _name(model: Any, number: int) -> str:
    return str(model.body(number).name) or (f"body {number}" if number else WORLD)


def _shape(mj: Any, model: Any, geom: int) -> Shape | None:
    """Return the shape of a geom, or None if the geom is not drawn: a plane, a height field, a transparent geom."""
    kinds = mj.mjtGeom
    r, g, b, opacity = _colour(model, geom)
    options: dict[str, Any] = {
        "position": _floats(model.geom_pos[geom]),
        "rotation": _floats(model.geom_quat[geom]),
        "colour": "#" + bytes(round(255 * min(max(share, 0.0), 1.0)) for share in (r, g, b)).hex(),
        "opacity": opacity,
    }
    x, y, z = _floats(model.geom_size[geom])
    whole = (2 * x, 2 * y, 2 * z)
    shapes: dict[int, Callable[..., Shape]] = {
        int(kinds.mjGEOM_BOX): partial(Cuboid, whole),
        int(kinds.mjGEOM_ELLIPSOID): partial(Ellipsoid, whole),
        int(kinds.mjGEOM_SPHERE): partial(Sphere, x),
        int(kinds.mjGEOM_CYLINDER): partial(Cylinder, x, 2 * y),
        int(kinds.mjGEOM_CAPSULE): partial(Capsule, x, 2 * y),
        int(kinds.mjGEOM_MESH): partial(_mesh, model, int(model.geom_dataid[geom])),
    }
    shape = shapes.get(int(model.geom_type[geom]))
    return shape(**options) if shape is not None and opacity else None


def _mesh(model: Any, mesh: int, **options: Any) -> Mesh:
    vertex, face = int(model.mesh_vertadr[mesh]), int(model.mesh_faceadr[mesh])
    vertices = model.mesh_vert[vertex : vertex + model.mesh_vertnum[mesh]]
    faces = model.mesh_face[face : face + model.mesh_facenum[mesh]]
    return Mesh(vertices.tolist(), faces.tolist(), **options)


def _colour(model: Any, geom: int) -> tuple[float, ...]:
    own, material = _floats(model.geom_rgba[geom]), int(model.geom_matid[geom])
    return _floats(model.mat_rgba[material]) if material >= 0 and own == UNCOLOURED else own


def _view(model: Any) -> Viewpoint | None:
    """Return the view of the first camera that is fixed in the world. It looks along its own -z axis, to the distance
    of the model's centre."""
    for number in range(model.ncam):
        if model.cam_bodyid[number] == 0:
            eye, ahead = model.cam_pos0[number], -model.cam_mat0[number].reshape(3, 3)[:, 2]
            away = max(float((model.stat.center - eye) @ ahead), float(model.stat.extent))
            return Viewpoint(_floats(eye), _floats(eye + away * ahead))
    return None


def _floats(array: Any) -> tuple[float, ...]:
    """Return floats. Those of single precision, such as colours, are rounded to the decimal numbers that were meant."""
    return tuple(round(float(x), 7) if array.dtype == "float32" else float(x) for x in array)
