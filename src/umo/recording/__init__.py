"""Recordings: every period of a run, its events and commands in an MCAP file, bit by bit."""

from umo.recording.block import BlackBox, Block, TakenCommand
from umo.recording.recording import LostFrames, Recording

__all__ = ["BlackBox", "Block", "LostFrames", "Recording", "TakenCommand"]
