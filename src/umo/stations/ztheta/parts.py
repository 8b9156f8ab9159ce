"""The parts on the courier, as bodies of the physics.

A part that lies still, away from the cup, sleeps: it has no weight and no contacts, and moves with the courier. The
part under the cup wakes when the cup comes near. While all parts sleep, MuJoCo does not search for contacts, which
would take most of the time of a step.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

NO_CONTACTS = int(mujoco.mjtDisableBit.mjDSBL_CONTACT) | int(mujoco.mjtDisableBit.mjDSBL_SENSOR)  # type: ignore[attr-defined]
"""The flags of MuJoCo for no search for contacts at all, and for no search for the contacts of the cup."""
NEAR_UM = 65_000.0
"""Height of the cup's tip below which the part under it is awake, um. The part's top stands at 60 mm."""
STILL = 1e-3
"""Largest component of the velocity (m/s, rad/s) of a part that lies still."""
QUIET_STEPS = 50


class Parts:
    """The parts of a model, named part0, part1, ...; all are awake at first. `places` are the indices of their
    positions in qpos."""

    def __init__(self, model: Any, data: Any, count: int) -> None:
        names = [f"part{i}" for i in range(count)]
        self._model, self._qpos, self._qvel, self._lip = model, data.qpos, data.qvel, data.sensordata
        self.places = [int(model.joint(name).qposadr[0]) for name in names]
        self._speeds = [int(model.joint(name).dofadr[0]) for name in names]
        self._bodies = [int(model.body(name).id) for name in names]
        self._geoms = [int(model.geom(name).id) for name in names]
        self._awake: int | None = None
        self._riders = np.array([], np.int64)
        self._quiet = 0

    def sleep(self) -> None:
        """Put all parts to sleep."""
        for part, start in enumerate(self._speeds):
            self._qvel[start : start + 6] = 0.0
            self._set_contacts(part, False)
        self._model.opt.disableflags |= NO_CONTACTS
        self._lip[:] = 0.0
        self._awake, self._quiet = None, 0
        self._riders = np.array(self.places, np.int64)

    def ride(self, distance: float) -> None:
        """Move the sleeping parts with the courier, by this distance in m."""
        self._qpos[self._riders] += distance

    def watch(self, current: int, z_um: float, held: bool) -> None:
        """Wake the part under the cup when the cup is near, and let it sleep when it lies still again. Called once per
        step."""
        if self._awake is None:
            if z_um < NEAR_UM and 0 <= current < len(self.places):
                self._wake(current)
        elif held or z_um < NEAR_UM or not self._is_still(self._awake):
            self._quiet = 0
        else:
            self._quiet += 1
            if self._quiet >= QUIET_STEPS:
                self.sleep()

    def _wake(self, part: int) -> None:
        self._awake = part
        self._riders = np.array([place for i, place in enumerate(self.places) if i != part], np.int64)
        self._set_contacts(part, True)
        self._model.opt.disableflags &= ~NO_CONTACTS

    def _set_contacts(self, part: int, awake: bool) -> None:
        model, geom = self._model, self._geoms[part]
        model.geom_contype[geom] = model.geom_conaffinity[geom] = int(awake)
        model.body_gravcomp[self._bodies[part]] = 0.0 if awake else 1.0

    def _is_still(self, part: int) -> bool:
        start = self._speeds[part]
        return bool(np.abs(self._qvel[start : start + 6]).max() < STILL)
