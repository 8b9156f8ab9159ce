"""Replay of a recorded run: the control code of today on the recorded inputs, compared to the bit."""

from umo.recording.replay.result import Difference, Replayed
from umo.recording.replay.tape import NotReplayable, Tape

__all__ = ["Difference", "NotReplayable", "Replayed", "Tape"]
