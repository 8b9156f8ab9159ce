"""How a program has been, and how values are compared."""

from __future__ import annotations

import math
import re
import struct
from enum import Enum
from typing import Any, NamedTuple

import numpy as np

WHERE = re.compile(r"^period \d+: ([\w.]*\bparts\.\d+\.?)?")
"""The period and the part of a difference."""
WRONG = "different", "not compiled", "crashed", "gave up", "refused without a hazard"


class Verdict(NamedTuple):
    """`outcome`: "equal", "refused", or one of those that are wrong."""

    outcome: str
    told: str = ""
    """What is different, why it is refused, what the compiler says."""
    periods: int = 0
    """Those that were compared, of which so many had an error in Python:"""
    faults: int = 0
    limits: int = 0
    """Periods that ended at a limit of the controller: a whole number left 32 bits."""

    @property
    def is_wrong(self) -> bool:
        return self.outcome in WRONG

    @property
    def kind(self) -> str:
        """In which way it is wrong: what is different, without values; why it is refused, without the statement."""
        told = self.told
        if self.outcome == "different":
            told = WHERE.sub("", told)
            told = told if told.startswith("Python") else told.partition(": ")[0]
        elif self.outcome.startswith("refused"):
            told = told.partition("; use instead: ")[0].rpartition(": ")[2]
        return f"{self.outcome}: {'' if self.outcome == 'not compiled' else told}"


def bits(value: Any) -> Any:
    """A number as what is compared: all NaN are one, numbers of several classes are the same."""
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, Enum):
        return value.name
    if isinstance(value, int) and abs(value) < 2**53:
        value = float(value)
    if isinstance(value, complex):
        return bits(value.real), bits(value.imag)
    if isinstance(value, float):
        return "nan" if math.isnan(value) else struct.pack("d", value)
    return value


def same(python: Any, c: Any) -> bool:
    """Whether two values are the same."""
    if python is c:
        return True
    if type(python) is float and type(c) is float:
        return python.hex() == c.hex()
    if isinstance(python, np.ndarray | list | tuple) or isinstance(c, np.ndarray | list | tuple):
        if not hasattr(python, "__len__") or not hasattr(c, "__len__"):
            return False
        one, other = (each.tolist() if isinstance(each, np.ndarray) else [*each] for each in (python, c))
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(c, bool) and not isinstance(python, bool | np.bool_):
        return False
    return bool(bits(python) == bits(c))
