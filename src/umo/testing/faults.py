"""Injects faults on purpose between a machine and its drivers. The faults are the same for the same seed.

    with connect(press(), wiring, fault="pressure stuck at 5 ms for 20 ms") as m: ...
    with connect(press(), wiring, fault=[InjectedFault("pressure", "noise", "0.2 bar", at=0.5)], fault_seed=7) as m: ...

In a wiring: `faults = ["z.encoder stuck at 5 s"]` before the first table. On the command line:
`umo run ztheta --fault "z.encoder stuck at 5 s"`. docs/howto-inject-faults.md says what each kind does.
"""

from umo.drivers.faults.fault_syntax import KINDS, InjectedFault

__all__ = ["KINDS", "InjectedFault"]
