"""The texts of a line protocol: patterns of answers, templates of requests, and the numbers in them. Pure functions."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from decimal import MAX_EMAX, MIN_EMIN, Context, Decimal, InvalidOperation
from string import Formatter
from typing import Any

from umo.errors import DriverError, WiringError

BLANKS = " \t\r"
_SHOWN = 60
_WILD = re.compile(r"(\{\}|\*)")
_NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_NONE = re.compile(r"[+-]?(?:nan|n?inf(?:inity)?)", re.IGNORECASE)
_N = re.compile(r"\{n(?::(\w*))?\}")
_ALL = ("", "{}", "")
_OVERFLOW = Decimal("9.9E37")
_SHORT = 18
"""Characters of a number that need no check for an overflow."""
_CONTEXT = Context(prec=60, Emax=MAX_EMAX, Emin=MIN_EMIN)
"""60 digits: 64 bits, and the decimals that decide how they are rounded."""
_WHOLE_FORMATS = ("d", "x", "X", "o", "b")
_DECIMAL_FORMATS = ("e", "E", "g", "G")


class NoValue(DriverError):
    """The device has answered as its protocol says, but with an error or without a value: the connection is in step."""


class UnexpectedAnswer(DriverError):
    """The answer is not of the form declared: perhaps it belongs to another request, so the connection is dropped."""


def shown(text: object) -> str:
    """What the device sent, for a message: quoted, and not more than 60 characters of it."""
    whole = repr(text)
    return whole if len(whole) <= _SHOWN else f"{whole[:_SHOWN]}..."


def stripped(line: str) -> str:
    return line.strip(BLANKS)


@dataclass(frozen=True)
class Pattern:
    """The form of an answer: text in which `{}` is the value and `*` any text, or a regular expression `/.../` whose
    only group is the value.

    `{}` and `*` end at the first place where the text behind them follows; the last one goes to the end of the line.
    Control characters match only those that the pattern contains. Blanks at both ends do not count.
    """

    text: str
    where: str = field(compare=False)
    """The key of the wiring, for messages."""
    has_value: bool = False
    regex: re.Pattern[str] | None = field(init=False, compare=False, default=None)
    pieces: tuple[str, ...] = field(init=False, compare=False, default=())
    is_all: bool = field(init=False, compare=False, default=False)
    """It is "{}": the whole line is the value."""

    def __post_init__(self) -> None:
        text = self.text
        if len(text) > 1 and text[0] == text[-1] == "/":
            object.__setattr__(self, "regex", self._compiled(text[1:-1]))
            return
        pieces = tuple(_WILD.split(stripped(text)))
        values = pieces.count("{}")
        if values != self.has_value:
            need = "needs one {} where the value is" if self.has_value else "takes no {}: it has no value"
            raise WiringError(f"{self.where}: {text!r} {need}")
        if "" in pieces[2:-1:2]:
            raise WiringError(f"{self.where}: {text!r} needs text between {{}} and *")
        if not text:
            raise WiringError(f"{self.where} is empty")
        object.__setattr__(self, "pieces", pieces)
        object.__setattr__(self, "is_all", pieces == _ALL)

    def _compiled(self, text: str) -> re.Pattern[str]:
        try:
            regex = re.compile(text)
        except re.error as error:
            raise WiringError(f"{self.where}: {self.text!r} is not a regular expression: {error}") from None
        if self.has_value and regex.groups != 1:
            raise WiringError(f"{self.where}: {self.text!r} needs one group, the value; it has {regex.groups}")
        return regex

    def match(self, line: str) -> str | None:
        """The value in the line, "" for a pattern without; None if the line is not of this form."""
        if self.is_all:
            return line if line.isprintable() else None
        pieces = self.pieces
        if len(pieces) == 1:
            return "" if line == pieces[0] else None
        if self.regex is not None:
            found = self.regex.fullmatch(line)
            return None if found is None else (found[1] or "") if self.has_value else ""
        first, *rest = pieces
        if not line.startswith(first) or not line.endswith(rest[-1]):
            return None
        at, end, value = len(first), len(line) - len(rest[-1]), ""
        for i in range(0, len(rest), 2):
            stop = line.find(rest[i + 1], at, end) if i + 2 < len(rest) else end
            if stop < at or not (part := line[at:stop].replace("\t", " ")).isprintable():
                return None
            if rest[i] == "{}":
                value = part
            at = stop + len(rest[i + 1])
        return value


@dataclass(frozen=True)
class RawOf:
    """The raw integer of a number, as `raw_of`, without Decimal where the number has no more digits than the scale."""

    scale: Decimal | None
    factors: tuple[int, ...] = field(init=False, compare=False, default=())
    """By the number of digits after the point; none if the scale is not 1, 0.1, 0.01 and so on."""

    def __post_init__(self) -> None:
        _, digits, exponent = (self.scale or Decimal(1)).normalize().as_tuple()
        if digits == (1,) and isinstance(exponent, int) and -_SHORT <= exponent <= 0:
            object.__setattr__(self, "factors", tuple(10**i for i in range(-exponent, -1, -1)))

    def __call__(self, text: str) -> int:
        whole, _, part = text.partition(".")
        digits, decimals = whole + part, len(part)
        if decimals < len(self.factors) and digits.isdigit() and digits.isascii() and len(digits) <= _SHORT:
            return int(digits) * self.factors[decimals]
        return raw_of(text, self.scale)


def raw_of(text: str, scale: Decimal | None) -> int:
    """The number in the text divided by the scale, to the nearest whole number, half to even; exact for any digits.
    Without a scale the number must be whole.

    Not a number is an UnexpectedAnswer; NAN and INF are a NoValue, as are 9.9E37 (infinity) and 9.91E37 (not a number)
    of SCPI-1999, volume 1, section 7.2.1.
    """
    text = text.strip(BLANKS)
    if not _NUMBER.fullmatch(text):
        if _NONE.fullmatch(text):
            raise NoValue(f"the device answers {text}, which is not a finite number")
        raise UnexpectedAnswer(f"{shown(text)} is not a number")
    try:
        number = Decimal(text)
    except InvalidOperation:  # an exponent of twenty digits
        raise NoValue(f"the device answers {shown(text)}, whose exponent is out of range") from None
    if not -_OVERFLOW < number < _OVERFLOW:
        raise NoValue(f"the device answers {shown(text)}: overflow, or no valid measurement")
    if scale is not None:
        number = _CONTEXT.divide(number, scale)
    if not number:
        return 0  # also 0E999999999, whose digits would be written out
    whole = number.to_integral_value(context=_CONTEXT)
    if scale is None and whole != number:
        raise UnexpectedAnswer(f"{shown(text)} is not a whole number, and the channel has no scale")
    return int(whole)


@dataclass(frozen=True)
class Template:
    """A request that carries a number: `VOLT {:.3f}`. `{{` and `}}` are braces."""

    before: str
    spec: str
    after: str
    scale: Decimal | None

    @classmethod
    def parse(cls, text: str, where: str, scale: Decimal | None) -> Template:
        """WiringError if there is not exactly one {}, or its format loses one step of the scale."""
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
        _check_format(spec, text, where, scale)
        return cls(before, spec if spec[-1:].isalpha() else f"{spec}f", after, scale)

    def filled(self, raw: int) -> str:
        return f"{self.before}{_written(raw, self.scale, self.spec)}{self.after}"


def _check_format(spec: str, text: str, where: str, scale: Decimal | None) -> None:
    if spec.endswith(_WHOLE_FORMATS) and scale is not None and scale != scale.to_integral_value():
        raise WiringError(f"{where}: {text!r} writes whole numbers, and the scale is {scale}")
    try:
        written = _written(1, scale, spec if spec[-1:].isalpha() else f"{spec}f")
    except (ValueError, TypeError) as error:
        raise WiringError(f"{where}: {{:{spec}}} is not the format of a number: {error}") from None
    if spec.endswith(_WHOLE_FORMATS[1:]):
        return
    if "," in spec or "_" in spec:
        raise WiringError(f"{where}: {text!r} groups the digits, which no device reads")
    if scale is None and (not written.strip(" +").isdecimal() or spec == "f" or spec.endswith(_DECIMAL_FORMATS)):
        why = "writes decimals, and the channel has no scale; set scale, the step of one raw integer, such as 0.001"
        raise WiringError(f"{where}: {text!r} {why}")
    if not _NUMBER.fullmatch(written.strip()) or Decimal(written.strip()) != (scale or 1):
        raise WiringError(f"{where}: {text!r} does not show a step of the scale {scale or 1}: it writes {written!r}")


def _written(raw: int, scale: Decimal | None, spec: str) -> str:
    if spec[-1] in _WHOLE_FORMATS:
        return format(raw if scale is None else int(raw * scale), spec)
    return format(Decimal(raw) if scale is None else _CONTEXT.multiply(raw, scale), spec)


def numbered(thing: Any, n: int) -> Any:
    """The texts within with `{n}`, `{n:02d}` replaced by the number of the channel."""
    if isinstance(thing, str):
        return _N.sub(lambda found: format(n, found[1] or ""), thing)
    if isinstance(thing, dict):
        return {key: numbered(value, n) for key, value in thing.items()}
    return [numbered(each, n) for each in thing] if isinstance(thing, list | tuple) else thing
