"""The texts of a line protocol: patterns of answers, templates of requests, and the numbers in them. Pure functions."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from decimal import MAX_EMAX, MIN_EMIN, Context, Decimal, InvalidOperation
from string import Formatter
from typing import Any

from umo.errors import DriverError, WiringError

_BLANKS = " \t\r"
_SHOWN = 60
_WILD = re.compile(r"(\{\}|\*)")
_NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_NONE = re.compile(r"[+-]?(?:nan|n?inf(?:inity)?)", re.IGNORECASE)
_N = re.compile(r"\{n(?::(\w*))?\}")
_ALL = ("", "{}", "")
_OVERFLOW = Decimal("9.9E37")
_CONTEXT = Context(prec=60, Emax=MAX_EMAX, Emin=MIN_EMIN)
"""60 digits: 64 bits, and the decimals that decide how they are rounded."""
_WHOLE_FORMATS = ("d", "x", "X", "o", "b")


class NoValue(DriverError):
    """The device has answered as its protocol says, but with an error or without a value: the connection is in step."""


class UnexpectedAnswer(DriverError):
    """The answer is not of the form declared: perhaps it belongs to another request, so the connection is dropped."""


def shown(text: object) -> str:
    """What the device sent, for a message: quoted, and not more than 60 characters of it."""
    whole = repr(text)
    return whole if len(whole) <= _SHOWN else f"{whole[:_SHOWN]}..."


def stripped(line: str) -> str:
    return line.strip(_BLANKS)


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
        if self.pieces == _ALL:
            return line if line.isprintable() else None
        if self.regex is not None:
            found = self.regex.fullmatch(line)
            return None if found is None else (found[1] or "") if self.has_value else ""
        first, *rest = self.pieces
        if not rest:
            return "" if line == first else None
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


def raw_of(text: str, scale: Decimal | None) -> int:
    """The number in the text divided by the scale, to the nearest whole number, half to even; exact for any digits.
    Without a scale the number must be whole.

    Not a number is an UnexpectedAnswer; NAN and INF are a NoValue, as are 9.9E37 (infinity) and 9.91E37 (not a number)
    of SCPI-1999, volume 1, section 7.2.1.
    """
    text = text.strip(_BLANKS)
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
        template = cls(before, fields[0][1], after)
        template._check(text, where, scale)
        return template

    def _check(self, text: str, where: str, scale: Decimal | None) -> None:
        whole = scale is None or scale == scale.to_integral_value()
        if self.spec.endswith(_WHOLE_FORMATS) and not whole:
            raise WiringError(f"{where}: {text!r} writes whole numbers, and the scale is {scale}")
        try:
            written = self.number(1, scale)
        except (ValueError, TypeError) as error:
            raise WiringError(f"{where}: {{:{self.spec}}} is not the format of a number: {error}") from None
        if self.spec.endswith(_WHOLE_FORMATS[1:]):
            return
        if "," in self.spec or "_" in self.spec:
            raise WiringError(f"{where}: {text!r} groups the digits, which no device reads")
        if not _NUMBER.fullmatch(written.strip()) or Decimal(written.strip()) != (scale or 1):
            raise WiringError(
                f"{where}: {text!r} does not show a step of the scale {scale or 1}: it writes {written!r}"
            )

    def number(self, raw: int, scale: Decimal | None) -> str:
        if self.spec.endswith(_WHOLE_FORMATS):
            return format(raw if scale is None else int(raw * scale), self.spec)
        spec = self.spec if self.spec[-1:].isalpha() else f"{self.spec}f"
        return format(Decimal(raw) if scale is None else _CONTEXT.multiply(Decimal(raw), scale), spec)

    def filled(self, raw: int, scale: Decimal | None) -> str:
        return f"{self.before}{self.number(raw, scale)}{self.after}"


def numbered(thing: Any, n: int) -> Any:
    """The texts within with `{n}`, `{n:02d}` replaced by the number of the channel."""
    if isinstance(thing, str):
        return _N.sub(lambda found: format(n, found[1] or ""), thing)
    if isinstance(thing, dict):
        return {key: numbered(value, n) for key, value in thing.items()}
    return [numbered(each, n) for each in thing] if isinstance(thing, list | tuple) else thing
