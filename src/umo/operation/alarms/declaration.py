"""The declaration of an alarm: its condition, its text and its options."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass, field
from sys import float_info
from typing import Any

from umo.duration import seconds
from umo.errors import DeclarationError
from umo.states import TwoState
from umo.text import NamedNumber, did_you_mean
from umo.user_code import check_acts_at_once

MAX_TEXT = 200
"""Largest length of an alarm's text, in characters."""


class Priority(NamedNumber):
    """The urgency of an operator's response. The numbers are stored in frames."""

    LOW = 1
    MEDIUM = 2
    HIGH = 3
    CRITICAL = 4


@dataclass(frozen=True)
class High:
    """The condition that the value of a digital object is above a limit. `of`: the path of the object below the
    compound. `limit` is in the unit of the object.

    The condition ends at `limit - deadband`. While the value is BAD or UNREFERENCED, the condition does not change.
    Raises DeclarationError for a limit that is not finite, and for a negative deadband.
    """

    of: str
    limit: float
    _: KW_ONLY
    deadband: float = 0.0

    def __post_init__(self) -> None:
        _check_limit(self)


@dataclass(frozen=True)
class Low:
    """The condition that the value of a digital object is below a limit; otherwise like `High`. The condition ends at
    `limit + deadband`."""

    of: str
    limit: float
    _: KW_ONLY
    deadband: float = 0.0

    def __post_init__(self) -> None:
        _check_limit(self)


@dataclass(frozen=True)
class Bad:
    """The condition that the quality of an object is BAD. `of`: the path of the object below the compound."""

    of: str

    def __post_init__(self) -> None:
        _check_path(self)


@dataclass(frozen=True)
class In:
    """The condition that a binary object is in a state. `of`: the path of the object below the compound."""

    of: str
    state: TwoState

    def __post_init__(self) -> None:
        _check_path(self)
        if not isinstance(self.state, TwoState):
            raise DeclarationError(f"In({self.of!r}): {self.state!r} is not a state")


Condition = High | Low | Bad | In | Callable[[Any], bool]
"""The condition of an alarm: data, or a function of the compound that has the alarm."""


@dataclass(frozen=True, eq=False)
class Alarm:
    """An alarm of a compound, declared in the class keyword `alarms` under its name:

        class Tank(Compound, alarms={
            "overfill": Alarm(High("level", 180.0, deadband=2.0), "the tank is too full", priority=Priority.HIGH),
            "odd": Alarm(lambda tank: tank.load() > 3.0, "the load is odd"),
        }):

    `condition` is a `High`, `Low`, `Bad` or `In`, or a function of the compound. Such a function is called in every
    period or, if there are more than 20, in turn with others, 20 per period (`umo check` shows the delay). The function
    must be quick and read only synchronous objects. If it raises an error, or does not return a bool, the alarm is
    active, and its text says that the condition cannot be evaluated.

    priority: low, medium (default), high, critical. on_delay, off_delay: the time on the cycle's clock for which the
    condition must be true, or false, before this counts; in s, or a string such as "2 s"; default 0. latch: whether the
    alarm stays after its condition has ended, until the alarm is acknowledged and reset; default False. acknowledge:
    whether the alarm must be acknowledged; default True. Raises DeclarationError for options of other types or out of
    these ranges.
    """

    condition: Condition
    text: str
    _: KW_ONLY
    priority: Priority = Priority.MEDIUM
    on_delay: str | float = 0.0
    off_delay: str | float = 0.0
    latch: bool = False
    acknowledge: bool = True
    delays: tuple[float, float] = field(init=False, default=(0.0, 0.0))
    """`on_delay` and `off_delay` in s."""

    def __post_init__(self) -> None:
        if not isinstance(self.condition, High | Low | Bad | In) and (
            isinstance(self.condition, type) or not callable(self.condition)
        ):
            raise DeclarationError(
                f"the condition of an alarm must be a High, Low, Bad, In or a function, not {self.condition!r}"
            )
        check_acts_at_once("the condition of an alarm", self.condition)
        if not isinstance(self.text, str) or not self.text.strip() or not self.text.isprintable():
            raise DeclarationError(f"the text of an alarm must be one line, not {self.text!r}")
        if len(self.text) > MAX_TEXT:
            raise DeclarationError(
                f"the text of an alarm has {len(self.text)} characters; at most {MAX_TEXT} are allowed"
            )
        if not isinstance(self.priority, Priority):
            names = [each.name for each in Priority]
            near = did_you_mean(str(self.priority).upper(), names)
            raise DeclarationError(f"priority={self.priority!r} is not a Priority{near}: {', '.join(names)}")
        for name in ("latch", "acknowledge"):
            if not isinstance(getattr(self, name), bool):
                raise DeclarationError(f"{name}={getattr(self, name)!r} is not True or False")
        object.__setattr__(self, "delays", (_delay(self, "on_delay"), _delay(self, "off_delay")))


def _delay(alarm: Alarm, name: str) -> float:
    try:
        return seconds(getattr(alarm, name))
    except DeclarationError as error:
        raise DeclarationError(f"{name}: {error}") from None


def _check_path(condition: High | Low | Bad | In) -> None:
    if not isinstance(condition.of, str) or not condition.of:
        raise DeclarationError(f"{type(condition).__name__}: {condition.of!r} is not the path of an object")


def _check_limit(condition: High | Low) -> None:
    _check_path(condition)
    what = f"{type(condition).__name__}({condition.of!r})"
    for name in ("limit", "deadband"):
        value = getattr(condition, name)
        if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= float_info.max:
            raise DeclarationError(f"{what}: {name}={value!r} is not a finite number")
    if condition.deadband < 0:
        raise DeclarationError(f"{what}: deadband={condition.deadband!r} is negative")
