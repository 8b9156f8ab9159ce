"""Wake-up latency and execution time of a loop on this computer: umo's loop compared with a bare loop in C."""

from umo.commissioning.latency.measure import Samples, measure
from umo.commissioning.latency.verdict import Verdict, judge

__all__ = ["Samples", "Verdict", "judge", "measure"]
