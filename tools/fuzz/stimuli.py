"""What comes from outside, by the seed of a program: raw integers, channels that fail, what the host sets, ticks."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from random import Random
from types import ModuleType
from typing import Any

SENSORS, ACTUATORS = ("x", "y", "door"), ("a", "b", "fan")
REALS = (0.0, -0.0, 1.0, -1.0, 2.5, math.nan, math.inf, -math.inf, 1e300, 5e-324, 3.0)
WHOLES = (0, 1, -1, 2, 3, 2**31 - 1, -(2**31) + 1)
MISSED = (0, 0, 0, 0, 0, 0, 2, 5)
LAST = 6
"""Periods at the end in which the host also sets what translation takes as known."""


@dataclass(frozen=True)
class Stimulus:
    """Of one program in one period."""

    raws: Sequence[int]
    failed: Sequence[bool]
    """By sensor."""
    deaf: Sequence[bool]
    """By actuator: it accepts nothing."""
    clears: bool
    """Whether a fault is cleared before the period."""
    sets: Mapping[str, Any] = field(default_factory=dict)
    """What the host sets, by attributes; a name such as `part.gain` is one of an object in it."""


def ticks(periods: int) -> list[int]:
    """How many were missed in each period: the same for all programs."""
    random = Random("ticks")
    return [random.choice(MISSED) for _ in range(periods)]


def stimuli(seed: int, periods: int, module: ModuleType) -> list[Stimulus]:
    random = Random(f"inputs {seed}")
    raws = [0, 0, 0]
    return [_stimulus(random, raws, module) for _ in range(periods)]


def _stimulus(random: Random, raws: list[int], module: ModuleType) -> Stimulus:
    for place in (0, 1):
        jumps = random.random() < 0.1
        raws[place] = random.choice((-40, 7, 5, 0, 300)) if jumps else raws[place] + random.randint(-6, 6)
        raws[place] = max(-60, min(400, raws[place]))
    raws[2] = random.randint(0, 1) if random.random() < 0.2 else raws[2]
    sets: dict[str, Any] = {}
    for name, share, value in _SETS:
        if random.random() < share:
            sets[name] = value(random, module)
    return Stimulus(
        raws=tuple(raws),
        failed=[random.random() < 0.02 for _ in SENSORS],
        deaf=[random.random() < 0.005 for _ in ACTUATORS],
        clears=random.random() < 0.8,
        sets=sets,
    )


def _real(random: Random, module: ModuleType) -> float:
    return random.choice(REALS) if random.random() < 0.2 else round(random.uniform(-5.0, 5.0), 2)


def _whole(random: Random, module: ModuleType) -> int:
    return random.choice(WHOLES) if random.random() < 0.1 else random.randint(-4, 6)


def _truth(random: Random, module: ModuleType) -> bool:
    return random.random() < 0.5


def _optional(random: Random, module: ModuleType) -> float | None:
    return random.choice((None, _real(random, module)))


def _mode(random: Random, module: ModuleType) -> Any:
    return random.choice([*module.Mode])


def _level(random: Random, module: ModuleType) -> Any:
    return random.choice([*module.Level])


Value = Callable[[Random, ModuleType], Any]
_SETS: Sequence[tuple[str, float, Value]] = (
    ("u", 0.5, _real), ("v", 0.5, _real), ("n", 0.5, _whole), ("i", 0.5, _whole), ("on", 0.4, _truth),
    ("maybe", 0.3, _optional), ("mode", 0.15, _mode), ("s", 0.1, _real), ("t", 0.1, _real), ("c", 0.1, _whole),
    ("d", 0.1, _whole), ("yes", 0.1, _truth), ("low", 0.05, _real), ("high", 0.05, _real), ("step", 0.1, _whole),
    ("level", 0.05, _level), ("last", 0.1, _optional), ("part.gain", 0.1, _real), ("spare.gain", 0.05, _real),
    ("part.count", 0.05, _whole),
)  # fmt: skip


def _replaced_function(part: Any, module: Any) -> None:
    module.clamped = lambda value, low, high=10.0: value


def _changed_table(part: Any, module: Any) -> None:
    module.TABLE = (9.0, 8.0, 7.0)


def _class_attribute(part: Any, module: Any) -> None:
    module.Program.bias = 3.5


WAYS: Sequence[Callable[[Any, Any], object]] = (
    lambda part, module: setattr(part, "phase", "heat"),
    lambda part, module: setattr(part, "phase", "elsewhere"),
    lambda part, module: setattr(part, "bias", 1.25),
    lambda part, module: setattr(part, "pair", module.Pair(3.0, -1.0)),
    lambda part, module: setattr(part, "part", module.Part(7.0)),
    lambda part, module: setattr(part, "row", [5.0, 6.0, 7.0]),
    lambda part, module: part.row.__setitem__(1, 9.0),
    lambda part, module: part.parts.reverse(),
    lambda part, module: setattr(part, "u", 3),
    lambda part, module: setattr(part, "n", 1.5),
    lambda part, module: setattr(part, "array", module.np.array([3.0, 4.0, 5.0])),
    lambda part, module: module.GAINS.update({module.Mode.OFF: 8.0}),
    lambda part, module: setattr(module, "Part", module.Program),
    lambda part, module: setattr(module.Part, "weight", staticmethod(lambda x: x)),
    lambda part, module: setattr(part, "bump", lambda: 2),
    _replaced_function,
    _changed_table,
    _class_attribute,
)
"""What only Python can follow, and compiled laws have to see."""
