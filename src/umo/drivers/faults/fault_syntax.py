"""The text form of injected faults: `PATH KIND [amount] [at TIME] [for TIME]`."""

from __future__ import annotations

import re
from dataclasses import dataclass
from math import inf

from umo.duration import seconds
from umo.errors import DeclarationError
from umo.text import did_you_mean

KINDS = {
    "stuck": "[LEVEL]",
    "noise": "[DEVIATION]",
    "drift": "[RATE]",
    "bit flip": "[BIT]",
    "delay": "[TIME]",
    "drop-out": "[SHARE]",
    "disconnect": "",
    "exception": "",
    "wrong length": "",
    "out of range": "[DISTANCE]",
}
"""The kinds of faults, with their amounts."""
KINDS_OF_DRIVERS = ("delay", "drop-out", "disconnect", "exception")
"""Kinds that a whole driver can have, too."""
FORM = "PATH KIND [amount] [at TIME] [for TIME]"
_TEXT = re.compile(r"(?P<head>.*?)(?:\s+at\s+(?P<at>.+?))?(?:\s+for\s+(?P<for>.+?))?", re.DOTALL)


@dataclass(frozen=True)
class InjectedFault:
    """A fault that is injected on purpose: `InjectedFault("z.encoder", "noise", "20 um", at=1.0, for_=2.0)`.

    `str` returns the text that wirings and `umo run --fault` accept: "z.encoder noise 20 um at 1 s for 2 s". Raises
    DeclarationError for an invalid kind, amount or time.
    """

    path: str
    """An object's path, a pattern of paths, or the name of a driver."""
    kind: str
    """One of `KINDS`."""
    amount: str | float = ""
    """Amount with a unit, or in raw steps as a number without a unit. Empty for the default of the kind."""
    at: float | str = 0.0
    """The time at which the fault begins: s, or a string such as "30 ms"."""
    for_: float | str = inf
    """Duration, in the form of `at`. Default: to the end of the run."""

    def __post_init__(self) -> None:
        amount = _number_text(self.amount) if isinstance(self.amount, int | float) else " ".join(self.amount.split())
        ends = self.for_ == inf
        set_ = object.__setattr__  # frozen
        set_(self, "kind", _kind(self.kind))
        set_(self, "amount", amount)
        set_(self, "at", seconds(self.at))
        set_(self, "for_", inf if ends else seconds(self.for_))
        if not self.path or len(self.path.split()) != 1:
            raise DeclarationError(f"{self.path!r} is not a path")
        if amount and not KINDS[self.kind]:
            raise DeclarationError(f"{self.kind} takes no amount, but has {amount!r}")
        if self.for_ == 0:
            raise DeclarationError("a fault lasts longer than 0 s")

    @classmethod
    def parse(cls, text: str) -> InjectedFault:
        """Return the fault that a text describes."""
        found = _TEXT.fullmatch(text.strip())
        head = found["head"].split() if found else []
        if found is None or len(head) < 2:
            raise DeclarationError(f"is not {FORM}, such as 'z.encoder stuck at 5 s'")
        path, *words = head
        count = next((n for n in (3, 2) if _plain(" ".join(words[:n])) in map(_plain, KINDS)), 1)
        kind, amount = " ".join(words[:count]), " ".join(words[count:])
        return cls(path, kind, amount, found["at"] or 0.0, found["for"] or inf)

    def __str__(self) -> str:
        words = [self.path, self.kind, str(self.amount)]
        if self.at:
            words.append(f"at {_number_text(self.at)} s")
        if self.for_ != inf:
            words.append(f"for {_number_text(self.for_)} s")
        return " ".join(filter(None, words))


def _number_text(number: object) -> str:
    """Return the shortest text that is read as the same number."""
    return repr(number).removesuffix(".0")


def _plain(kind: str) -> str:
    return kind.lower().replace("-", " ").replace("_", " ")


def _kind(kind: str) -> str:
    found = next((known for known in KINDS if _plain(known) == _plain(kind)), None)
    if found is None:
        raise DeclarationError(
            f"there is no kind {kind!r}{did_you_mean(kind, KINDS)}; the kinds are: {', '.join(KINDS)}"
        )
    return found
