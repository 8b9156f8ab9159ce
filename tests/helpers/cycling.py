"""Sequences on a small machine, a period at a time; shared by the tests of what sequences await."""

from __future__ import annotations

from helpers.machines import bench, wired
from umo import connect
from umo.control import next_period, together
from umo.errors import Cancelled
from umo.testing import Scripted, VirtualTimer, periods


class Cycle:
    """A bench in virtual time; `steps(n)` runs n periods."""

    def __init__(self, missed=()):
        machine = bench()
        self.connection = connect(machine, wired(machine, Scripted(), clock=VirtualTimer(missed=missed)))

    def __enter__(self):
        self.m = self.connection.__enter__()
        return self

    def __exit__(self, *error):
        self.connection.__exit__(*error)

    def start(self, sequence):
        return self.m.cycle.start(sequence)

    def steps(self, count):
        periods(self.m, count)


def steps_until_done(sequence, missed=(), at_most=1000):
    """The period (from 1) in which the sequence ended."""
    with Cycle(missed) as cycle:
        task = cycle.start(sequence)
        for period in range(1, at_most + 1):
            cycle.steps(1)
            if task.done:
                return period
    raise AssertionError("did not end")


async def after(count, result=None, log=None, error=None):
    """Waits, then ends; notes its cancelling."""
    try:
        for _ in range(count):
            await next_period()
        if error is not None:
            raise error
        return result
    except Cancelled:
        log.append(f"cancelled {result}")
        raise
    finally:
        if log is not None:
            log.append(f"left {result}")


async def gather(*sequences):
    return await together(*sequences)


async def stubborn(log, name):
    try:
        while True:
            await next_period()
    finally:
        log.append(name)
        raise RuntimeError(f"cleaning up {name}")


def by_hand(sequence):
    """Two steps of a sequence that no cycle advances: in the first it asks for its task, and nobody answers."""
    sequence.send(None)
    sequence.send(None)
