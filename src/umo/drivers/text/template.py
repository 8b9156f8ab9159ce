"""The requests of a line protocol that carry a number: it is written without loss, or refused. Pure functions."""

from __future__ import annotations

import re
from dataclasses import dataclass
from decimal import Decimal
from string import Formatter
from typing import Any

from umo.drivers.text.pattern import EXACT
from umo.errors import WiringError

_N = re.compile(r"\{n(?::([^{}]*))?\}")
_NUMBER = re.compile(r"0?[0-9]{0,2}[bdoxX]?")
_FORMAT = re.compile(
    r"(?:(?P<fill>.)?(?P<align>[<>=^]))?[-+ ]?z?#?(?P<zeros>0)?[0-9]*(?P<groups>[,_])?(?:\.(?P<digits>[0-9]+))?"
    r"(?P<kind>[a-zA-Z%]?)"
)
_WHOLE = ("d", "x", "X", "o", "b")
_SIGNIFICANT = ("e", "E", "g", "G")
"""Kinds of formats whose digits are counted from the first one of the number that is not 0."""
_KINDS = ("", *_WHOLE, *_SIGNIFICANT, "f", "F")


@dataclass(frozen=True)
class Template:
    """A request that carries a number, a raw integer times the scale: `VOLT {:.3f}`. `{{` and `}}` are braces."""

    before: str
    spec: str
    after: str
    scale: Decimal | None

    @classmethod
    def parse(cls, text: str, where: str, scale: Decimal | None) -> Template:
        """WiringError if there is not exactly one {}, or its format cannot show one step of the scale."""
        try:
            parts = list(Formatter().parse(text))
        except ValueError as error:
            raise WiringError(f"{where}: {text!r}: {error}; a brace of the request is written twice") from None
        fields = [(name, spec or "", how) for _, name, spec, how in parts if name is not None]
        if len(fields) != 1 or fields[0][0] or fields[0][2]:
            raise WiringError(f"{where}: {text!r} needs one {{}} for the number, such as {{:.3f}}")
        at = next(i for i, part in enumerate(parts) if part[1] is not None)
        before, after = ("".join(part[0] for part in piece) for piece in (parts[: at + 1], parts[at + 1 :]))
        spec = fields[0][1]
        if why := _faulty(spec) or _too_coarse(spec, scale):
            raise WiringError(f"{where}: {text!r} {why}")
        return cls(before, _complete(spec), after, scale)

    def filled(self, raw: int) -> str:
        return f"{self.before}{_written(raw, self.scale, self.spec)}{self.after}"

    def loss(self, largest: int) -> str:
        """Why the text of some raw integer of this magnitude or a smaller one is another number; empty if none is."""
        kind, digits = self.spec[-1], _parts(self.spec)["digits"]
        if kind not in _SIGNIFICANT or digits is None:
            return ""  # fixed decimals, or all digits of a Decimal
        has = int(digits) + 1 if kind in "eE" else max(int(digits), 1)
        needs = len(str(largest * _digits_of(self.scale)))
        if has >= needs:
            return ""
        fewer = (
            f"writes {has} digits of up to {needs}; use {{:{kind}}} for all of them, or set bits for a narrower channel"
        )
        return f"{f'{self.before}{{:{self.spec}}}{self.after}'!r} {fewer}"


def _parts(spec: str) -> dict[str, str | None]:
    found = _FORMAT.fullmatch(spec)
    return found.groupdict() if found else {"kind": "?"}


def _faulty(spec: str) -> str:
    """Why a format is not that of a number; empty if it is."""
    parts = _parts(spec)
    if parts["kind"] not in _KINDS:
        return f"has {{:{spec}}}, which is not the format of a number"
    if parts["groups"]:
        return "groups the digits, which no device reads"
    pad = parts["fill"] or ("0" if parts["zeros"] else " ")
    behind_sign = parts["align"] == "=" or (parts["zeros"] is not None and parts["align"] is None)
    if pad not in "0 " or (pad == "0") is not behind_sign:
        return f"fills up with {pad!r}, which changes the number; {{:08.3f}} and {{:>8.3f}} do not"
    try:
        _written(1, None, _complete(spec))
    except (ValueError, TypeError) as error:
        return f"has {{:{spec}}}, which is not the format of a number: {error}"
    return ""


def _too_coarse(spec: str, scale: Decimal | None) -> str:
    """Why a format does not show one step of the scale; empty if it does."""
    kind, digits = _parts(spec)["kind"], _parts(spec)["digits"]
    decimals = 0 if scale is None else max(0, -int(scale.normalize().as_tuple().exponent))
    if kind in _WHOLE:
        return f"writes whole numbers, and the scale is {scale}" if decimals else ""
    if scale is None and (digits or kind) not in ("", "0"):
        return "writes decimals, and the channel has no scale; set scale, the step of one raw integer, such as 0.001"
    if kind in _SIGNIFICANT or digits is None or int(digits) >= decimals:
        return ""
    return f"does not show a step of the scale {scale}; use {{:.{decimals}f}}"


def _digits_of(scale: Decimal | None) -> int:
    """The digits of the scale as a whole number: 25 of 0.0025."""
    return 1 if scale is None else int("".join(map(str, scale.normalize().as_tuple().digits)))


def _complete(spec: str) -> str:
    """The format with its kind: a number without one is written with all of its digits and no exponent."""
    return spec if spec[-1:].isalpha() else f"{spec}f"


def _written(raw: int, scale: Decimal | None, spec: str) -> str:
    number = Decimal(raw) if scale is None else EXACT.multiply(raw, scale)
    return format(int(number) if spec[-1] in _WHOLE else number, spec)


def numbered(thing: Any, n: int, where: str) -> Any:
    """The texts within with `{n}`, `{n:02d}` replaced by the number of the channel; WiringError for another format."""

    def written(found: re.Match[str]) -> str:
        if not _NUMBER.fullmatch(found[1] or ""):
            raise WiringError(f"{where}: {found[0]} is not the number of a channel; it is {{n}}, or such as {{n:02d}}")
        return format(n, found[1] or "")

    if isinstance(thing, str):
        return _N.sub(written, thing)
    if isinstance(thing, dict):
        return {key: numbered(value, n, f"{where}.{key}") for key, value in thing.items()}
    return [numbered(each, n, where) for each in thing] if isinstance(thing, list | tuple) else thing
