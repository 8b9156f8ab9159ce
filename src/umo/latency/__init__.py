"""Wake-up latency and execution time of a loop on this computer: umo's loop compared with a bare loop in C."""

from umo.latency.measure import Samples, measure
from umo.latency.verdict import Verdict, judge

__all__ = ["Samples", "Verdict", "judge", "measure"]
