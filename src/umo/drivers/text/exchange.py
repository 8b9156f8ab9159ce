"""The lines of one block transfer, each with the channels that it serves."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from typing import NamedTuple, TypeVar

from umo.drivers.contract import IntArray
from umo.drivers.text.channel import Ends, Query, TextChannel
from umo.drivers.text.pattern import NoValue, Pattern, UnexpectedAnswer, shown
from umo.drivers.text.text_link import TextLink
from umo.errors import ChannelsFailed, DriverError

T = TypeVar("T")


class QueryLine(NamedTuple):
    """One line with a request, and the channels whose values are parts of its answer."""

    request: str
    ends: Ends
    by: str | None
    queries: int
    """Number of queries that the line joins."""
    takers: tuple[tuple[int, int, TextChannel], ...]
    """The index of each channel in the block, and the number of the channel's query in the line."""

    @property
    def texts(self) -> list[str]:
        """The texts of its channels."""
        return [channel.text for _, _, channel in self.takers]

    def read(self, link: TextLink, out: IntArray) -> None:
        """Store the values of an answer at their indices. Raises ChannelsFailed for channels for which the device has
        no value."""
        answer = link.ask(self.request, self.ends)
        answers = [answer] if self.queries == 1 else answer.split(self.by)
        if len(answers) != self.queries:
            text = f"{self.queries} queries, {len(answers)} answers: {shown(answer)}"
            raise link.dropped(UnexpectedAnswer(text))
        failed: dict[str, str] = {}
        for place, query, channel in self.takers:
            try:
                if self.queries > 1 and link.errors:
                    link.refuse(answers[query], self.request)
                out[place] = channel.raw(answers[query])
            except NoValue as error:
                if len(self.takers) == 1:
                    raise
                failed[channel.text] = str(error)
            except UnexpectedAnswer as error:
                raise link.dropped(error) from None
        if failed:
            raise ChannelsFailed(failed)


class RequestLine(NamedTuple):
    """Channels that are written together, and the confirmation by the device. `by` joins their requests into one line;
    None for one channel."""

    places: tuple[int, ...]
    texts: tuple[str, ...]
    """The texts of its channels."""
    acknowledge: Pattern | None
    confirm: Query | None
    ends: Ends
    by: str | None

    def lines(self, requests: Sequence[str], longest: int) -> list[RequestLine]:
        """Return as many lines as needed, so that none is longer than `longest` characters."""
        if self.by is None:
            return [self]
        groups = joined([requests[i] for i in self.places], self.by, longest)
        return [self._replace(places=_those(self.places, group), texts=_those(self.texts, group)) for group in groups]

    def write(self, link: TextLink, requests: Sequence[str]) -> None:
        places = self.places
        request = requests[places[0]] if len(places) == 1 else (self.by or "").join(requests[i] for i in places)
        link.tell(request, self.acknowledge, self.confirm, self.ends)


def plan_reads(channels: Sequence[TextChannel], by: str | None, longest: int) -> tuple[QueryLine, ...]:
    """Return each request once, for any number of channels that use a part of its answer."""
    readers: dict[Ends, dict[str, list[tuple[int, TextChannel]]]] = {}
    for i, channel in enumerate(channels):
        if (reading := channel.reading) is None:
            raise DriverError(f"channel {channel.text} cannot be read: it has no ask")
        readers.setdefault(reading.ends, {}).setdefault(reading.ask, []).append((i, channel))
    lines: list[QueryLine] = []
    for ends, of in readers.items():
        asks = list(of)
        for group in joined(asks, by, longest):
            takers = tuple((i, query, each) for query, at in enumerate(group) for i, each in of[asks[at]])
            lines.append(QueryLine((by or "").join(_those(asks, group)), ends, by, len(group), takers))
    return tuple(sorted(lines, key=lambda line: line.takers[0]))


def plan_writes(channels: Sequence[TextChannel], by: str | None) -> tuple[RequestLine, ...]:
    """Return one request per channel. Consecutive requests without acknowledgement are joined by `by`, if given."""
    lines: list[RequestLine] = []
    for (acknowledge, confirm, ends), run in groupby(range(len(channels)), lambda i: channels[i].done):
        places = tuple(run)
        joins = by is not None and acknowledge is None
        for some in [places] if joins else [(i,) for i in places]:
            texts = tuple(channels[i].text for i in some)
            lines.append(RequestLine(some, texts, acknowledge, confirm, ends, by if joins else None))
    return tuple(lines)


def joined(requests: Sequence[str], by: str | None, longest: int) -> list[list[int]]:
    """Return groups of requests, by their index, that fit into one line of at most `longest` characters; without `by`
    each group has one request."""
    groups: list[list[int]] = []
    length = 0
    for i, request in enumerate(requests):
        if by is not None and groups and length + len(by) + len(request) <= longest:
            groups[-1].append(i)
            length += len(by) + len(request)
        else:
            groups.append([i])
            length = len(request)
    return groups


def _those(things: Sequence[T], places: Sequence[int]) -> tuple[T, ...]:
    return tuple(things[place] for place in places)
