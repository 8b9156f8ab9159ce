"""A rule of the driver contract: its name, the sentence that states it, and the function that checks it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, TypeVar

from umo.text import did_you_mean

if TYPE_CHECKING:
    from umo.testing.conformance.trial import Trial


class RuleBroken(Exception):
    """The driver does not keep the rule; says what it did."""


class NotTried(Exception):
    """The rule cannot be checked on this subject; says why."""


@dataclass(frozen=True)
class Rule:
    """One rule. `check` returns a remark or None, or raises RuleBroken or NotTried; any OSError that leaves it is the
    failure of a call that had to succeed."""

    id: str
    text: str
    check: Callable[[Trial], str | None]


THEMES = ("channel", "timing", "segment", "value", "block", "line", "device", "leak", "standing")
"""Modules of rules, in the order in which they are tried."""
_RULES: dict[str, Rule] = {}
C = TypeVar("C", bound=Callable[..., "str | None"])


def rule(identifier: str, text: str) -> Callable[[C], C]:
    """Registers a function as the check of a rule."""

    def register(check: C) -> C:
        _RULES[identifier] = Rule(identifier, text, check)
        return check

    return register


def all_rules() -> tuple[Rule, ...]:
    """Every rule, in the order in which they are tried."""
    modules = [import_module(f"umo.testing.conformance.{theme}_rules").__name__ for theme in THEMES]
    return tuple(sorted(_RULES.values(), key=lambda each: modules.index(each.check.__module__)))


def chosen_rules(only: Iterable[str] | None) -> tuple[Rule, ...]:
    """The rules of these names, all without names; ValueError for an unknown one."""
    rules = all_rules()
    if only is None:
        return rules
    wanted = set(only)
    for name in sorted(wanted - {each.id for each in rules}):
        known = [each.id for each in rules]
        raise ValueError(f"no rule {name!r}{did_you_mean(name, known)}; the rules are: {', '.join(known)}")
    return tuple(each for each in rules if each.id in wanted)
