"""`make bench`: one table, all rows in the same run; then the other figures and the targets.

Exit status 1 if a figure could not be taken; a target that was missed is said and is no failure.
"""

from __future__ import annotations

import argparse
import json
import platform
import sys
from pathlib import Path

import numpy as np
from rich.console import Console

from bench import figures, forms, live, native, report, scan

ROUNDS, QUICK_ROUNDS = 600, 60


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m bench", description="What umo costs, in one table.")
    parser.add_argument("--quick", action="store_true", help="fewer batches: a rougher answer in a third of the time")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all figures here too")
    parser.add_argument("--live", action="store_true", help="the processes and frames alone: real time, kills")
    parser.add_argument("--forms", action="store_true", help="compare the two forms of the process image, no more")
    options = parser.parse_args()
    rounds = QUICK_ROUNDS if options.quick else ROUNDS
    console = Console()
    console = Console(width=max(console.width, 140), highlight=False)
    if options.forms:
        console.print(forms.grid(forms.measure(rounds // 2)))
        return 0
    if options.live:
        console.print(report.target_grid(live.measure(options.quick, console), live.TITLE))
        return 0
    console.print(f"{platform.machine()}, Python {platform.python_version()}, numpy {np.__version__}, {_compiler()}")
    with console.status("memory, import, connecting, the station"):
        others = report.Others(
            *figures.bytes_per_object(),
            *figures.seconds_to_connect(),
            figures.seconds_to_import(),
            figures.station_ratio(),
        )
    with console.status(f"{rounds} rounds of every case in turns"):
        table = scan.measure(rounds)
    found = report.targets(table, others)
    for part in (report.main_grid(table), report.NOTES, report.other_grid(others), report.target_grid(found)):
        console.print(part)
    beside = live.measure(options.quick, console)
    console.print(report.target_grid(beside, live.TITLE))
    if (missing := native.missing()) is not None:
        console.print(missing)
    if options.json:
        options.json.write_text(json.dumps(report.as_json(table, others, found + beside), indent=2) + "\n")
    if isinstance(others.station, str):
        print(f"the station did not run: {others.station}", file=sys.stderr)
        return 1
    return 0


def _compiler() -> str:
    return "no C++ compiler" if native.missing() else native.version()


if __name__ == "__main__":
    sys.exit(main())
