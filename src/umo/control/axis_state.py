"""The state of an axis in the words of PLCopen (Motion Control part 1, section 2.1); what others must know of it."""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntEnum
from typing import Any, Protocol, cast

from umo.control.profile import Profile
from umo.objects import DigitalSensor, Node
from umo.objects.link import Machine


class AxisState(IntEnum):
    """The numbers stand in frames."""

    DISABLED = 0
    """It does not follow a setpoint; its actuators are at their defaults."""
    STANDSTILL = 1
    HOMING = 2
    DISCRETE_MOTION = 3
    """A motion to a position is under way."""
    CONTINUOUS_MOTION = 4
    """It is jogged."""
    STOPPING = 5
    """It decelerates to standstill."""
    ERROR_STOP = 6
    """It, or the equipment around it, is in fault."""


class DescribedAxis(Protocol):
    """An axis (`umo.control.Axis`), as far as it is described here."""

    encoder: DigitalSensor
    profile: Profile
    velocity: float
    acceleration: float
    jerk: float
    window: float
    homing: Any
    enabled: bool
    _motion: str | None

    @property
    def _path(self) -> str: ...

    @property
    def _machine(self) -> Machine: ...


MOTIONS = {
    "home": AxisState.HOMING,
    "move_to": AxisState.DISCRETE_MOTION,
    "jog": AxisState.CONTINUOUS_MOTION,
}
"""The state in which an axis carries out each motion."""


def state_of(axis: DescribedAxis) -> AxisState:
    if axis._machine.fault_of(cast(Node, axis)) is not None:
        return AxisState.ERROR_STOP
    if not axis.enabled:
        return AxisState.DISABLED
    if axis._motion is not None:
        return MOTIONS[axis._motion]
    return AxisState.STANDSTILL if axis.profile.done else AxisState.STOPPING


def described(axis: DescribedAxis) -> Mapping[str, Any]:
    """As plain data: its states, the paths of what belongs to it, its limits in units of the encoder and s."""
    path, encoder = axis._path, axis.encoder
    return {
        "path": path,
        "states": [state.name.lower() for state in AxisState],
        "position": encoder._path,
        "units": encoder.units,
        "minimum": encoder.minimum,
        "maximum": encoder.maximum,
        "window": axis.window,
        "setpoint": f"{path}.setpoint",
        "error": f"{path}.error",
        "velocity": f"{path}.profile.velocity",
        "acceleration": f"{path}.profile.acceleration",
        "largest": {"velocity": axis.velocity, "acceleration": axis.acceleration, "jerk": axis.jerk},
        "move": f"{path}.move_to",
        "jog": f"{path}.jog",
        "disable": f"{path}.disable",
        "home": None if axis.homing is None else f"{path}.home",
    }
