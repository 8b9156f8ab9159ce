"""Schedules of messages: what a transport does with each, all of them to a depth, some at random, and the shortest one
that still fails."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from itertools import product
from random import Random
from typing import NamedTuple

DELIVER = "."
"""The letter of a message that comes as it was sent. What a schedule does not name is delivered too."""


class Schedule(NamedTuple):
    """One line: the scenario, and a letter for each message from the one on at which the scenario begins to count."""

    scenario: str
    letters: str

    def __str__(self) -> str:
        return f"{self.scenario} {self.letters or DELIVER}"

    @staticmethod
    def of(line: str) -> Schedule:
        scenario, letters = line.split()
        return Schedule(scenario, letters)


class Finding(NamedTuple):
    """A schedule that fails, and what was untrue."""

    schedule: Schedule
    text: str


def exhaustive(scenarios: Iterable[str], letters: str, depth: int) -> Iterator[Schedule]:
    """Each letter for each of the first `depth` messages of each scenario."""
    for scenario in scenarios:
        for each in product(letters, repeat=depth):
            yield Schedule(scenario, "".join(each))


def at_random(scenarios: tuple[str, ...], letters: str, count: int, seed: int, longest: int) -> Iterator[Schedule]:
    """Schedules of up to `longest` messages. Each has its own share of messages that are delivered."""
    for number in range(seed, seed + count):
        random = Random(number)
        share, length = random.uniform(0.3, 0.95), random.randint(6, longest)
        others = random.sample(letters, random.randint(1, len(letters)))
        chosen = (DELIVER if random.random() < share else random.choice(others) for _ in range(length))
        yield Schedule(random.choice(scenarios), "".join(chosen))


def shrunk(finding: Finding, run: Callable[[Schedule], str]) -> Finding:
    """The finding with as few letters other than DELIVER as removing one after another gives, and no more letters than
    it needs."""
    best, text = finding.schedule, finding.text
    again = True
    while again:
        again = False
        for at, letter in enumerate(best.letters):
            if letter == DELIVER:
                continue
            simpler = best._replace(letters=best.letters[:at] + DELIVER + best.letters[at + 1 :])
            if found := run(simpler):
                best, text, again = simpler, found, True
    return Finding(best._replace(letters=best.letters.rstrip(DELIVER)), text)
