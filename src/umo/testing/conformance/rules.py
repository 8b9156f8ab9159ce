"""Defines rules, their registration and their results."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from importlib import import_module
from typing import Any, TypeVar

from umo.text import did_you_mean


class RuleBroken(Exception):
    """Raised if the driver breaks the rule. The text says what the driver did. `causes`: causes that may also break a
    later rule, such as "level of dac:0". Each cause is reported once."""

    def __init__(self, text: str, *causes: str) -> None:
        super().__init__(text)
        self.causes = causes


class NotTried(Exception):
    """Raised if the rule cannot be checked on this subject. The text gives the reason."""


@dataclass(frozen=True)
class Cost:
    """The smallest number of calls that a rule makes. The plan of a run uses it."""

    opens: float = 1
    """Number of drivers that are opened. For each of them every channel is initialised, reset and finalised."""
    each: float = 0
    """Number of transfers of each channel."""
    calls: float = 0
    """Number of further transfers. It does not depend on the number of channels."""
    connects: float = 0
    """Number of calls that reconnect after a lost connection."""
    waits: float = 0
    """Number of calls that wait for their timeout."""
    more: Cost | None = None
    """The largest number of further calls, which are made if there is time."""
    settles: float = 0
    """Number of times that the rule waits for a level to come through a loop-back, for each output that has one."""
    sleeps: float = 0
    """Time in s without calls."""
    watchdogs: float = 0
    """Number of times that the rule waits for the device's watchdog (`Subject.watchdog`)."""


def further(each: float) -> Cost:
    """Return the cost of so many further transfers of each channel, with a driver that is open."""
    return Cost(opens=0, each=each)


MADE_UP = "success without an answer"
RECORD = "levels of the subject"
TEXTS = "texts of channels"
WRITTEN, WRITTEN_MANY = "levels that a write brings", "levels that a write_many brings"
"""Causes of broken rules, for `RuleBroken.causes`."""
NOTHING = Cost(opens=0)


@dataclass(frozen=True)
class Rule:
    """One rule. `check` takes a `RuleContext`. It returns a remark or None, or raises RuleBroken or NotTried. Any other
    OSError means the failure of a call that had to succeed."""

    id: str
    text: str
    check: Callable[[Any], str | None]
    cost: Cost

    @property
    def theme(self) -> str:
        """The theme of the rule, one of `THEMES`."""
        return self.check.__module__.rpartition(".")[2].removesuffix("_rules")


LINE = ("timing", "corruption", "line")
"""Themes that need a line between driver and device."""
ALWAYS = "general"
"""The theme that is always tried."""
THEMES = (
    "channel", "value", "block", "lifecycle", *LINE,
    "device", "look", "level", "optional", "process", "leak", ALWAYS,
)  # fmt: skip
"""Modules of rules, in the order in which they are tried."""
_RULES: dict[str, Rule] = {}
C = TypeVar("C", bound=Callable[..., "str | None"])


def rule(cost: Cost = Cost()) -> Callable[[C], C]:
    """Return a decorator that registers a function as the check of a rule. The name of the function becomes the name of
    the rule, its docstring becomes the rule's text."""

    def register(check: C) -> C:
        name = check.__name__.strip("_").replace("_", " ")
        _RULES[name] = Rule(name, " ".join((check.__doc__ or "").split()), check, cost)
        return check

    return register


def all_rules() -> tuple[Rule, ...]:
    """Return every rule, in the order in which they are tried."""
    for theme in THEMES:
        import_module(f"umo.testing.conformance.{theme}_rules")
    return tuple(sorted(_RULES.values(), key=lambda each: THEMES.index(each.theme)))


def chosen_rules(only: Iterable[str] | None) -> tuple[Rule, ...]:
    """Return the rules with these names, or all rules if no names are given. Raises ValueError for an unknown name."""
    rules = all_rules()
    if only is None:
        return rules
    wanted = set(only)
    for name in sorted(wanted - {each.id for each in rules}):
        known = [each.id for each in rules]
        raise ValueError(f"there is no rule {name!r}{did_you_mean(name, known)}; the rules are: {', '.join(known)}")
    return tuple(each for each in rules if each.id in wanted)
