"""Wake-up latency and execution time of a loop on this computer: umo's loop compared with a bare loop in C."""

from umo.latency.measure import Samples, measure
from umo.latency.verdict import Answer, judge

__all__ = ["Answer", "Samples", "judge", "measure"]
