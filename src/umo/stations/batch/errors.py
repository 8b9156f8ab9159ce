"""The errors of the batch plant, other than those of its devices.

TaskFailed
|-- ChargingError       the charging line does not fill, weigh or empty its hopper as it should
|-- TemperatureError    a reactor does not come to its temperature, or does not stay there
|-- DrainingError       a reactor does not become empty
`-- BatchesLost         a reactor stayed in fault, so its batches were not made
"""

from umo.errors import TaskFailed


class ChargingError(TaskFailed):
    """A raw material does not flow, the amount is wrong, or the hopper does not become empty."""


class TemperatureError(TaskFailed):
    """A reactor does not come to the temperature of its recipe, or does not stay there."""


class DrainingError(TaskFailed):
    """A reactor does not become empty."""


class BatchesLost(TaskFailed):
    """The fault of a reactor was not cleared in time, so its batches were not made."""
