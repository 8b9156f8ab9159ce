"""python -m tools.memory_orders [--quick] [--mutants] [--schedules] [WORDS of names]"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator
from functools import partial

import tools.memory_orders
from tools.memory_orders.cases import CASES, of_case, of_mutant
from tools.memory_orders.explore import Found
from tools.memory_orders.mutants import MUTANTS

Tried = tuple[str, str, bool, Callable[[], Found]]
"""Name, machine, whether anything is to be found, and what finds it."""


def main() -> int:
    """1 if anything is other than it is said to be."""
    parser = argparse.ArgumentParser("python -m tools.memory_orders", description=tools.memory_orders.__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)  # fmt: skip
    parser.add_argument("words", nargs="*", help="models with one of these in their names; default: all")
    parser.add_argument("--quick", action="store_true", help="what make test tries")
    parser.add_argument("--mutants", action="store_true", help="the mutants in place of the protocols")
    parser.add_argument("--schedules", action="store_true", help="the steps that lead to what does not hold")
    given = parser.parse_args()
    wrong = 0
    for name, machine, expected, work in _of_mutants(given.quick) if given.mutants else _of_cases(given.quick):
        if given.words and not any(word in name for word in given.words):
            continue
        found = work()
        wrong += bool(found.broken) != expected
        sign = "" if bool(found.broken) == expected else "WRONG: "
        print(
            f"{sign}{name} | {machine} | {found.states} states | {found.seconds:.2f} s | {found.broken or 'holds'}",
            flush=True,
        )
        for step in found.schedule if given.schedules else ():
            print(f"    {step}")
    return bool(wrong)


def _of_cases(quick: bool) -> Iterator[Tried]:
    for case in CASES:
        for machine in case.quick_machines if quick else case.machines:
            yield case.name, machine.name, machine in case.breaks, partial(of_case, case, machine)


def _of_mutants(quick: bool) -> Iterator[Tried]:
    for mutant in MUTANTS:
        for machine in mutant.quick_machines if quick else mutant.machines:
            yield mutant.what, machine.name, machine in mutant.found, partial(of_mutant, mutant, machine)


if __name__ == "__main__":
    sys.exit(main())
