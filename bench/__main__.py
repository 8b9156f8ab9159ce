"""`make bench`: one table, all rows in the same run; then the other figures and the targets, in about two minutes.

Exit status 1 if a figure could not be taken, or with --kills if anything was unsafe or ended with a wrong status; a
target that was missed is said and is not a failure.
"""

from __future__ import annotations

import argparse
import json
import platform
import sys
from functools import partial
from pathlib import Path

import numpy as np
from rich.console import Console

from bench import (
    against,
    alarms,
    bounds,
    compiled,
    dead_device,
    endurance,
    faces,
    figures,
    generated,
    live,
    native,
    open_page,
    recording,
    report,
    scan,
    several_rates,
    slow_devices,
    zones,
)
from bench.drivers import kernel
from bench.drivers import table as drivers
from bench.drivers.case import IN_KERNEL
from bench.fleet import campaign as fleet
from bench.fleet import figures as fleet_figures
from bench.fleet import loop as fleet_loop
from bench.kills import campaign, show

ROUNDS, QUICK_ROUNDS = 400, 60
DRIVER_ROUNDS, QUICK_DRIVER_ROUNDS = 30, 10
FIGURES_TAKE, ROUND_TAKES = 35.0, 0.09
"""s, about, on two shared cores."""


def main() -> int:
    options = _options()
    console = Console()
    console = Console(width=max(console.width, 140), highlight=False)
    if options.kills:
        how = {name: getattr(options, name) for name in ("quick", "only", "seed", "jobs", "first")}
        return show.run(console, **how)
    if options.against:
        return against.run(console, options.against, options.only, options.pairs)
    rounds = QUICK_ROUNDS if options.quick else ROUNDS
    if options.drivers:
        return _drivers(console, options)
    if options.live:
        size = live.SHORT if options.quick else live.FULL
        report.stream(console, live.TITLE, size.takes, partial(live.measure, size))
        return 0
    if options.page:
        rounds, seconds = (3, 2.0) if options.quick else (20, 4.0)
        takes = 4 * rounds * (seconds + open_page.SETTLE)
        with live.folders():
            report.stream(console, open_page.TITLE, takes, partial(open_page.measure, rounds, seconds))
        return 0
    if options.endurance:
        with live.folders():
            takes = 60.0 * options.endurance
            report.stream(console, endurance.TITLE, takes, partial(endurance.measure, options.endurance))
        return 0
    if options.dead_device:
        takes = 60.0 * options.dead_device
        report.stream(console, dead_device.TITLE, takes, partial(dead_device.measure, options.dead_device))
        return 0
    if options.slow_devices:
        takes = options.slow_devices * len(slow_devices.KINDS) * (slow_devices.BLOCK + 2.0)
        report.stream(console, slow_devices.TITLE, takes, partial(slow_devices.measure, options.slow_devices))
        return 0
    if options.faces:
        report.stream(console, faces.TITLE, faces.takes(options.faces), partial(faces.measure, options.faces))
        return 0
    if options.recording is not None:
        pairs = options.recording
        report.stream(console, recording.TITLE, recording.takes(pairs), partial(recording.measure, pairs))
        return 0
    if options.compiled is not None:
        takes = compiled.PAIR_TAKES * options.compiled
        report.stream(console, compiled.TITLE, takes, partial(compiled.measure, options.compiled))
        return 0
    if options.generated:
        report.stream(console, generated.TITLE, generated.takes(), generated.measure)
        return 0
    if options.fleet:
        measure = partial(fleet.measure, options.fleet, seed=options.seed)
        found = report.stream(console, fleet.TITLE, fleet.takes(options.fleet), measure)
        return 1 if any(each.verdict == "missed" for each in found) else 0
    if options.fleet_figures:
        report.stream(console, fleet_figures.TITLE, fleet_figures.TAKES, fleet_figures.measure)
        return 0
    if options.fleet_loop:
        takes = fleet_loop.PAIR_TAKES * options.fleet_loop
        report.stream(console, fleet_loop.TITLE, takes, partial(fleet_loop.measure, options.fleet_loop))
        return 0
    if options.rates:
        takes = options.rates * len(several_rates.KINDS) * (several_rates.BLOCK + 2.0)
        report.stream(console, several_rates.TITLE, takes, partial(several_rates.measure, options.rates))
        return 0
    if options.bounds:
        return bounds.run(console, options.bounds, options.only, markdown=options.markdown)
    if options.alarms:
        takes = options.alarms * alarms.BATCH * len(alarms.KINDS) * 1e-4
        report.stream(console, alarms.TITLE, takes, partial(alarms.measure, options.alarms))
        return 0
    return _all(console, rounds, options)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m bench", description="What umo costs, in one table.")
    parser.add_argument("--quick", action="store_true", help="a rougher answer, sooner: without processes and frames")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all figures here too")
    alone = parser.add_mutually_exclusive_group()
    alone.add_argument(
        "--compiled", type=int, metavar="PAIRS", help="compiled laws beside Python and a C loop; 10 for a result"
    )
    alone.add_argument(
        "--generated", action="store_true", help="generated controllers on emulated boards: cycles, flash and RAM"
    )
    alone.add_argument("--live", action="store_true", help="the processes and frames alone: real time, some kills")
    alone.add_argument(
        "--page", action="store_true", help="the loop with the page of `umo show page` open, and without"
    )
    alone.add_argument(
        "--kills", action="store_true", help="kills and faults by the hundred against a box on libmodbus"
    )
    alone.add_argument("--drivers", action="store_true", help="the drivers alone, beside their libraries by hand")
    alone.add_argument(
        "--against", type=Path, metavar="DIR", help="this tree against another checkout with its .venv, in pairs"
    )
    alone.add_argument(
        "--endurance", type=float, metavar="MINUTES", help="z-theta with everything beside it: does anything grow?"
    )
    alone.add_argument(
        "--dead-device", type=float, metavar="MINUTES", help="missed periods of a Modbus device beside a dead one"
    )
    alone.add_argument(
        "--slow-devices",
        type=int,
        metavar="PAIRS",
        help="slow devices beside a loop of 1 ms; 30 for a result",
    )
    alone.add_argument(
        "--rates", type=int, metavar="PAIRS", help="a part of 1 ms with slower parts beside it; 30 for a result"
    )
    alone.add_argument(
        "--faces",
        type=int,
        nargs="?",
        const=30,
        metavar="PAIRS",
        help="each face with a client of another project, and a loop of 1 ms with all of them; default: 30",
    )
    alone.add_argument(
        "--recording",
        type=int,
        nargs="?",
        const=30,
        metavar="PAIRS",
        help="the recorder beside stations, and a loop of 1 ms with it; default: 30",
    )
    alone.add_argument(
        "--fleet",
        type=float,
        nargs="?",
        const=30.0,
        metavar="MINUTES",
        help="a hundred stations on ten computers, each part killed in turn; default: 30 minutes; needs root",
    )
    alone.add_argument("--fleet-figures", action="store_true", help="what a fleet costs: 300 and 1,000 stations")
    alone.add_argument(
        "--fleet-loop", type=int, metavar="PAIRS", help="a loop of 1 ms in a fleet and without; 30 for a result"
    )
    alone.add_argument(
        "--bounds",
        type=int,
        nargs="?",
        const=bounds.REPETITIONS,
        metavar="REPETITIONS",
        help=f"what one cause costs the period that it meets; exit status 1 if a bound is broken; default: "
        f"{bounds.REPETITIONS}",
    )
    alone.add_argument("--alarms", type=int, metavar="ROUNDS", help="a loop with 1,000 alarms; 50 for a result")
    parser.add_argument("--pairs", type=int, default=30, help="pairs of blocks of a row of --against; default: 30")
    parser.add_argument(
        "--only", default="", metavar="TEXT", help="--kills, --drivers, --against and --bounds: names with this in them"
    )
    parser.add_argument("--markdown", action="store_true", help="--bounds: print the rows of docs/bounds.md")
    parser.add_argument("--seed", type=int, default=campaign.SEED, help="of --kills and --fleet: other random moments")
    parser.add_argument("--jobs", type=int, default=1, help="tries of --kills at a time; default: 1")
    parser.add_argument("--from", type=int, default=0, dest="first", help="--kills: go on with this try")
    return parser.parse_args()


def _drivers(console: Console, options: argparse.Namespace) -> int:
    rounds = QUICK_DRIVER_ROUNDS if options.quick else DRIVER_ROUNDS
    rows, reasons = drivers.measure(rounds, _in_kernel, options.only)
    console.print(drivers.grid(rows))
    for missing in reasons:
        console.print(missing)
    if options.json:
        options.json.write_text(json.dumps({"drivers": drivers.as_json(rows), "missing": reasons}, indent=2) + "\n")
    return 0


def _in_kernel(names: list[str]) -> drivers.Others:
    """The test kernel measures these; in it the others are not measured."""
    return ([], []) if IN_KERNEL else kernel.measured(names, quick=True)


def _all(console: Console, rounds: int, options: argparse.Namespace) -> int:
    seconds = FIGURES_TAKE + rounds * ROUND_TAKES + (0.0 if options.quick else live.SHORT.takes)
    console.print(
        f"about {report.duration(seconds)} (--live: {report.duration(live.FULL.takes)}; --kills says it by itself)"
    )
    console.print(f"{platform.machine()}, Python {platform.python_version()}, numpy {np.__version__}, {_compiler()}")
    with console.status("memory, import, connecting, many zones, the stations"):
        others = report.Others(
            *figures.bytes_per_object(),
            *figures.seconds_to_connect(),
            figures.seconds_to_import(),
            figures.control_period(),
            figures.axis_period(),
            zones.measure(max(rounds // 2, 1)),
            {name: figures.station_ratio(name, *words) for name, (words, _) in report.STATIONS.items()},
        )
    with console.status(f"{rounds} rounds of every case in turns"):
        table = scan.measure(rounds)
    found = report.targets(table, others)
    for part in (report.main_grid(table), report.NOTES, report.other_grid(others), report.target_grid(found)):
        console.print(part)
    short = partial(live.measure, live.SHORT)
    beside = [] if options.quick else report.stream(console, live.TITLE, live.SHORT.takes, short)
    rows, reasons = ([], []) if options.quick else drivers.measure(QUICK_DRIVER_ROUNDS, _in_kernel)
    if rows:
        console.print(drivers.grid(rows))
    for missing in (*reasons, *filter(None, [native.missing()])):
        console.print(missing)
    if options.json:
        found_all = report.as_json(table, others, found + beside) | {"drivers": drivers.as_json(rows)}
        options.json.write_text(json.dumps(found_all, indent=2) + "\n")
    failed = {name: ratio for name, ratio in others.stations.items() if isinstance(ratio, str)}
    for name, reason in failed.items():
        print(f"the station {name} did not run: {reason}", file=sys.stderr)
    return 1 if failed else 0


def _compiler() -> str:
    return "no C++ compiler" if native.missing() else native.version()


if __name__ == "__main__":
    sys.exit(main())
