"""The states of an axis in the words of PLCopen (Motion Control part 1, section 2.1), and the possible sequences of
states."""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntEnum


class AxisState(IntEnum):
    """States of an axis. Their numbers are stored in frames."""

    DISABLED = 0
    """The axis does not follow a setpoint; its actuators are at their defaults."""
    STANDSTILL = 1
    HOMING = 2
    DISCRETE_MOTION = 3
    """A motion to a position is in progress."""
    CONTINUOUS_MOTION = 4
    """The axis is jogged."""
    STOPPING = 5
    """The axis decelerates to standstill."""
    ERROR_STOP = 6
    """The axis, or the equipment around it, is in fault."""


_S = AxisState

FOLLOWED_BY: Mapping[AxisState, tuple[AxisState, ...]] = {
    _S.DISABLED: (_S.STANDSTILL,),
    _S.STANDSTILL: (_S.HOMING, _S.DISCRETE_MOTION, _S.CONTINUOUS_MOTION, _S.DISABLED),
    _S.HOMING: (_S.STANDSTILL, _S.DISABLED),
    _S.DISCRETE_MOTION: (_S.STANDSTILL, _S.DISABLED),
    _S.CONTINUOUS_MOTION: (_S.CONTINUOUS_MOTION, _S.STANDSTILL, _S.DISABLED),
}
"""The states that may follow a state. Two states are not stored. STOPPING is STANDSTILL while the profile's setpoint
still moves, so any motion may follow. ERROR_STOP is DISABLED while the equipment is in fault. An interrupted motion
that continues returns from STANDSTILL to its former state."""

ACTIONS: Mapping[AxisState, str] = {
    _S.HOMING: "home",
    _S.DISCRETE_MOTION: "move_to",
    _S.CONTINUOUS_MOTION: "jog",
}
"""The motions, with the action that begins each."""
