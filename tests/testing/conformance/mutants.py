"""Broken drivers: the careful one (careful.py) with one change of its text each. They stand in six tables (.txt)."""

from __future__ import annotations

import re
import sys
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

from conformance import careful
from conformance.careful import Careful

SOURCE = Path(careful.__file__).read_text("utf-8")
NAMES = ("mutants.txt", "further.txt", "third.txt", "fourth.txt", "fifth.txt", "sixth.txt")
TABLES = [Path(__file__).with_name(name).read_text("utf-8") for name in NAMES]
HEADING = re.compile(r"^## (.+) -> ([a-z ]+)(?:, (\d+) cycles)?$", re.MULTILINE)
ADDED = {"ages": "KnowsAges", "stop_waiting": "EndsWait"}
QUICK = 40
"""Cycles where the mistake does not add up."""


@dataclass(frozen=True)
class Mutant:
    """What is wrong, the rule that must find it, the cycles that it takes, and the change."""

    words: str
    rule: str
    cycles: int
    change: str

    def driver(self) -> type[Careful]:
        """The careful driver with this change."""
        old, replaced, new = self.change.partition("\n====\n")
        if replaced and old not in SOURCE:
            raise LookupError(f"{self.words}: careful.py has no text {old!r}")
        text = SOURCE.replace(old, new) if replaced else f"{SOURCE}\n{self.change}\n"
        for name, kind in ADDED.items():  # what the careful driver does not have
            if f"def {name}(" in self.change:
                text = text.replace("class Careful(", f"from umo.drivers import {kind}\n\nclass Careful({kind}, ", 1)
        module = ModuleType("conformance.mutant")
        sys.modules[module.__name__] = module  # dataclasses look there
        exec(compile(text, careful.__file__, "exec"), module.__dict__)
        made: type[Careful] = module.Careful
        return made


def _mutants() -> dict[str, Mutant]:
    found = {}
    for table in TABLES:
        _, *parts = HEADING.split(table)
        for words, rule, cycles, change in zip(*(iter(parts),) * 4, strict=True):
            found[words] = Mutant(words, rule, int(cycles or QUICK), change.strip("\n"))
    return found


MUTANTS = _mutants()
