"""Processes: the control process, which runs the loop, and the guardian, which resets the machine if it fails."""

from umo.process.start import RunFailed, Started, start

__all__ = ["RunFailed", "Started", "start"]
