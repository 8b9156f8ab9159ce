"""The errors of the furnace, other than those of its devices.

TaskFailed
|-- OverTemperature    a zone is far above its limit: its heater does not switch off
|-- HeatingError       a zone does not follow its setpoint: a dead heater, a thermocouple that reads too low
`-- TooManyFaults      too many zones have no valid temperature
"""

from umo.errors import TaskFailed


class OverTemperature(TaskFailed):
    """A zone is far above its limit, although its heater is inhibited."""


class HeatingError(TaskFailed):
    """A zone does not reach its set temperature in time."""


class TooManyFaults(TaskFailed):
    """Too many zones have no valid temperature."""
