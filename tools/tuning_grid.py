"""Tuning judged: `umo tune law` on plants whose truth is known, and python-control on the gains that it tells.

    python -m tools.tuning_grid                     two parts, 100 plants each: two lines for each, then the counts
    python -m tools.tuning_grid --part develop --count 20
    python -m tools.tuning_grid --part held-out --only 3 17

The plants are in tests/helpers/tuning_plants.py, the judge in tests/helpers/true_margins.py. Exit status 1 if a set
that was told as stable is not, or if a count misses its aim. It takes about four minutes.
"""

from __future__ import annotations

import argparse
import os
import sys
import warnings
from pathlib import Path
from typing import TYPE_CHECKING

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: small matrices, and others use the computer
HERE = Path(__file__).parents[1]
sys.path.insert(0, str(HERE / "tests"))
if TYPE_CHECKING:
    from helpers.tuning_grid import Verdict

BOTH = "both"


def main() -> int:
    from helpers.tuning_grid import Tally
    from helpers.tuning_plants import COUNT, DEVELOP, FRESH, HELD_OUT

    names = {each.replace(" ", "-"): each for each in (DEVELOP, HELD_OUT, FRESH)}
    options = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    options.add_argument("--part", choices=[*names, BOTH], default=BOTH)
    options.add_argument("--count", type=int, default=COUNT, help="plants of a part")
    options.add_argument("--only", type=int, nargs="*", help="numbers of plants")
    given = options.parse_args()
    warnings.simplefilter("ignore")  # of python-control
    parts = [DEVELOP, HELD_OUT] if given.part == BOTH else [names[given.part]]
    found = {part: _judge(part, given.count, given.only) for part in parts}
    for part, verdicts in found.items():
        print(f"\n{part}", *Tally(verdicts).lines, sep="\n")
    every = Tally([each for verdicts in found.values() for each in verdicts])
    if len(parts) > 1:
        print("\nboth", *list(every.lines)[-2:], sep="\n")
    return 0 if every.meets_its_aims else 1


def _judge(part: str, count: int, only: list[int] | None) -> list[Verdict]:
    from helpers.tuning_grid import verdict
    from helpers.tuning_plants import plants

    found = []
    for number, plant in enumerate(plants(part, count)):
        if only is None or number in only:
            found.append(verdict(plant))
            print(f"{number:3}", "\n".join(found[-1].lines), flush=True)
    return found


if __name__ == "__main__":
    sys.exit(main())
