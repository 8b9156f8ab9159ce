"""Errors of the z-theta station, besides those of its axes and its devices."""

from umo.errors import TaskFailed


class GripError(TaskFailed):
    """No part was gripped, or it was lost."""


class CounterweightError(TaskFailed):
    """The pressure does not carry the arm."""
