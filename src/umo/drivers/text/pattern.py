"""The patterns of the answers of a line protocol, and the numbers in these answers. The functions are pure."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from decimal import MAX_EMAX, MIN_EMIN, Context, Decimal, InvalidOperation

from umo.errors import DriverError, WiringError

BLANKS = " \t\r"
LINE_BLANKS = f"{BLANKS}\n"
"""The blanks at the ends of a line that may remain if the terminator is not a newline."""
_SHOWN_CHARACTERS = 60
_WILD = re.compile(r"(\{\}|\*)")
NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_NONE = re.compile(r"[+-]?(?:nan|n?inf(?:inity)?)", re.IGNORECASE)
_WHOLE_LINE = ("", "{}", "")
_OVERFLOW = Decimal("9.9E37")
_MAX_SAFE_LENGTH = 18
"""Characters of a number up to which no check for an overflow is needed."""
EXACT = Context(prec=60, Emax=MAX_EMAX, Emin=MIN_EMIN)
"""The arithmetic with 60 digits: enough for 64 bits, a scale, and the decimals that decide the rounding."""


class NoValue(DriverError):
    """The device has answered according to its protocol, but with an error or without a value, so the connection can
    still be used."""


class UnexpectedAnswer(DriverError):
    """The answer does not have the declared form. It may belong to another request, so the connection is dropped."""


def shown(text: object) -> str:
    """Return a text of the device for a message: at most 60 characters, quoted."""
    whole = repr(text)
    return whole if len(whole) <= _SHOWN_CHARACTERS else f"{whole[:_SHOWN_CHARACTERS]}..."


@dataclass(frozen=True)
class Pattern:
    """The form of an answer: a text in which `{}` is the value and `*` is any text, or a regular expression `/.../`
    whose only group is the value.

    `{}` and `*` end where the following text of the pattern first occurs; the last one extends to the end of the line.
    Control characters match only control characters of the pattern. Blanks at both ends are ignored.
    """

    text: str
    where: str = field(compare=False)
    """The key in the wiring, for messages."""
    has_value: bool = False
    regex: re.Pattern[str] | None = field(init=False, compare=False, default=None)
    pieces: tuple[str, ...] = field(init=False, compare=False, default=())
    is_whole_line: bool = field(init=False, compare=False, default=False)
    """True if the pattern is "{}": the whole line is the value."""

    def __post_init__(self) -> None:
        text = self.text
        if len(text) > 1 and text[0] == text[-1] == "/":
            object.__setattr__(self, "regex", self._compiled(text[1:-1]))
            return
        pieces = tuple(_WILD.split(text.strip(BLANKS)))
        values = pieces.count("{}")
        if values != self.has_value:
            need = "needs one {} where the value is" if self.has_value else "takes no {}: it has no value"
            raise WiringError(f"{self.where}: {text!r} {need}")
        if "" in pieces[2:-1:2]:
            raise WiringError(f"{self.where}: {text!r} needs text between {{}} and *")
        if not text:
            raise WiringError(f"{self.where} is empty")
        object.__setattr__(self, "pieces", pieces)
        object.__setattr__(self, "is_whole_line", pieces == _WHOLE_LINE)

    def _compiled(self, text: str) -> re.Pattern[str]:
        try:
            regex = re.compile(text)
        except re.error as error:
            raise WiringError(f"{self.where}: {self.text!r} is not a regular expression: {error}") from None
        if self.has_value and regex.groups != 1:
            raise WiringError(f"{self.where}: {self.text!r} needs one group, the value; it has {regex.groups}")
        return regex

    def match(self, line: str) -> str | None:
        """Return the value in the line, "" for a pattern without a value; None if the line does not have this form."""
        if self.is_whole_line:
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
    """A function that computes the raw integer of a number like `raw_of`, but without Decimal if the number has no more
    digits than the scale."""

    scale: Decimal | None
    factors: tuple[int, ...] = field(init=False, compare=False, default=())
    """Factors by the number of digits after the point; empty if the scale is not 1, 0.1, 0.01 and so on."""

    def __post_init__(self) -> None:
        _, digits, exponent = (self.scale or Decimal(1)).normalize().as_tuple()
        if digits == (1,) and isinstance(exponent, int) and -_MAX_SAFE_LENGTH <= exponent <= 0:
            object.__setattr__(self, "factors", tuple(10**i for i in range(-exponent, -1, -1)))

    def __call__(self, text: str) -> int:
        whole, _, part = text.partition(".")
        digits, decimals = whole + part, len(part)
        if decimals < len(self.factors) and digits.isdigit() and digits.isascii() and len(digits) <= _MAX_SAFE_LENGTH:
            return int(digits) * self.factors[decimals]
        return raw_of(text, self.scale)


def raw_of(text: str, scale: Decimal | None) -> int:
    """Return the number in the text divided by the scale, to the nearest whole number, half to even. The result is
    exact for any number of digits. Without a scale the number must be whole.

    Raises UnexpectedAnswer for a text that is not a number, and NoValue for NAN and INF, and for 9.9E37 (infinity) and
    9.91E37 (not a number) of SCPI-1999, volume 1, section 7.2.1.
    """
    text = text.strip(BLANKS)
    if not NUMBER.fullmatch(text):
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
        number = EXACT.divide(number, scale)
    if not number:
        return 0  # also 0E999999999, whose digits would be written out
    whole = number.to_integral_value(context=EXACT)
    if scale is None and whole != number:
        raise UnexpectedAnswer(f"{shown(text)} is not a whole number, and the channel has no scale")
    return int(whole)
