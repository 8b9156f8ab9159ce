"""Replays a recorded run: the control code of today acts on the recorded inputs, and its outputs are compared with the
recorded ones bit by bit."""

from umo.recording.replay.result import Difference, Replayed
from umo.recording.replay.tape import NotReplayable, Tape

__all__ = ["Difference", "NotReplayable", "Replayed", "Tape"]
