"""Schedules of the stop: is every output at its default at the end, and what is told true, in whatever order and after
whatever faults?

    python -m tools.schedules                        200 orders without a fault
    python -m tools.schedules --singles              each kill, stop, delay and request to stop, at each gate
    python -m tools.schedules --singles kill hold    only these kinds
    python -m tools.schedules --pairs --every 4      two kills at one moment, at each fourth gate
    python -m tools.schedules --pairs kill stop      one is killed, another one stopped
    python -m tools.schedules --pairs kill hold      one is killed, another one held up: 60, 150 and 700 ms
    python -m tools.schedules --pairs --held 60      the first one is held up 60 ms at the gate, then both are killed
    python -m tools.schedules --forks --disks --silences --every 4
    python -m tools.schedules --random 10000 --from 5000
    python -m tools.schedules --clients --every 4    programs that attach to the run, and faults at their gates
    python -m tools.schedules --clients --random 1000
    python -m tools.schedules --planted              faults in copies of umo: are they found?
    python -m tools.schedules --replay "0: kill control at control:30; kill guardian at control:30"

Each failure is one line, reduced, which --replay plays again, with its trace.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from itertools import chain, islice
from time import monotonic

from tools.schedules.campaigns import (
    Played,
    Player,
    asks,
    at_random,
    beside_clients,
    gates_of,
    hunt,
    in_worlds,
    no_disks,
    no_forks,
    orders,
    pairs,
    played,
    shrunk,
    silences,
    singles,
)
from tools.schedules.faults import KINDS, MS, Schedule, What, parsed
from tools.schedules.planted import measure

SINGLE = (What.KILL, What.STOP, What.HOLD, What.ASK)
WITHIN = 300
"""Schedules for a planted fault."""
SHOWN = 40
"""Failures that are reduced and shown; further ones are counted."""
PROGRESS = 100
"""Schedules from one line of progress to the next."""


def main() -> int:
    parser = argparse.ArgumentParser(
        "python -m tools.schedules", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--orders", type=int, metavar="N", default=0)
    parser.add_argument("--singles", nargs="*", type=What, choices=SINGLE, metavar="KIND")
    parser.add_argument("--pairs", nargs="*", type=What, choices=SINGLE[:3], metavar="KIND")
    parser.add_argument("--every", type=int, default=1, metavar="N")
    parser.add_argument("--held", type=float, default=0.0, metavar="MS")
    parser.add_argument("--forks", action="store_true")
    parser.add_argument("--disks", action="store_true")
    parser.add_argument("--silences", action="store_true")
    parser.add_argument("--frames", action="store_true", help="with frames, keeper and black boxes")
    parser.add_argument("--long", action="store_true", help="with an application that goes on for long")
    parser.add_argument("--clients", action="store_true", help="with programs that attach, and a service manager")
    parser.add_argument("--random", type=int, metavar="N", default=0)
    parser.add_argument("--seed", type=int, default=0, help="of the order of the processes; 0: each in turn")
    parser.add_argument("--from", type=int, default=1, dest="first", metavar="SEED")
    parser.add_argument("--jobs", type=int, default=len(os.sched_getaffinity(0)), help="default: one for each core")
    parser.add_argument("--until-wrong", action="store_true", help="end at the first schedule that is wrong")
    parser.add_argument(
        "--hunt", type=int, metavar="N", default=0, help="what finds a fault soonest, to the first wrong"
    )
    parser.add_argument("--begin-with", action="append", default=[], metavar="LINE", help="of a hunt")
    parser.add_argument(
        "--planted", nargs="?", const="", metavar="NAME", help="faults in copies of umo: are they found?"
    )
    parser.add_argument("--within", type=int, default=WITHIN, metavar="N", help="schedules for each planted fault")
    parser.add_argument("--replay", metavar="LINE")
    given = parser.parse_args()
    if given.replay is not None:
        return replay(parsed(given.replay))
    if given.planted is not None:
        return measure(given.within, given.planted)
    with ExitStack() as stack:
        players = [stack.enter_context(Player()) for _ in range(given.jobs)]
        if given.hunt:
            hunted = hunt(gates_of(players[0], 0), gates_of(players[0], 0, clients=True))
            schedules = islice(chain(map(parsed, given.begin_with), hunted), given.hunt)
            return run(schedules, players, until_wrong=True, shown=0)
        return run(chosen(given, players[0]), players, given.until_wrong)


def chosen(given: argparse.Namespace, player: Player) -> Iterator[Schedule]:
    world = {name: getattr(given, name) for name in KINDS}
    gates = gates_of(player, given.seed, **world | {"long": False})  # at the end of a long run faults change little
    kinds = None if given.singles is None else given.singles or SINGLE
    parts: list[Iterable[Schedule]] = []
    if kinds is not None:
        parts += [singles([kind for kind in kinds if kind is not What.ASK], given.seed, gates)]
        parts += [asks(given.seed, gates)] if What.ASK in kinds else []
    if given.pairs is not None:
        first, second = [*given.pairs, What.KILL, What.KILL][:2]
        parts += [pairs((first, second), given.seed, gates, given.every, round(given.held * MS))]
    if given.forks:
        parts += [no_forks(given.seed, gates)]
    if given.disks:
        parts += [no_disks(given.seed, gates)]
    if given.silences:
        parts += [silences(given.seed, gates, given.every)]
    if given.random:
        parts += [at_random(range(given.first, given.first + given.random), gates)]
    if given.clients and not (parts or given.orders):
        parts += [beside_clients(given.seed, gates, given.every)]
    if given.orders or not parts:
        parts += [orders(range(given.first, given.first + (given.orders or 200)))]
    return in_worlds(chain.from_iterable(parts), **world)


def run(schedules: Iterable[Schedule], players: list[Player], until_wrong: bool = False, shown: int = SHOWN) -> int:
    """Play them all: a line for each failure, then what it has cost."""
    begun, count, steps, cpu = monotonic(), 0, 0, 0.0
    wrong: list[Played] = []
    slowest: dict[str, Played] = {}
    """Of each sum of rows of the table of ends the one that took longest."""
    for each in played(schedules, players):
        count, steps, cpu = count + 1, steps + each.steps, cpu + each.cpu
        if each.wrong:
            wrong.append(each)
            print(f"wrong: {each.schedule} | {each.wrong[0]}", flush=True)
            if until_wrong:
                break
        if each.took > 0 and (each.due not in slowest or each.took > slowest[each.due].took):
            slowest[each.due] = each
        if count % PROGRESS == 0:
            print(f"... {count} schedules, {len(wrong)} wrong, {count / (monotonic() - begun):.1f}/s", flush=True)
    lines = {str(least.schedule): least for least in (shrunk(each, players[0]) for each in wrong[:shown])}
    for line, least in lines.items():
        print(f"python -m tools.schedules --replay {line!r}\n    {'; '.join(least.wrong)}\n    {least.outcome}")
    for due, each in sorted(slowest.items()):
        print(f"{each.took:9.3f} of {each.limit:9.3f} ms  {due}  {str(each.schedule)!r}")
    seconds = monotonic() - begun
    print(
        f"{count} schedules, {len(wrong)} wrong: {steps / max(count, 1):.0f} steps and {cpu / max(count, 1) * 1e3:.0f} "
        f"ms of a processor each; {seconds:.0f} s, {count / seconds:.1f}/s"
    )
    return int(bool(wrong))


def replay(schedule: Schedule) -> int:
    """One schedule with its trace."""
    with Player() as player:
        found = player.play(schedule, trace=True)
    print("\n".join(found.trace))
    if found.printed:
        print(f"printed:\n{found.printed}")
    print(f"{found.steps} steps, trace {found.hash}, outcome: {found.outcome}")
    print("\n".join(found.wrong) or "all promises are kept")
    return int(bool(found.wrong))


if __name__ == "__main__":
    sys.exit(main())
