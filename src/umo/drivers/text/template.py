"""The requests of a line protocol that contain a number. The number is written without loss, or refused. The functions
are pure."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from decimal import Decimal
from string import Formatter
from typing import Any

from umo.drivers.text.pattern import BLANKS, EXACT, NUMBER
from umo.errors import WiringError

_N = re.compile(r"\{n(?::([^{}]*))?\}")
_CHANNEL_NUMBER = re.compile(r"0?[0-9]{0,2}[bdoxX]?")
_BASES = {"d": 10, "x": 16, "X": 16, "o": 8, "b": 2}
"""Bases of the formats of whole numbers."""
_KINDS = (*_BASES, "e", "E", "f", "F", "g", "G")
_CHECKED_RAWS = 10
"""Raw integers at each end of a channel's range, and on each side of 0, whose texts are read back: as many as there are
last digits."""


@dataclass(frozen=True)
class Template:
    """A request that contains a number, which is a raw integer times the scale: `VOLT {:.3f}`. `{{` and `}}` are
    braces."""

    before: str
    spec: str
    after: str
    scale: Decimal | None
    _step: Decimal = field(init=False, compare=False)
    """The scale; 1 if there is none."""
    _format: str = field(init=False, compare=False)
    """The format; one without a kind is written with all of its digits and no exponent."""
    _base: int | None = field(init=False, compare=False)
    """The base of a format of whole numbers."""

    def __post_init__(self) -> None:
        kind = self.spec[-1:] if self.spec[-1:].isalpha() else ""
        prepared = {"_step": self.scale or Decimal(1), "_format": self.spec if kind else f"{self.spec}f"}
        for name, value in {**prepared, "_base": _BASES.get(kind)}.items():
            object.__setattr__(self, name, value)

    @classmethod
    def parse(cls, text: str, where: str, scale: Decimal | None) -> Template:
        """Parse a request. Raises WiringError unless it has exactly one {}."""
        try:
            parts = list(Formatter().parse(text))
        except ValueError as error:
            raise WiringError(f"{where}: {text!r}: {error}; a brace of the request is written twice") from None
        fields = [(name, spec or "", how) for _, name, spec, how in parts if name is not None]
        if len(fields) != 1 or fields[0][0] or fields[0][2]:
            raise WiringError(f"{where}: {text!r} needs one {{}} for the number, such as {{:.3f}}")
        at = next(i for i, part in enumerate(parts) if part[1] is not None)
        before, after = ("".join(part[0] for part in piece) for piece in (parts[: at + 1], parts[at + 1 :]))
        return cls(before, fields[0][1], after, scale)

    def filled(self, raw: int) -> str:
        number = EXACT.multiply(raw, self._step)
        return f"{self.before}{number if self._base is None else int(number):{self._format}}{self.after}"

    def check(self, lowest: int, highest: int, where: str) -> None:
        """Check a range. Raises WiringError if a raw integer of this range would be written as another number, or with
        decimals although there is no scale."""
        what = f"{where}: {f'{self.before}{{:{self.spec}}}{self.after}'!r}"
        no_format = WiringError(f"{what} has {{:{self.spec}}}, which is not the format of a number")
        if self._format[-1:] not in _KINDS:
            raise no_format
        near = [each for i in range(_CHECKED_RAWS) for each in (highest - i, i, lowest + i, -i)]
        for raw in (each for each in near if lowest <= each <= highest):
            try:
                written = self.filled(raw).removeprefix(self.before).removesuffix(self.after)
            except (ValueError, TypeError):
                raise no_format from None
            if self.scale is None and self._base is None and set(".eE") & set(written):
                step = "set scale, the step of one raw integer, such as 0.001"
                raise WiringError(f"{what} writes decimals, and the channel has no scale; {step}")
            number = EXACT.multiply(raw, self._step)
            if self._read(written) != number:
                fixed = "" if self.scale is None else f":.{max(0, -int(self.scale.normalize().as_tuple().exponent))}f"
                raise WiringError(f"{what} writes {written!r} for {number:f}; use {{{fixed}}}")

    def _read(self, written: str) -> Decimal | None:
        """Return the number that a device reads in this text, or None."""
        text = written.strip(BLANKS)
        if self._base in (None, 10):
            return Decimal(text) if NUMBER.fullmatch(text) else None
        try:
            return Decimal(int(text, self._base or 10)) if "_" not in text else None
        except ValueError:
            return None


def numbered(thing: Any, n: int, where: str) -> Any:
    """Return a table in whose texts `{n}` and `{n:02d}` are replaced by the number of the channel. Raises WiringError
    for another format."""

    def written(found: re.Match[str]) -> str:
        if not _CHANNEL_NUMBER.fullmatch(found[1] or ""):
            raise WiringError(
                f"{where}: {found[0]} is not the number of a channel; write {{n}}, or for example {{n:02d}}"
            )
        return format(n, found[1] or "")

    if isinstance(thing, str):
        return _N.sub(written, thing)
    if isinstance(thing, dict):
        return {key: numbered(value, n, f"{where}.{key}") for key, value in thing.items()}
    return [numbered(each, n, where) for each in thing] if isinstance(thing, list | tuple) else thing
