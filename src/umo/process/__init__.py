"""Processes: a control process that nothing disturbs, and a guardian that outlives it."""

from umo.process.start import RunFailed, Started, start

__all__ = ["RunFailed", "Started", "start"]
