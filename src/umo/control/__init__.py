"""The parts of control code: control laws, profiles, axes, homing, sequences. States of parts and alarms are in
`umo.operation`, the tuning of laws is in `umo.commissioning`.

Laws take objects, and raise BadInput if the quality of an input is not accepted. `PID` and `Profile` calculate with
plain numbers.
"""

from umo.control.axis import Axis, Homing, SearchResult, move_together
from umo.control.cascade import Cascade
from umo.control.homing import EndStop, HomeSwitch, IndexPulse
from umo.control.hysteresis import Hysteresis
from umo.control.inputs import HOMING, Accept, state_of, value_of
from umo.control.pid import PID, VectorPID
from umo.control.profile import Profile, Setpoint
from umo.control.servo import Servo, VectorServo
from umo.control.servo_axis import ServoAxis
from umo.control.stepper_axis import StepperAxis
from umo.control.stepping import STEPS_PER_PERIOD, Stepping
from umo.cycle.lock import Lock
from umo.cycle.parallel import First, first, together, unless
from umo.cycle.sequences import next_period, timeout, until, wait
from umo.objects.link import Task

__all__ = [
    "HOMING",
    "PID",
    "STEPS_PER_PERIOD",
    "Accept",
    "Axis",
    "Cascade",
    "EndStop",
    "First",
    "HomeSwitch",
    "Homing",
    "Hysteresis",
    "IndexPulse",
    "Lock",
    "Profile",
    "SearchResult",
    "Servo",
    "ServoAxis",
    "Setpoint",
    "StepperAxis",
    "Stepping",
    "Task",
    "VectorPID",
    "VectorServo",
    "first",
    "move_together",
    "next_period",
    "state_of",
    "timeout",
    "together",
    "unless",
    "until",
    "value_of",
    "wait",
]
