"""The lines of one block transfer: which channels each serves."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from typing import NamedTuple

from umo.drivers.contract import IntArray
from umo.drivers.text.channel import Ends, Query, TextChannel
from umo.drivers.text.pattern import NoValue, Pattern, UnexpectedAnswer, shown
from umo.drivers.text.text_link import TextLink
from umo.errors import ChannelsFailed, DriverError


class QueryLine(NamedTuple):
    """One line that asks. `parts` has an element for each query in it: the channels that take a part of its answer,
    with their places in the block."""

    request: str
    ends: Ends
    by: str | None
    parts: tuple[tuple[tuple[int, TextChannel], ...], ...]

    @property
    def places(self) -> list[int]:
        return [place for part in self.parts for place, _ in part]

    def read(self, link: TextLink, out: IntArray) -> None:
        """Put the values into their places. ChannelsFailed for those for which the device has no value."""
        answer, parts = link.ask(self.request, self.ends), self.parts
        answers = [answer] if len(parts) == 1 else answer.split(self.by)
        if len(answers) != len(parts):
            text = f"{len(parts)} queries, {len(answers)} answers: {shown(answer)}"
            raise link.dropped(UnexpectedAnswer(text))
        failed: dict[str, str] = {}
        try:
            for part, line in zip(parts, answers, strict=True):
                for place, channel in part:
                    try:
                        if link.errors and len(answers) > 1:
                            link.refuse(line, self.request)
                        out[place] = channel.raw(line)
                    except NoValue as error:
                        if len(parts) == len(part) == 1:
                            raise
                        failed[channel.text] = str(error)
        except UnexpectedAnswer as error:
            raise link.dropped(error) from None
        if failed:
            raise ChannelsFailed(failed)


class RequestLine(NamedTuple):
    """Channels that are set, and how the device confirms it. `by` joins their requests in one line; None: it is one
    channel."""

    places: tuple[int, ...]
    acknowledge: Pattern | None
    confirm: Query | None
    ends: Ends
    by: str | None

    def lines(self, requests: Sequence[str], longest: int) -> list[RequestLine]:
        """Lines, as many as needed, so that none is longer than `longest` characters."""
        if self.by is None:
            return [self]
        groups = joined([requests[i] for i in self.places], self.by, longest)
        return [self._replace(places=tuple(self.places[i] for i in group)) for group in groups]

    def write(self, link: TextLink, requests: Sequence[str]) -> None:
        places = self.places
        request = requests[places[0]] if len(places) == 1 else (self.by or "").join(requests[i] for i in places)
        link.tell(request, self.acknowledge, self.confirm, self.ends)


def plan_reads(channels: Sequence[TextChannel], by: str | None, longest: int) -> tuple[QueryLine, ...]:
    """Each request once, whatever number of channels takes a part of its answer."""
    readers: dict[Ends, dict[str, list[tuple[int, TextChannel]]]] = {}
    for i, channel in enumerate(channels):
        if (reading := channel.reading) is None:
            raise DriverError(f"channel {channel.text} cannot be read: it has no ask")
        readers.setdefault(reading.ends, {}).setdefault(reading.ask, []).append((i, channel))
    lines = [
        QueryLine((by or "").join(asks[i] for i in group), ends, by, tuple(tuple(of[asks[i]]) for i in group))
        for ends, of in readers.items()
        for asks in [list(of)]
        for group in joined(asks, by, longest)
    ]
    return tuple(sorted(lines, key=lambda line: line.places[0]))


def plan_writes(channels: Sequence[TextChannel], by: str | None) -> tuple[RequestLine, ...]:
    """Each channel by itself; those that follow each other and are not acknowledged together, if `by` joins them."""
    lines: list[RequestLine] = []
    for (acknowledge, confirm, ends), run in groupby(range(len(channels)), lambda i: channels[i].done):
        places = tuple(run)
        if by is not None and acknowledge is None:
            lines.append(RequestLine(places, acknowledge, confirm, ends, by))
        else:
            lines.extend(RequestLine((i,), acknowledge, confirm, ends, None) for i in places)
    return tuple(lines)


def joined(requests: Sequence[str], by: str | None, longest: int) -> list[list[int]]:
    """Groups of requests, by their index, that go into one line of at most `longest` characters; alone without `by`."""
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
