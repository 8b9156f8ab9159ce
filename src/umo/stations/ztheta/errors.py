"""What can go wrong at the z-theta station, besides its devices.

TaskFailed
|-- HomingError    an axis could not find its reference
|-- AxisError      an axis does not follow: a stalled or over-driven motor, a dead encoder
`-- GripError      no part was gripped, or one was lost
"""

from umo.errors import TaskFailed


class HomingError(TaskFailed):
    """An axis could not find its reference."""


class AxisError(TaskFailed):
    """An axis is not where it was told to be."""


class GripError(TaskFailed):
    """No part was gripped, or it was lost."""
