"""The wake-up latency and the execution time of umo's loop on this computer, compared with a bare loop in C."""

from umo.commissioning.latency.measure import Samples, measure
from umo.commissioning.latency.verdict import Verdict, judge

__all__ = ["Samples", "Verdict", "judge", "measure"]
