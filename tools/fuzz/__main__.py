"""Control programs at random: is what umo makes of them in C equal to Python, or refused before anything runs?

    python -m tools.fuzz 2000                          the programs 0 to 1,999 on host C and with compiled laws
    python -m tools.fuzz 500 --from 7000 --target line
    python -m tools.fuzz 1000 --sanitize               with the address and undefined-behaviour sanitizers
    python -m tools.fuzz --replay 1234 --target host   one program, reduced if it is wrong
    python -m tools.fuzz --mutants                     faults planted in the translator: which are found

Programs with an even seed have only what docs/howto-generate.md says translates: one that is refused is wrong, too.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from collections import Counter
from collections.abc import Sequence
from itertools import chain, zip_longest
from time import monotonic

from tools.fuzz.batches import OPTIMIZED, QUICK, SANITIZED, SIZE, TARGETS, Batch, batches, played
from tools.fuzz.mutants import measure
from tools.fuzz.program import program
from tools.fuzz.shrink import body_of, shrunk
from tools.fuzz.verdict import WRONG

USUAL = "host", "compiled"
FEW = 8
"""Programs in one library where the first that is wrong is the end."""
SHOWN = 12
"""Reasons of refusals that are shown."""


def main() -> int:
    parser = argparse.ArgumentParser(
        "python -m tools.fuzz", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("programs", type=int, nargs="?", default=5000)
    parser.add_argument("--from", type=int, default=0, dest="first")
    parser.add_argument("--target", choices=[*TARGETS], action="append")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--sanitize", action="store_true")
    parser.add_argument("--optimized", action="store_true", help="-O2 always, and not in one of eight batches")
    parser.add_argument("--until-wrong", action="store_true", help="end at the first program that is wrong")
    parser.add_argument("--replay", type=int, metavar="SEED")
    parser.add_argument("--mutants", metavar="NAME", nargs="?", const="", help="those whose name has this text in it")
    given = parser.parse_args()
    if given.sanitize and "libasan" not in os.environ.get("LD_PRELOAD", ""):
        _again_with_sanitizers()
    targets = given.target or [*USUAL]
    flags = SANITIZED if given.sanitize else OPTIMIZED if given.optimized else None
    if given.replay is not None:
        return max(replay(Batch(each, flags or QUICK, [program(given.replay)])) for each in targets)
    if given.mutants is not None:
        return measure(given.programs, given.jobs, given.mutants)
    seeds = range(given.first, given.first + given.programs)
    return run(targets, seeds, flags, given.jobs, given.until_wrong)


def run(targets: Sequence[str], seeds: range, flags: tuple[str, ...] | None, jobs: int, until_wrong: bool) -> int:
    """The programs of these seeds, on all targets in turns: a line for each that is wrong, and what they were."""
    begun = monotonic()
    outcomes: dict[str, Counter[str]] = {each: Counter() for each in targets}
    sums: dict[str, Counter[str]] = {each: Counter() for each in targets}
    reasons: Counter[str] = Counter()
    in_turns = chain.from_iterable(
        zip_longest(*(batches(each, seeds, flags, FEW if until_wrong else SIZE) for each in targets))
    )
    for batch, one, verdict in played(filter(None, in_turns), jobs):
        outcomes[batch.target][verdict.outcome] += 1
        sums[batch.target].update(periods=verdict.periods, faults=verdict.faults, limits=verdict.limits)
        if verdict.outcome == "refused":
            reasons[verdict.told.split("; ")[0].rpartition(": ")[2]] += 1
        if verdict.is_wrong:
            print(f"{batch.line(one.seed)}: {verdict.outcome}: {verdict.told[-300:]}", flush=True)
            if until_wrong:
                return 1
    seconds = monotonic() - begun
    for target in targets:
        print(f"{target}: {', '.join(f'{number} {name}' for name, number in outcomes[target].most_common())}")
        of = sums[target]
        print(f"    {of['periods']} periods, {of['faults']} with the same error, {of['limits']} beyond 32 bits")
    count = len(seeds) * len(targets)
    print(f"{count} programs in {seconds:.0f} s: {count / seconds:.1f} a second on {jobs} processors")
    for reason, number in reasons.most_common(SHOWN):
        print(f"{number:6} refused: {reason}")
    return int(any(each[name] for each in outcomes.values() for name in WRONG))


def replay(batch: Batch) -> int:
    """One program as it is, and reduced where it is wrong."""
    (one,) = batch.programs
    print(one.text[one.text.index("class Program") :])
    least, verdict = shrunk(batch)
    print(f"{batch.target}: {verdict.outcome} {verdict.told}")
    if verdict.is_wrong:
        print(f"reduced:\n{body_of(least)}")
    return int(verdict.is_wrong)


def _again_with_sanitizers() -> None:
    """What loads a library with a sanitizer has to have the sanitizer itself."""
    found = [
        subprocess.run(["cc", f"-print-file-name={name}"], capture_output=True, text=True, check=True).stdout.strip()
        for name in ("libasan.so", "libubsan.so")
    ]
    options = {"LD_PRELOAD": " ".join(found), "ASAN_OPTIONS": "detect_leaks=0", "UBSAN_OPTIONS": "print_stacktrace=1"}
    os.execve(sys.executable, [sys.executable, "-m", "tools.fuzz", *sys.argv[1:]], os.environ | options)


if __name__ == "__main__":
    sys.exit(main())
