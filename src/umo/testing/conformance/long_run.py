"""Runs cycles of transfers whose readings are checked, and calls that fail."""

from __future__ import annotations

import os
from collections import deque
from functools import partial
from itertools import pairwise
from math import inf

import numpy as np

from umo.drivers.contract import Direction, IntArray
from umo.testing.conformance.budget import LONG_RUN_TRANSFERS
from umo.testing.conformance.probe import Probe
from umo.testing.conformance.rule_context import DriverCall, RuleContext
from umo.testing.conformance.rules import WRITTEN_MANY, RuleBroken
from umo.testing.conformance.subject import Output

WARMING_CYCLES = 50
"""Number of cycles in which the kit finds out which loop-backs are slow."""
FEWEST_CYCLES = 5
"""Smallest number of cycles."""
MAX_ALONE = 2
"""Largest number of channels of each direction that are transferred alone when memory is measured."""
LEVEL_SETS = 64
"""Number of sets of levels that are written in turn."""
QUICK_FAILURE = 0.02
"""Time in s within which a call must fail to be repeated often."""
SLOW_FACTOR, SLOW_TIME = 3.0, 0.002
"""Limits above which a cycle counts as slow: this factor times the duration of the first cycles, plus this time in
s."""
FREE_GROWTH = 1 << 20
"""Number of bytes by which the process may grow, because an allocator keeps memory."""
GROWTH_PER_CALL = 32
"""Number of bytes by which the process may grow with each transfer."""
STATM = "/proc/self/statm"


class LongRun:
    """Runs cycles on a driver with open channels. Each cycle writes all outputs as a block and one output alone, and
    reads all channels as a block and one channel alone."""

    def __init__(self, context: RuleContext, probe: Probe) -> None:
        self.context, self.probe = context, probe
        self.calls = 0
        self.readable = tuple(map(probe.channel, context.readable))
        self.outputs = tuple(probe.channel(each.channel) for each in context.subject.outputs)
        self._out = np.zeros(len(self.readable), np.int64)
        outputs = context.subject.outputs
        table = [[each.other(i + 3 * number) for i, each in enumerate(outputs)] for number in range(LEVEL_SETS - 1)]
        self._table = [np.array(raws, np.int64) for raws in (*table, [each.default for each in outputs])]
        self._turn = 0
        self._shown = {i: each for i, each in enumerate(outputs) if each in context.viewed}
        """Outputs that can be read, by their number."""
        self._place = {text: i for i, text in enumerate(context.readable)}
        self._lags: set[str] = set()
        """Channels that show the written level late or not exactly."""
        self._steady = {text: probe.read(text) for text in context.steady if text in context.readable}
        self._told = context.told(probe)
        self._before: dict[str, int] = {}
        self.failing = self._failing()
        self.per_cycle = 2 * bool(self.readable) + 2 * bool(self.outputs)
        self.most = LONG_RUN_TRANSFERS if context.cycles is None else self.per_cycle * context.cycles
        self._grown = 0
        self.early = inf
        """Duration in s of the quickest of the first cycles."""
        self._took: deque[float] = deque(maxlen=WARMING_CYCLES)

    def cycle(self) -> None:
        """Read and write all channels as a block, then one channel alone."""
        self.probe.call("cycle", self._transfer)

    def _transfer(self) -> None:
        driver, turn = self.probe.driver, self._turn
        self._turn += 1
        if self.outputs:
            raws = self._table[turn % LEVEL_SETS]
            driver.write_many(self.outputs, raws)
            one = turn % len(self.outputs)
            driver.write(self.outputs[one], int(raws[one]))
        if self.readable:
            driver.read_many(self.readable, self._out)
            self._alone = turn % len(self.readable), driver.read(self.readable[turn % len(self.readable)])

    def longer_cycle(self) -> None:
        """Run a cycle, and then transfer some channels alone, so that memory left behind by each single transfer is
        found sooner."""
        self.cycle()
        self.probe.call("cycle", self._some_alone)

    def _some_alone(self) -> None:
        driver, raws = self.probe.driver, self._raws.tolist()
        for channel, raw in zip(self.outputs[:MAX_ALONE], raws, strict=False):
            driver.write(channel, raw)
        for channel in self.readable[:MAX_ALONE]:
            driver.read(channel)

    def fail(self) -> None:
        """Make one call that fails."""
        call = self.failing[self._turn % len(self.failing)]
        self._turn += 1
        self.context.failure(call)

    def go(self, most: int | None = None) -> None:
        """Run a number of cycles; default: run until there were enough transfers, or the time is over."""
        number, early = 0, 0
        while (self.per_cycle and number < FEWEST_CYCLES) or (self.calls < self.most and self.context.budget.more):
            if number == most:
                return
            self.context.share = self.calls / self.most
            self.cycle()
            self._took.append(self.context.watch.took)
            if number < WARMING_CYCLES:
                self.early = min(self._took)
            self.calls += self.per_cycle
            self._look(number)
            number += 1
            if self.failing and number % WARMING_CYCLES == 0:
                self.fail()
            if number == max(WARMING_CYCLES, self.most // self.per_cycle // 4):
                early = _resident()
        if early and (grown := _resident() - early) > FREE_GROWTH + GROWTH_PER_CALL * self.calls:
            raise RuleBroken(
                f"the process grew by {grown / 1e6:.1f} MB in the last three quarters of {self.calls:,} transfers"
            )
        self._grown = early

    @property
    def late(self) -> float:
        """The duration in s of the quickest of the last cycles."""
        return min(self._took)

    @property
    def slow(self) -> bool:
        """True if the last cycles took much longer than the first ones."""
        return self.calls > 2 * WARMING_CYCLES * self.per_cycle and self.slower_than(self.early)

    def slower_than(self, quickest: float) -> bool:
        return self.late > SLOW_FACTOR * quickest + SLOW_TIME

    @property
    def remark(self) -> str:
        """A remark on what was examined."""
        words = [f"{self.calls:,} transfers"]
        if not self._shown and not self._steady:
            words.append("no reading is known in advance, so no reading was compared")
        if self._lags:
            why = "the driver receives its values from elsewhere" if self._told else "the level changes slowly"
            words.append(f"{', '.join(sorted(self._lags))}: compared only sometimes, because {why}")
        if not self._grown:
            words.append("too few calls to see whether the process grows")
        return "; ".join(words)

    @property
    def _raws(self) -> IntArray:
        """Levels that the last cycle wrote."""
        return self._table[(self._turn - 1) % LEVEL_SETS]

    # Readings ---------------------------------------------------------------------------------------

    def _look(self, number: int) -> None:
        """Raise RuleBroken if a reading of the last cycle is wrong."""
        found = dict(zip(self.context.readable, self._out.tolist(), strict=True))
        alone = {}
        if self.readable:
            place, raw = self._alone
            alone[self.context.readable[place]] = raw
        for text, expected in self._steady.items():
            for now in (found[text], alone.get(text, expected)):
                if now != expected:
                    self._wrong(text, now, expected, f"reading of {text}", f"reading of {text} in a block")
        for i, output in self._shown.items():
            view, raw = self.context.view(output), int(self._raws[i])
            if view in self._lags and number % WARMING_CYCLES:
                continue
            for now in (found[view], alone.get(view, found[view])):
                if now != raw and not self.context.same(output, raw, now):
                    self._explain(view, output, raw, now, number)
                    break
            self._before[view] = raw

    def _explain(self, view: str, output: Output, raw: int, now: int, number: int) -> None:
        """Judge a wrong reading of a loop-back. A loop-back may be slow: then it reads a level on the way, and reaches
        the right level later. If the first cycles show that it is slower than a cycle, it may be on the way to any
        earlier level. It is a fault if the level has arrived long ago, and the next block still returns the previous
        one."""
        low, high = sorted((raw, self._before.get(view, output.default)))
        there = self.context.is_read(self.probe, output, raw)
        on_its_way = low <= now <= high or view in self._lags or self.context.subject.agree is not None
        if not there or (not on_its_way and number > WARMING_CYCLES):
            recorded = self.context.subject.levels is not None
            causes = [f"reading of {view}" if recorded else f"level of {output.channel}"]
            self._wrong(view, now, raw, *causes, *([] if there else [WRITTEN_MANY]))
        if view not in self._lags and not self._told:
            self._check_is_time(view, output)
            self.probe.write_many([each.channel for each in self.context.subject.outputs], self._raws)
        self._lags.add(view)

    def _check_is_time(self, view: str, output: Output) -> None:
        """Raise RuleBroken if a block reads the previous level although the present level has arrived."""
        place, levels = self._place[view], (output.default, output.other(), output.default)
        for before, raw in pairwise(levels):
            self._write_all(output, before)
            self.context.is_read(self.probe, output, before)
            self.probe.read_many(self.context.readable)
            self._write_all(output, raw)
            self.context.arrive(None, output, raw)
            if self.context.same(output, raw, found := self.probe.read_many(self.context.readable)[place]):
                return
        text = f"a block read {found} for {view}, although {output.channel} was at {raw} and this level had arrived"
        raise RuleBroken(text, f"earlier reading of {view}")

    def _write_all(self, output: Output, raw: int) -> None:
        outputs = self.context.subject.outputs
        self.probe.write_many([each.channel for each in outputs],
                              [raw if each == output else each.default for each in outputs])  # fmt: skip

    def _wrong(self, text: str, now: int, expected: int, *causes: str) -> None:
        raise RuleBroken(f"{text} read {now} after {self.calls:,} transfers, not {expected}", *causes)

    # Calls that fail ------------------------------------------------------------------------------------

    def _failing(self) -> list[DriverCall]:
        """Return calls that the device or the driver refuses immediately."""
        context, probe = self.context, self.probe
        calls: list[DriverCall] = []
        for text in context.subject.refused:
            direction = probe.channel(text).direction
            if Direction.INPUT in direction:
                calls += [partial(probe.read, text), partial(probe.read_many, (*context.readable, text))]
            if Direction.OUTPUT in direction and context.subject.outputs:
                calls += [partial(probe.write, text, 0)]
        if context.subject.outputs:
            only_in = [t for t in context.readable if Direction.OUTPUT not in probe.channel(t).direction]
            calls += [partial(probe.write_many, (text,), (0,)) for text in only_in[:1]]
        return [call for call in calls if fails_at_once(context, call)]


def fails_at_once(context: RuleContext, call: DriverCall) -> bool:
    """True if a call fails without waiting."""
    error = context.failure(call)
    return error is not None and not isinstance(error, TimeoutError) and context.watch.took < QUICK_FAILURE


def _resident() -> int:
    """Return the number of bytes of memory that the process uses, or 0 if it is unknown."""
    try:
        with open(STATM, encoding="ascii") as file:
            return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except (OSError, ValueError):
        return 0
