"""The physics of the z-theta station: plant.xml, its parts, and their step of 1 ms."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from .courier import Courier, Pose
from .devices import Counterbalance, EncoderCounter, StepDrive, SuctionCup
from .parts import Parts

mj: Any = mujoco  # its compiled half carries no types

Z_RESOLUTION, Z_ORIGIN, Z_INDEX = 4.64357, -147_871.0, 58_117
"""Encoder of Listing 5, um; the index pulse stands on line 58117, at 121,999.4 um."""
THETA_RESOLUTION, THETA_INDEX_DEG = 0.000529483, 227.4438
"""Encoder of Listing 5, deg; the index pulse stands on line 0."""
NOMINAL = 60_200.0
"""The pressure that carries the arm, Pa: 752 counts. At 0 V friction holds the arm from 680 to 820 counts."""
PITCH = 0.05
"""Distance between two parts on the courier, m."""
SCATTER, SCATTER_DEG = 0.0025, 5.0
"""The largest distance from its nominal place at which a part may start: in m for x and y, in deg for yaw."""
COLOURS = ((0.84, 0.20, 0.18, 1.0), (0.20, 0.62, 0.30, 1.0), (0.16, 0.38, 0.80, 1.0))


class Physics:
    """The machine and its courier. The seed determines the initial positions, which no control code knows."""

    def __init__(self, *, seed: int, parts: int, preset: int, faults: Collection[str]) -> None:
        rng = np.random.default_rng(seed)
        stops = [PITCH * (i - (parts - 1) / 2) for i in range(parts)]  # the rightmost part comes first
        half = PITCH / 2 * parts + 0.015
        park = -half - 0.075
        bodies = 0 if "no-part" in faults else parts
        self.model = model = _build(rng, half, [park - stop for stop in stops[:bodies]])
        self.data = data = mj.MjData(model)
        self._mj_step = mj.mj_step
        # memoryviews: quicker than numpy's items
        self._qpos, self._ctrl, self._lip = data.qpos.data, data.ctrl.data, data.sensordata.data
        self._z, self._theta, self._courier_x = (
            int(model.joint(name).qposadr[0]) for name in ("z", "theta", "courier")
        )
        self.parts = Parts(model, data, bodies)
        self._stalled = "stalled-theta" in faults
        self._drops = "dropped-part" in faults
        self._dropped_at: float | None = None
        self.counterbalance = self._start(rng, park)
        self.gripper = SuctionCup(leaky="leaky-cup" in faults)
        self.courier = Courier(stops, self.pose, park=park, absent="no-courier" in faults)
        self.z_counter = EncoderCounter(
            resolution=Z_RESOLUTION, origin=Z_ORIGIN, index=Z_INDEX, preset=preset, bits=16, signed=False
        )
        self.theta_counter = EncoderCounter(
            resolution=THETA_RESOLUTION, origin=THETA_INDEX_DEG, index=0, preset=0, bits=24, signed=True
        )
        self.power_up()
        self.z_counter.dead = "dead-z-encoder" in faults
        self.theta_counter.dead = "dead-theta-encoder" in faults

    def _start(self, rng: np.random.Generator, park: float) -> Counterbalance:
        """Stand still somewhere: balanced at some height, or without pressure and sunk onto the lower stop.

        The height is either below `courier.CLEAR_UM` or above z's index: in between, a search for the index
        that goes down first would meet the part that the courier brings at once.
        """
        balanced = rng.random() < 0.6
        height = rng.uniform(0.056, 0.098) if rng.random() < 0.7 else rng.uniform(0.123, 0.128)
        theta = rng.uniform(-260.0, 260.0)
        self._qpos[self._z] = height if balanced else 0.0545
        self._qpos[self._theta] = math.radians(theta)
        self._qpos[self._courier_x] = park
        if self._stalled:
            self.model.dof_damping[int(self.model.joint("theta").dofadr[0])] = 100.0
        cylinder = Counterbalance(NOMINAL if balanced else 0.0)
        self.data.ctrl[:] = (0.0, 0.0, cylinder.pressure, 0.0, park)
        for _ in range(200):  # the arm and the parts settle
            self._mj_step(self.model, self.data)
        self.parts.sleep()
        return cylinder

    def power_up(self) -> None:
        """Switch the circuits on: counts are 0, and the drive holds the rotor at its present angle."""
        self.z_counter.power_up(self.z_um)
        self.theta_counter.power_up(self.theta_deg)
        self.drive = StepDrive(math.radians(self.theta_deg))

    # Truth, which no channel carries ------------------------------------------------------------

    @property
    def z_um(self) -> float:
        return float(self._qpos[self._z]) * 1e6

    @property
    def theta_deg(self) -> float:
        return math.degrees(self._qpos[self._theta])

    def pose(self, part: int) -> Pose:
        """Return the pose of the part when the courier stands at the stop of this part."""
        start = self.parts.places[part]
        x, y, z, qw, qx, qy, qz = self._qpos[start : start + 7].tolist()
        x -= float(self._qpos[self._courier_x]) - self.courier.stop(part)
        yaw = math.atan2(2.0 * (qw * qz + qx * qy), 1.0 - 2.0 * (qy * qy + qz * qz))
        return Pose(x * 1e6, y * 1e6, -math.degrees(yaw), z * 1e6)

    # The step -----------------------------------------------------------------------------------

    def step(
        self,
        volts: float,
        steps: int,
        z_index: int,
        theta_index: int,
        valve: int,
        vacuum: int,
        puff: int,
    ) -> None:
        """Advance everything by 1 ms under these levels; `steps` is the number of steps sent to theta since the last
        physics step."""
        qpos, courier, gripper = self._qpos, self.courier, self.gripper
        z_um = qpos[self._z] * 1e6
        theta = qpos[self._theta]
        torque = self.drive.torque(steps, theta)
        if self._drops:
            self._drop(theta)
        force = gripper.step(vacuum, puff, self._lip[0] >= 6.0)
        ctrl = self._ctrl
        ctrl[0] = volts
        ctrl[1] = 0.0 if self._stalled else torque
        ctrl[2] = self.counterbalance.step(valve)
        ctrl[3] = force
        ctrl[4] = courier.target(z_um)
        courier_m = qpos[self._courier_x]
        self._mj_step(self.model, self.data)
        if courier.moving:
            self.parts.ride(qpos[self._courier_x] - courier_m)
        self.parts.watch(courier.current, z_um, force > 0.0)
        self.z_counter.follow(qpos[self._z] * 1e6, z_index)
        self.theta_counter.follow(math.degrees(qpos[self._theta]), theta_index)
        if courier.present and self.parts.places:
            height = qpos[self.parts.places[courier.current] + 2] * 1e6
            courier.watch(height, z_um=z_um, held=force > 0.0)

    def _drop(self, theta: float) -> None:
        """Cause the fault "dropped-part": the seal breaks when a lifted part has been turned by 20 deg."""
        if not (self.gripper.sealed and self.courier.lifted):
            self._dropped_at = None
        elif self._dropped_at is None:
            self._dropped_at = theta
        elif abs(theta - self._dropped_at) > math.radians(20.0):
            self.gripper.tear()


def _build(rng: np.random.Generator, half: float, places: Sequence[float]) -> Any:
    """Return plant.xml with the courier's pallet cut to length and the parts scattered on it."""
    spec = mj.MjSpec.from_string(Path(__file__).with_name("plant.xml").read_text("utf-8"))
    spec.geom("pallet").size[0] = half
    box = spec.find_default("part")
    for i, place in enumerate(places):
        dx, dy = rng.uniform(-SCATTER, SCATTER, 2)
        yaw = math.radians(rng.uniform(-SCATTER_DEG, SCATTER_DEG))
        body = spec.worldbody.add_body(
            name=f"part{i}", pos=[place + dx, dy, 0.055], quat=[math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)]
        )
        body.add_freejoint(name=f"part{i}")
        body.gravcomp = 1e-9  # not 0: MuJoCo would ignore what `Parts` sets later
        body.add_geom(box, name=f"part{i}", rgba=COLOURS[i % len(COLOURS)])
    return spec.compile()
