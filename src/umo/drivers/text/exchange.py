"""The lines of one block transfer: which channels each serves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from umo.drivers.contract import IntArray
from umo.drivers.text.channel import Query, TextChannel
from umo.drivers.text.conversation import TextLink
from umo.drivers.text.pattern import NoValue, Pattern, UnexpectedAnswer, shown

_NOTHING: Mapping[int, Exception] = {}


class Asked(NamedTuple):
    """One line that asks. `parts` has an element for each query in it: the channels that take a part of its answer,
    with their places in the block."""

    request: str
    by: str | None
    parts: tuple[tuple[tuple[int, TextChannel], ...], ...]

    @property
    def places(self) -> list[int]:
        return [place for part in self.parts for place, _ in part]

    def read(self, link: TextLink, out: IntArray) -> Mapping[int, Exception]:
        """Put the values into their places; those that the device has none for."""
        answer = link.ask(self.request)
        answers = [answer] if len(self.parts) == 1 else answer.split(self.by)
        if len(answers) != len(self.parts):
            text = f"{len(self.parts)} queries, {len(answers)} answers: {shown(answer)}"
            raise link.dropped(UnexpectedAnswer(text))
        failed: dict[int, Exception] = {}
        for text, part in zip(answers, self.parts, strict=True):
            for place, channel in part:
                try:
                    if len(answers) > 1:
                        link.refuse(text, self.request)
                    out[place] = channel.raw(text)
                except NoValue as error:
                    failed[place] = error
                except UnexpectedAnswer as error:
                    raise link.dropped(error) from None
        return failed


class Told(NamedTuple):
    """One line that sets channels, and how the device confirms it."""

    request: str
    acknowledge: Pattern | None
    confirm: Query | None
    places: tuple[int, ...]

    def write(self, link: TextLink) -> Mapping[int, Exception]:
        link.tell(self.request, self.acknowledge, self.confirm)
        return _NOTHING


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
