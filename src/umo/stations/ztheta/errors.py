"""The errors of the z-theta station, other than those of its axes and its devices."""

from umo.errors import TaskFailed


class GripError(TaskFailed):
    """No part was gripped, or a gripped part was lost."""


class CounterweightError(TaskFailed):
    """The pressure does not carry the arm."""
