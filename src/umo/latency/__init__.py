"""How late a loop wakes up on this computer and how long it works: umo's own beside a bare one in C."""

from umo.latency.measure import Samples, measure
from umo.latency.verdict import Answer, judge

__all__ = ["Answer", "Samples", "judge", "measure"]
