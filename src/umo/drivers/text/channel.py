"""The channels of a line protocol, as a wiring declares them: how each is read, written and confirmed. This module uses
no device."""

from __future__ import annotations

import re
from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, field
from decimal import Decimal
from typing import Any, NamedTuple, TypeVar

from typing_extensions import TypedDict

from umo.drivers.contract import Channel, Direction
from umo.drivers.option_checks import checked_table, within
from umo.drivers.optional import PhysicalScale
from umo.drivers.text.pattern import NoValue, Pattern, RawOf, UnexpectedAnswer, shown
from umo.drivers.text.template import Template, numbered
from umo.errors import ChannelError, DriverError, WiringError

_NUMBERED = re.compile(r"\{n\}")
_MAX_BITS = 64
T = TypeVar("T")


class Ends(NamedTuple):
    """The terminators of a request and of its answer; None means those of the driver."""

    request: str | None = None
    answer: str | None = None

    @classmethod
    def of(cls, table: ChannelOptions | QueryOptions, where: str) -> Ends:
        """Return the terminators in a table."""
        if table.get("answer_terminator") == "":
            raise WiringError(f"{where}.answer_terminator must not be empty")
        found = cls(table.get("terminator"), table.get("answer_terminator"))
        return DRIVERS_ENDS if found == DRIVERS_ENDS else found


DRIVERS_ENDS = Ends()


class QueryOptions(TypedDict, total=False):
    """A request and the pattern of its answer. An empty table means that there is none."""

    ask: str
    answer: str
    terminator: str
    answer_terminator: str


class ChannelOptions(TypedDict, total=False):
    """The table of a channel. It needs `ask`, `set` or both."""

    ask: str
    answer: str
    states: dict[str, Any]
    set: Any
    acknowledge: str
    confirm: QueryOptions
    terminator: str
    answer_terminator: str
    sets_level: bool
    scale: float
    units: str
    bits: int
    signed: bool


@dataclass(frozen=True)
class Query:
    """A request whose answer must have a given form."""

    ask: str
    answer: Pattern
    ends: Ends = DRIVERS_ENDS

    @classmethod
    def parse(cls, table: QueryOptions | None, where: str) -> Query | None:
        """Return the query in a table; None for None and for an empty table."""
        if table is None:
            return None
        checked_table(where, table, QueryOptions.__annotations__, '{ ask = "POS?", answer = "POS={}" }')
        if table and not {"ask", "answer"} <= set(table):
            raise WiringError(f'{where} needs both ask and answer: {{ ask = "*IDN?", answer = "ACME*" }}')
        if not table:
            return None
        return cls(table["ask"], Pattern(table["answer"], f"{where}.answer"), Ends.of(table, where))


@dataclass(frozen=True)
class ReadCommand:
    """Command that reads a channel: the request, and the conversion of its answer to a raw integer."""

    ask: str
    answer: Pattern
    states: Mapping[str, int]
    number: Callable[[str], int]
    ends: Ends = DRIVERS_ENDS

    def raw(self, line: str) -> int:
        value = self.answer.match(line)
        if value is None:
            raise UnexpectedAnswer(f"the answer {shown(line)} does not match {self.answer.text!r}")
        if not value.strip() and not line.strip() and "" not in self.states:
            raise UnexpectedAnswer(
                "an empty answer is not a number or state; set skip_empty_lines = true if other lines follow it"
            )
        if not self.states:
            return self.number(value)
        level = self.states.get(value.strip())
        if level is None:
            raise UnexpectedAnswer(f"the answer {shown(line)} is none of the states {', '.join(self.states)}")
        return level


@dataclass(frozen=True)
class WriteCommand:
    """Command that writes a channel: the request for a raw integer, and its confirmation by the device."""

    template: Template | None
    levels: Mapping[int, str]
    acknowledge: Pattern | None
    confirm: Query | None
    sets_level: bool = field(default=False, compare=False)
    """True if the command may be sent twice, because it sets a level and does not trigger an event."""
    ends: Ends = DRIVERS_ENDS

    def request(self, raw: int) -> str:
        if self.template is not None:
            return self.template.filled(raw)
        if raw not in self.levels:
            raise DriverError(f"{raw} is not a level: {', '.join(map(str, self.levels))}")
        return self.levels[raw]

    @property
    def place(self) -> tuple[Hashable, ...]:
        return ("set", self.template.before, self.template.after) if self.template else tuple(self.levels.values())


@dataclass(frozen=True)
class TextChannel(Channel):
    """A channel of a line protocol."""

    reading: ReadCommand | None = None
    setting: WriteCommand | None = None
    physical: PhysicalScale | None = field(default=None, compare=False)

    @property
    def places(self) -> tuple[Hashable, ...]:
        """The request that the channel sets; for an input, the request that it reads, and the part of the answer that
        it uses."""
        if self.setting is not None:
            return (self.setting.place,)
        assert self.reading is not None
        return (("ask", self.reading.ask, self.reading.answer.text),)

    @property
    def event(self) -> bool:
        """True unless it is known that a write sets a level."""
        return self.setting is not None and not self.setting.sets_level

    @property
    def done(self) -> tuple[Pattern | None, Query | None, Ends]:
        """The patterns that confirm a request to set the channel, and the terminator of their lines."""
        setting = self.setting
        return (setting.acknowledge, setting.confirm, setting.ends) if setting else (None, None, DRIVERS_ENDS)

    def raw(self, line: str) -> int:
        """Return the raw integer in an answer."""
        assert self.reading is not None
        raw = self.reading.raw(line)
        lowest, highest = self.limits
        if not lowest <= raw <= highest:
            raise NoValue(f"{raw} does not fit channel {self.text}: {lowest} to {highest}")
        return raw

    def request(self, raw: int) -> str:
        """Return the request that sets the channel to a raw integer. Raises DriverError if the integer does not fit, or
        is not a level."""
        if self.setting is None:
            raise DriverError(f"channel {self.text} cannot be written: it has no set")
        self.fit(raw)
        return self.setting.request(raw)


@dataclass
class Channels:
    """All channels of a wiring, made when they are first used: `zone{n}` stands for zone0, zone1, ..."""

    tables: Mapping[str, ChannelOptions]
    acknowledge: Pattern | None
    """The pattern for channels that do not have a pattern themselves. `confirm` is the query for such channels."""
    confirm: Query | None
    _forms: list[tuple[re.Pattern[str], str]] = field(init=False, default_factory=list)
    _known: dict[str, TextChannel] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        """Parse every table, so that a mistake is found before its channel is used."""
        if not self.tables:
            raise WiringError("channels is empty: each channel needs a table [drivers.NAME.channels.CHANNEL]")
        for name in self.tables:
            literals = [re.escape(part) for part in _NUMBERED.split(name)]
            if len(literals) > 2:
                raise WiringError(f"channels.{name}: the name has more than one {{n}}")
            self._forms.append((re.compile("(0|[1-9][0-9]{0,8})".join(literals)), name))
            self._make(name, name, 0 if len(literals) > 1 else None)

    def named(self, text: str) -> TextChannel:
        """Return the channel with this name. Raises ChannelError with all names if there is none."""
        if text in self._known:
            return self._known[text]
        for form, name in self._forms:
            if found := form.fullmatch(text):
                n = int(found[1]) if form.groups else None
                channel = self._known[text] = self._make(name, text, n)
                return channel
        raise ChannelError(text, self.tables)

    def with_state(self, text: str) -> str | None:
        """Return the name of the channel's table in which this text is the answer for a state."""
        made = ((name, self._make(name, name, 0 if form.groups else None)) for form, name in self._forms)
        return next((name for name, each in made if each.reading is not None and text in each.reading.states), None)

    def _make(self, name: str, text: str, n: int | None) -> TextChannel:
        where, table = f"channels.{name}", self.tables[name]
        checked_table(where, table, ChannelOptions.__annotations__, '{ ask = "T?", answer = "{}" }')
        if n is not None:
            table = numbered(table, n, where)
        scale = _scale(table["scale"], f"{where}.scale") if "scale" in table else None
        units = _text(table["units"], f"{where}.units") if "units" in table else None
        reading, setting = _reading(table, where, scale), self._setting(table, where, scale)
        if reading is None and setting is None:
            raise WiringError(f'{where} needs ask = "..." or set = "..."')
        direction = Direction.BOTH if reading and setting else Direction.INPUT if reading else Direction.OUTPUT
        levels = [*(reading.states.values() if reading else ()), *(setting.levels if setting else ())]
        bits = table.get("bits", max(levels).bit_length() or 1 if levels else _MAX_BITS)
        within(f"{where}.bits", bits, 1, _MAX_BITS)
        signed = table.get("signed", bits > 1 and not levels)
        if units is not None and levels:
            raise WiringError(f"{where}.units is for a number; levels have no unit")
        physical = None if units is None else PhysicalScale(float(scale or 1), 0.0, units)
        channel = TextChannel(text, direction, bits, signed, reading, setting, physical)
        if levels and max(levels) > channel.highest:
            raise WiringError(f"{where}: level {max(levels)} does not fit its {bits} bits")
        if setting is not None and setting.template is not None:
            setting.template.check(channel.lowest, channel.highest, f"{where}.set")
        return channel

    def _setting(self, table: ChannelOptions, where: str, scale: Decimal | None) -> WriteCommand | None:
        given = table.get("set")
        if given is None:
            if "acknowledge" in table or "confirm" in table:
                raise WiringError(f"{where}: acknowledge and confirm need set")
            if "sets_level" in table:
                raise WiringError(f"{where}.sets_level needs set")
            return None
        template, levels = None, {}
        if isinstance(given, str):
            template = Template.parse(given, f"{where}.set", scale)
        else:
            levels = _levels(given, f"{where}.set", _text)
        acknowledge, confirm = self.acknowledge, self.confirm
        if "acknowledge" in table:
            text = table["acknowledge"]
            acknowledge = Pattern(text, f"{where}.acknowledge") if text else None
        if "confirm" in table:
            confirm = Query.parse(table["confirm"], f"{where}.confirm")
        sets_level = _truth(table.get("sets_level", False), f"{where}.sets_level")
        return WriteCommand(template, levels, acknowledge, confirm, sets_level, Ends.of(table, where))


def _reading(table: ChannelOptions, where: str, scale: Decimal | None) -> ReadCommand | None:
    ask = table.get("ask")
    if ask is None:
        for key in ("answer", "states"):
            if key in table:
                raise WiringError(f"{where}.{key} needs ask")
        return None
    answer = Pattern(table.get("answer", "{}"), f"{where}.answer", has_value=True)
    states: dict[str, int] = {}
    given = _levels(table["states"], f"{where}.states", lambda value, _: value) if "states" in table else {}
    for level, texts in given.items():
        for text in texts if isinstance(texts, list | tuple) else [texts]:
            _text(text, f"{where}.states.{level}")
            if states.setdefault(text, level) != level:
                raise WiringError(f"{where}.states: {text!r} stands for {states[text]} and for {level}")
    return ReadCommand(ask, answer, states, RawOf(scale), Ends.of(table, where))


def _levels(table: Any, where: str, of: Callable[[Any, str], T]) -> dict[int, T]:
    """Return the entries of a table such as { 0 = "OFF", 1 = "ON" } by number."""
    if not isinstance(table, Mapping) or not table:
        raise WiringError(f'{where} must be a string or a table of levels {{ 0 = "OFF", 1 = "ON" }}, not {table!r}')
    for level in table:
        if not re.fullmatch("0|[1-9][0-9]{0,8}", str(level)):
            raise WiringError(f"{where}: a level is a whole number from 0 on, not {level!r}")
    return {int(level): of(value, f"{where}.{level}") for level, value in table.items()}


def _text(value: Any, where: str) -> str:
    if not isinstance(value, str):
        raise WiringError(f"{where} must be a string, not {value!r}")
    return value


def _truth(value: Any, where: str) -> bool:
    if not isinstance(value, bool):
        raise WiringError(f"{where} must be true or false, not {value!r}")
    return value


def _scale(value: Any, where: str) -> Decimal:
    """Return the step of one raw integer, exactly as it is written."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < float("inf"):
        raise WiringError(f"{where} must be a number above 0 (the step of one raw integer), not {value!r}")
    return Decimal(repr(value))
