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
from time import monotonic

from tools.fuzz.batches import OPTIMIZED, QUICK, SANITIZED, TARGETS, Batch, batches, played
from tools.fuzz.program import program
from tools.fuzz.shrink import body_of, shrunk

USUAL = "host", "compiled"
SHOWN = 12
"""Reasons of refusals that are shown."""


def main() -> int:
    parser = argparse.ArgumentParser(
        "python -m tools.fuzz", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("programs", type=int, nargs="?", default=1000)
    parser.add_argument("--from", type=int, default=0, dest="first")
    parser.add_argument("--target", choices=[*TARGETS], action="append")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--sanitize", action="store_true")
    parser.add_argument("--optimized", action="store_true", help="-O2 always, and not in one of eight batches")
    parser.add_argument("--until-wrong", action="store_true", help="end at the first program that is wrong")
    parser.add_argument("--replay", type=int, metavar="SEED")
    parser.add_argument("--mutants", action="store_true")
    given = parser.parse_args()
    if given.sanitize and "libasan" not in os.environ.get("LD_PRELOAD", ""):
        _again_with_sanitizers()
    targets = given.target or [*USUAL]
    flags = SANITIZED if given.sanitize else OPTIMIZED if given.optimized else None
    if given.replay is not None:
        return max(replay(Batch(each, flags or QUICK, [program(given.replay)])) for each in targets)
    if given.mutants:
        from tools.fuzz.mutants import measure

        return measure(given.programs if given.programs != parser.get_default("programs") else 5000, given.jobs)
    seeds = range(given.first, given.first + given.programs)
    return max(run(each, seeds, flags, given.jobs, given.until_wrong) for each in targets)


def run(target: str, seeds: range, flags: tuple[str, ...] | None, jobs: int, until_wrong: bool = False) -> int:
    """The programs of these seeds: how many have each outcome, and a line for each that is wrong."""
    begun = monotonic()
    outcomes: Counter[str] = Counter()
    reasons: Counter[str] = Counter()
    sums: Counter[str] = Counter()
    wrong = 0
    for batch, one, verdict in played(batches(target, seeds, flags), jobs):
        outcomes[verdict.outcome] += 1
        sums.update(periods=verdict.periods, faults=verdict.faults, limits=verdict.limits)
        if verdict.outcome == "refused":
            reasons[verdict.told.split("; ")[0].rpartition(": ")[2]] += 1
        if verdict.is_wrong:
            wrong += 1
            print(f"{batch.line(one.seed)}: {verdict.outcome}: {verdict.told[-300:]}", flush=True)
            if until_wrong:
                return 1
    seconds = monotonic() - begun
    print(
        f"{target}: {len(seeds)} programs in {seconds:.0f} s, {len(seeds) / seconds:.1f} a second on {jobs} processors"
    )
    print(f"    {', '.join(f'{number} {name}' for name, number in outcomes.most_common())}")
    print(f"    {sums['periods']} periods, {sums['faults']} with the same error, {sums['limits']} beyond 32 bits")
    for reason, number in reasons.most_common(SHOWN):
        print(f"{number:10} refused: {reason}")
    return int(bool(wrong))


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
