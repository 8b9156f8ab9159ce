"""The times of an alarm in a run, as frames have them."""

from __future__ import annotations

from typing import NamedTuple


class AlarmTimes(NamedTuple):
    """The times in s on the cycle's clock. All are 0 if they are not known."""

    raised: float = 0.0
    """Number of times that the alarm has become active since the machine was connected, whether shelved or not."""
    first: float = 0.0
    last: float = 0.0
    """The times at which it first (`first`) and last became active; NaN if it never was."""
    shelved_until: float = 0.0
    """The time at which its shelving ends; infinite if it is not shelved."""
