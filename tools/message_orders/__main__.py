"""python -m tools.message_orders [--link | --feed], or --planted [NAME]"""

from __future__ import annotations

import argparse
import logging
import re
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing, contextmanager
from resource import RLIMIT_CPU, setrlimit
from typing import NamedTuple

import tools.message_orders
from tools.message_orders import command_world, feed_world, link_world
from tools.message_orders.fleet_net import Net
from tools.message_orders.line import Line
from tools.message_orders.planted import measure
from tools.message_orders.schedules import Finding, Schedule, at_random, exhaustive, shrunk

DIGITS = re.compile(r"[0-9.]+")
LONGEST = 40
"""Messages of a schedule at random that are decided over, at most."""
Run = Callable[[Schedule], str]


class Subject(NamedTuple):
    """What is tried: its scenarios, all letters, those of all schedules to a depth, and what runs one."""

    scenarios: tuple[str, ...]
    letters: str
    each: str
    begun: Callable[[], Iterator[Run]]


def _link() -> Iterator[Run]:
    with link_world.controller_library() as library, closing(link_world.LinkRuns(library)) as runs:
        yield runs.run


def _feed() -> Iterator[Run]:
    with closing(command_world.CommandRuns()) as commands:
        follow = feed_world.FeedRuns()
        yield lambda each: (commands if each.scenario in command_world.SCENARIOS else follow).run(each)


SUBJECTS = {
    "link": Subject(link_world.SCENARIOS, Line.LETTERS, Line.EACH, _link),
    "feed": Subject((*feed_world.SCENARIOS, *command_world.SCENARIOS), Net.LETTERS, Net.EACH, _feed),
}


def tried(schedules: Iterable[Schedule], run: Run, *, first: bool = False) -> tuple[int, list[Finding]]:
    """How many there were, and those that fail: one of each kind. `first`: up to the first one."""
    findings: dict[str, Finding] = {}
    count = 0
    for each in schedules:
        count += 1
        if text := run(each):
            findings.setdefault(DIGITS.sub("", text)[:20], Finding(each, text))
            if first:
                break
    return count, list(findings.values())


def schedules_of(subject: Subject, given: argparse.Namespace) -> Iterable[Schedule]:
    scenarios = tuple(each for each in subject.scenarios if not given.scenario or each in given.scenario)
    if given.replay:
        schedule = Schedule.of(given.replay)
        return [schedule] if schedule.scenario in scenarios else []
    if given.random:
        return at_random(scenarios, subject.letters[1:], given.random, given.seed, LONGEST)
    return exhaustive(scenarios, subject.each, given.depth)


def main() -> int:
    parser = argparse.ArgumentParser("python -m tools.message_orders", description=tools.message_orders.__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)  # fmt: skip
    parser.add_argument("--link", action="append_const", dest="subjects", const="link", help="the link only")
    parser.add_argument("--feed", action="append_const", dest="subjects", const="feed", help="the fleet only")
    parser.add_argument("--depth", type=int, default=6, help="messages that each letter is tried for; default: 6")
    parser.add_argument("--random", type=int, default=0, metavar="N", help="so many at random in place of these")
    parser.add_argument("--from", type=int, default=0, dest="seed", metavar="SEED")
    parser.add_argument("--replay", metavar="LINE", help="one schedule, as a finding tells it")
    parser.add_argument("--first", action="store_true", help="end at the first finding")
    parser.add_argument("--scenario", action="append", help="of these only; default: all")
    parser.add_argument("--cpu", type=int, metavar="S", help="be killed after so many s of a processor")
    parser.add_argument("--planted", nargs="?", const="", metavar="NAME", help="plant faults: which are found?")
    given = parser.parse_args()
    if given.planted is not None:
        return measure(given.planted)
    if given.cpu is not None:
        setrlimit(RLIMIT_CPU, (given.cpu, given.cpu + 5))
    logging.disable(logging.CRITICAL)
    failed = False
    for name in given.subjects or SUBJECTS:
        began, subject = time.process_time(), SUBJECTS[name]
        with contextmanager(subject.begun)() as run:
            count, findings = tried(schedules_of(subject, given), run, first=given.first)
            for each in findings:
                shortest = each if given.first else shrunk(each, run)
                print(f'--replay "{shortest.schedule}": {shortest.text}', flush=True)
        took = time.process_time() - began
        print(f"{name}: {count} schedules, {len(findings)} findings, {took:.1f} s of CPU", flush=True)
        failed |= bool(findings)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
