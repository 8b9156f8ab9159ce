"""The time budget of a run: it determines how long the rules will take, and which of them may take longer."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from time import monotonic

from umo.duration import duration, lasting
from umo.testing.conformance.rules import ALWAYS, LINE, NOTHING, Cost, Rule
from umo.text import count_of

LATE_SHARE, LATE_TIME = 0.1, 5.0
"""Share of the budget, and time in s, by which a rule may take longer than planned before it is cut short."""
FINAL_SHARE = 0.04
"""Share of the budget that is reserved for the end, because the last rules may also take longer than planned."""
SAFETY_FACTOR = 1.15
"""Factor by which times that were measured from a few calls are multiplied. It is the accuracy of such times."""
LONG_RUN_TRANSFERS = 70_000
"""Number of transfers in the long run. It is larger than the range of a 16-bit number."""
SPARE_SHARE, LARGEST_SPARE_SHARE = 0.3, 0.9
"""The usual share of the spare time for a rule, and the largest share, if the rules after it cannot use all of it."""
SPARE_SHARES = {"long run": 0.9, "memory": 0.5}
"""Shares of the spare time for the last rules."""


@dataclass(frozen=True)
class CallTime:
    """Times in s of one call, measured from a few calls."""

    opening: float = 0.0
    """Time to open a driver, to initialise, reset and finalise its channels, and to close the driver."""
    transfer: float = 0.0
    wait: float = 0.0
    """Time to wait for a timeout."""
    channels: int = 1
    connecting: float = 0.0
    """Additional time of a call that reconnects."""
    settling: float = 0.0
    """Time until the levels of all loop-backs have arrived."""
    watchdog: float = 0.0
    """Time of the watchdog in the device."""

    def of(self, cost: Cost) -> float:
        """Return the shortest time in s for a rule with this cost."""
        transfers = (cost.calls + cost.each * self.channels) * self.transfer
        measured = cost.opens * self.opening + transfers + cost.connects * self.connecting
        known = cost.waits * self.wait + cost.settles * self.settling + cost.watchdogs * self.watchdog + cost.sleeps
        return measured * SAFETY_FACTOR + known


@dataclass(frozen=True)
class TimePlan:
    """The time that a run will take. `str` returns a sentence for the user."""

    pace: CallTime
    budget: float
    """Time in s that the run may still take, after the few calls that were measured."""
    least: dict[str, float]
    """Least time in s of each rule."""
    shown: dict[str, float]
    """Time in s of each rule with all its optional parts."""

    @property
    def full(self) -> float:
        return sum(self.shown.values())

    @property
    def left_out(self) -> tuple[str, ...]:
        """The rules that will not fit into the time, as far as this is known in advance."""
        total, out = 0.0, []
        for rule, seconds in self.least.items():
            if total + seconds > self.budget:
                out.append(rule)
            else:
                total += seconds
        return tuple(out)

    def __str__(self) -> str:
        text = (
            f"a transfer takes {duration(round(self.pace.transfer, 6))}: up to {lasting(min(self.full, self.budget))} "
            f"of the {lasting(self.budget)} that are allowed"
        )
        if self.left_out:
            enough = lasting(sum(self.least.values()))
            rules = count_of(len(self.least), "rule")
            text += f". Of {rules} {len(self.left_out)} will not fit ({enough} would be enough): "
            text += ", ".join(self.left_out)
        elif self.full > self.budget:
            text += f"; all rules would take {lasting(self.full)}"
        return f"{text}. If time runs short, the kit first leaves out transfers of the long run, levels and openings"


def _more_of(cost: Cost, line: bool) -> Cost:
    """Return the cost of the optional part of a rule. Without a line between driver and device nothing in it waits."""
    more = cost.more or NOTHING
    return more if line else replace(more, waits=0, sleeps=0)


class Budget:
    """The time that remains for the rule that is tried now."""

    def __init__(self, seconds: float, rules: Sequence[Rule], clock: Callable[[], float] = monotonic) -> None:
        self.clock = clock
        self._end = clock() + seconds
        self._seconds = seconds
        self._rules = rules
        self._least: dict[str, float] = {rule.id: 0.0 for rule in rules}
        self._shown: dict[str, float] = dict(self._least)
        """Time in s of each rule with all its optional parts."""
        self._until = self._end
        self._unpromised: frozenset[str] = frozenset()
        """Rules that will not fit, as the plan says."""
        self._kept = 0.0
        """Time in s for the rules that are tried at any rate, and for the end."""
        self.left_out: list[str] = []
        """Rules that did not fit."""
        self.parts: dict[str, str] = {}
        """Parts that were left out, as text, by the rule."""

    def plan(self, pace: CallTime, cycles: int | None, line: bool = True) -> TimePlan:
        """Make and return the plan of the run. Its time begins now. `cycles`: number of cycles of the long run; None
        means as many as the long run can use. `line`: True if there is a line between driver and device that the kit
        can disturb."""
        transfer = pace.transfer * SAFETY_FACTOR
        for rule in self._rules:
            cost = rule.cost if line or rule.theme not in LINE else NOTHING
            self._least[rule.id] = pace.of(cost) if rule.theme != ALWAYS else 0.0
            more = transfer * LONG_RUN_TRANSFERS if rule.id == "long run" else pace.of(_more_of(cost, line))
            most = more if cycles is None else min(more, cycles * transfer * pace.channels)
            self._shown[rule.id] = self._least[rule.id] + most
        self._kept = sum(pace.of(rule.cost) for rule in self._rules if rule.theme == ALWAYS)
        self._kept += FINAL_SHARE * self._seconds
        plan = TimePlan(pace, max(0.0, self._left), dict(self._least), dict(self._shown))
        self._unpromised = frozenset(plan.left_out)
        return plan

    @property
    def _left(self) -> float:
        """Return the remaining time in s, without the reserved part."""
        return self._end - self.clock() - self._kept

    def begin(self, rule: Rule) -> bool:
        """Return True if the rule fits into the remaining time. Then `more` refers to this rule. A rule that the plan
        has promised also fits if earlier rules took a little longer. Any other rule fits only if enough time remains
        for the promised rules after it."""
        left, least = self._left, self._least[rule.id]
        behind = [each.id for each in self._rules[self._rules.index(rule) + 1 :]]
        promised = sum(self._least[each] for each in behind if each not in self._unpromised)
        needed = least + promised if rule.id in self._unpromised else least - LATE_SHARE * self._seconds
        if left < needed:
            self.left_out.append(rule.id)
            return False
        spare = max(0.0, left - least - sum(self._least[each] for each in behind))
        unused = left - least - sum(self._shown[each] for each in behind)
        share = SPARE_SHARES.get(rule.id, SPARE_SHARE)
        self._until = self.clock() + least + max(share * spare, min(unused, LARGEST_SPARE_SHARE * spare))
        return True

    def begin_again(self, rule: Rule) -> bool:
        """Return True if the rule, or a part of it, was left out, and the whole rule fits into the time that remains
        after the other rules. Then `more` refers to this rule."""
        if rule.id not in (*self.left_out, *self.parts) or self._left < self._shown[rule.id]:
            return False
        self.left_out = [each for each in self.left_out if each != rule.id]
        self.parts.pop(rule.id, None)
        self._until = self.clock() + self._left
        return True

    @property
    def latest(self) -> float:
        """The time, in s of the clock, at which a rule is cut short."""
        return self._end + LATE_SHARE * self._seconds + LATE_TIME

    @property
    def more(self) -> bool:
        """True if the rule may continue with its optional part."""
        return self.has(0.0)

    def has(self, seconds: float) -> bool:
        """Return True if there is time for something that takes this long."""
        return self.clock() + seconds < self._until
