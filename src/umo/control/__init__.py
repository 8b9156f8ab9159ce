"""Control laws and sequences. Control laws take objects, not numbers. They raise BadInput if the quality of an
input is not accepted."""

from umo.control.claim import Claim
from umo.control.inputs import HOMING, Accept, state_of, value_of
from umo.control.profile import Profile, Setpoint
from umo.control.regulation import Hysteresis
from umo.control.servo import Servo
from umo.control.stepping import STEPS_PER_PERIOD, Stepping
from umo.cycle.sequences import next_period, together, until, wait

__all__ = [
    "HOMING",
    "STEPS_PER_PERIOD",
    "Accept",
    "Claim",
    "Hysteresis",
    "Profile",
    "Servo",
    "Setpoint",
    "Stepping",
    "next_period",
    "state_of",
    "together",
    "until",
    "value_of",
    "wait",
]
