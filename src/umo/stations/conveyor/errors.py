"""The errors of the conveyor, other than those of its devices.

PartsLost ends a run; the others put the sorter in fault.
"""

from umo.errors import TaskFailed


class Jam(TaskFailed):
    """A part does not move on with the belt."""


class PartMissing(TaskFailed):
    """A part did not come, or did not arrive at the exit barrier."""


class BarrierStuck(TaskFailed):
    """A light barrier is covered where no part can be."""


class DriveError(TaskFailed):
    """The belt does not have the speed that was commanded."""


class EmergencyStop(TaskFailed):
    """The emergency stop was pressed."""


class PartsLost(TaskFailed):
    """No operator continued in time after a fault, a stop, or a lack of parts, so not all parts were sorted."""
