"""Replay of a recorded run: the control code of today on the recorded inputs, compared to the bit."""

from umo.replay.result import Difference, Replayed
from umo.replay.tape import NotReplayable, Tape

__all__ = ["Difference", "NotReplayable", "Replayed", "Tape"]
