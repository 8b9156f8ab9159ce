"""GPIO channels: their texts and the settings of their lines. Pure functions, which use no chip."""

from __future__ import annotations

import re
from collections.abc import Hashable
from dataclasses import dataclass, replace

from umo.drivers.contract import Channel, Direction
from umo.drivers.option_checks import one_of, truth
from umo.duration import seconds
from umo.errors import ChannelError, DeclarationError, WiringError

FORMS = (
    "line:N",
    "line:NAME",
    "lines:N-M",
    "lines:A,B,C (lowest bit first)",
    "edges:N[:rising|falling|both]; after a space bias=pull-up, drive=open-drain, active_low, debounce=5ms",
)
BIASES = ("as-is", "disabled", "pull-up", "pull-down")
DRIVES = ("push-pull", "open-drain", "open-source")
EDGES = ("rising", "falling", "both")
MAX_LINES = 63
"""The largest number of lines that form one number, which has 63 bits."""
COUNT_BITS = 63

_NUMBER = re.compile(r"0|[1-9][0-9]{0,4}")
_RANGE = re.compile(r"(0|[1-9][0-9]{0,4})-(0|[1-9][0-9]{0,4})")
_EDGES = re.compile(rf"(.+?)(?::({'|'.join(EDGES)}))?")
_MAX_DEBOUNCE = 2**32 - 1
"""Longest debounce period in us."""


@dataclass(frozen=True)
class Settings:
    """Settings of a line, in the terms of the kernel's GPIO character device."""

    bias: str = "as-is"
    drive: str = "push-pull"
    active_low: bool = False
    debounce: int = 0
    """Debounce period of an input in us, or 0 if there is none."""


@dataclass(frozen=True)
class GpioChannel(Channel):
    """Some lines as one number, in which the first line is the lowest bit; or the number of edges of one line."""

    lines: tuple[int | str, ...] = ()
    """The lines, by number on the chip or by name."""
    edges: str = ""
    """Edges that are counted, or empty if the level is transferred."""
    settings: Settings = Settings()

    @property
    def places(self) -> tuple[Hashable, ...]:
        """The lines of the channel."""
        return self.lines


def parse(text: str, defaults: Settings) -> GpioChannel:
    """Return the channel that the text names; settings that the text does not give have the defaults."""
    what, *words = text.split(" ")
    kind, _, place = what.partition(":")
    settings = defaults
    for word in words:
        settings = _with(settings, word, text)
    if kind == "line":
        return GpioChannel(text, Direction.BOTH, 1, False, (_line(place, text),), "", settings)
    if kind == "lines":
        lines = _lines(place, text)
        return GpioChannel(text, Direction.BOTH, len(lines), False, lines, "", settings)
    if kind == "edges" and (match := _EDGES.fullmatch(place)) is not None:
        line = _line(match[1], text)
        return GpioChannel(text, Direction.INPUT, COUNT_BITS, False, (line,), match[2] or "rising", settings)
    raise ChannelError(text, FORMS)


def checked(bias: str, drive: str, active_low: bool, debounce: str) -> Settings:
    """Check the driver's options and return them. Raises WiringError, which names the valid choices."""
    one_of("bias", bias, BIASES)
    one_of("drive", drive, DRIVES)
    truth("active_low", active_low)
    if (period := _microseconds(debounce)) is None:
        raise WiringError(f'debounce must be a time such as "5 ms" or "500 us", at most 4294 s, not {debounce!r}')
    return Settings(bias, drive, active_low, period)


def _with(settings: Settings, word: str, text: str) -> Settings:
    """Return the settings with the change that one word of a channel's text requests."""
    key, _, value = word.partition("=")
    if key == "bias" and value in BIASES:
        return replace(settings, bias=value)
    if key == "drive" and value in DRIVES:
        return replace(settings, drive=value)
    if word in ("active_low", "active_high"):
        return replace(settings, active_low=word == "active_low")
    if key == "debounce" and (period := _microseconds(value)) is not None:
        return replace(settings, debounce=period)
    raise ChannelError(text, FORMS)


def _microseconds(text: object) -> int | None:
    """Return a duration in us; None if the text is not a duration, or if the duration is too long."""
    try:
        period = round(seconds(text) * 1e6) if isinstance(text, str) else -1
    except DeclarationError:
        return None
    return period if 0 <= period <= _MAX_DEBOUNCE else None


def _line(place: str, text: str) -> int | str:
    if _NUMBER.fullmatch(place):
        return int(place)
    if not place or place[0] in "-0123456789" or "," in place or not place.isprintable():
        raise ChannelError(text, FORMS)
    return place


def _lines(place: str, text: str) -> tuple[int | str, ...]:
    lines: tuple[int | str, ...]
    if match := _RANGE.fullmatch(place):
        first, last = int(match[1]), int(match[2])
        step = 1 if first <= last else -1
        lines = tuple(range(first, last + step, step)) if abs(last - first) < MAX_LINES else ()
    else:
        lines = tuple(_line(each, text) for each in place.split(","))
    if not 0 < len(lines) <= MAX_LINES or len(set(lines)) != len(lines):
        raise ChannelError(text, FORMS)
    return lines
