"""Pictures of the plant, drawn without a display. Linux, EGL; needs the extra: pip install "umo[render]".

`MUJOCO_GL=osmesa` chooses the software renderer instead.
"""

from __future__ import annotations

import importlib
import os
from types import TracebackType
from typing import Any

import numpy as np
import numpy.typing as npt

from umo.errors import DriverError

from .plant import Plant

Pixels = npt.NDArray[np.uint8]
MOST_GEOMS = 1000


class Camera:
    """Takes pictures of one open plant. Close it before the program ends, best by a `with` block.

    At most 1280 x 960. Without shadows a picture takes a fifth of the time, which is what a film wants.
    """

    def __init__(
        self,
        plant: Plant,
        width: int = 960,
        height: int = 720,
        *,
        camera: str = "station",
        shadows: bool = True,
    ) -> None:
        model = plant.physics.model
        self._data = plant.physics.data
        self._gl = _context(width, height)
        import mujoco

        self._mj: Any = mujoco
        self._view = self._mj.MjvCamera()
        self._view.type = self._mj.mjtCamera.mjCAMERA_FIXED
        self._view.fixedcamid = model.camera(camera).id
        self._scene = self._mj.MjvScene(model, maxgeom=MOST_GEOMS)
        self._scene.flags[self._mj.mjtRndFlag.mjRND_SHADOW] = shadows
        self._rect = self._mj.MjrRect(0, 0, width, height)
        self._target = self._mj.MjrContext(model, self._mj.mjtFontScale.mjFONTSCALE_100)
        self._mj.mjr_setBuffer(self._mj.mjtFramebuffer.mjFB_OFFSCREEN, self._target)
        self._model, self._option = model, self._mj.MjvOption()

    def picture(self) -> Pixels:
        """The plant as it stands: height x width x RGB."""
        mj = self._mj
        mj.mjv_updateScene(self._model, self._data, self._option, None, self._view, mj.mjtCatBit.mjCAT_ALL, self._scene)
        self._gl.make_current()
        mj.mjr_render(self._rect, self._scene, self._target)
        pixels = np.empty((self._rect.height, self._rect.width, 3), np.uint8)
        mj.mjr_readPixels(pixels, None, self._rect, self._target)
        return np.ascontiguousarray(pixels[::-1])

    def close(self) -> None:
        self._target.free()
        self._gl.free()

    def __enter__(self) -> Camera:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _context(width: int, height: int) -> Any:
    """A current OpenGL context with no window. MuJoCo's own choice falls at its import, too early for us."""
    backend = "osmesa" if os.environ.get("MUJOCO_GL", "").lower() == "osmesa" else "egl"
    try:
        context: Any = importlib.import_module(f"mujoco.{backend}").GLContext(width, height)
    except (ImportError, AttributeError, RuntimeError) as error:
        raise DriverError(f'no OpenGL for pictures ({error}): pip install "umo[render]", libegl1') from error
    context.make_current()
    return context


def render(plant: Plant, width: int = 960, height: int = 720) -> Pixels:
    """One picture of an open plant, at most 1280 x 960: height x width x RGB."""
    with Camera(plant, width, height) as camera:
        return camera.picture()
