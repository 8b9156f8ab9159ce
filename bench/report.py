"""The tables on the screen, the targets, and the same as JSON."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from typing import Any

from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.table import Table as Grid

from bench import native
from bench.scan import PERIOD, ROWS, SCAN_FILL, SCAN_LOOP, VECTOR, WRITE, Figure, Table

NOTES = """\
(a) umo: range checks, quality, time stamps, pending and commanded values all on; called as a program calls it.
(b) the paper's design: the four classes of Listings 2 and 3 with double for float, the compounds of Figure 4, the
    driver of Listing 4 in a file of its own with a table for the switch; range check on writing; no quality, no time.
    Its compiler may inline all but the driver. (c) the floor: a loop over arrays for each kind, range flags, no calls.
(d) by hand: plain attributes and a method for each group of objects, range check and scaling; no quality, no time, no
    pending and commanded values; the same driver object and int64 buffers as (a). (a) and (d) scale an outgoing value
    when it is written, (b) and (c) when it is sent. (b) and (c) have their drivers in C whatever the first column says.
By Vector: one Vector for each kind (motors; valves by two-state type), given float arrays; (b), (c) and (d) have none,
    their figures are those of writing each.
Objects: as in the z-theta station, of 13 are 1 digital and 7 binary actuators, 4 digital and 1 binary sensors, all
    synchronous. All rows get the same readings and commands; tests/project/test_bench.py shows that they agree on the
    results.
Figures: us per period, minimum / median of batches run in turns; garbage collection off; ratios are of minima."""


STATIONS: dict[str, tuple[tuple[str, ...], float]] = {
    "ztheta": (("--parts", "1"), 25.0),
    "conveyor": ((), 25.0),
    "furnace": ((), 25.0),
    "batch": ((), 25.0),
}
"""The stations that are run: their options, and how many times faster than real time they are to be."""


@dataclass(frozen=True)
class Others:
    """What `bench.figures` found."""

    declared_bytes: float
    connected_bytes: float
    declare_s: float
    connect_s: float
    import_s: float
    control: tuple[float, float]
    """us, least and median."""
    axis: tuple[float, float]
    """us, least and median."""
    zones: dict[str, Figure]
    """us a period of many zones under PI."""
    stations: dict[str, float | str]
    """How many times faster than real time, or why it did not run."""


@dataclass(frozen=True)
class Target:
    what: str
    target: str
    measured: str
    verdict: str


def main_grid(table: Table) -> Grid:
    grid = Grid(title="us per period, minimum / median")
    grid.add_column("work", max_width=26)
    grid.add_column("objects", justify="right")
    for row, name in ROWS.items():
        grid.add_column(f"({row}) {name}", justify="right", max_width=19)
    grid.add_column("a/d", justify="right")
    grid.add_column("a/b", justify="right")
    for work in (PERIOD, SCAN_LOOP, SCAN_FILL, WRITE, VECTOR):
        counts = sorted({count for known, count, _ in table if known == work})
        for count in counts:
            figures = {row: table.get((work, count, row)) for row in ROWS}
            grid.add_row(
                work if count == counts[0] else "",
                f"{count:,}",
                *(_cell(figure) for figure in figures.values()),
                _ratio(figures["a"], figures["d"]),
                _ratio(figures["a"], figures["b"]),
                end_section=count == counts[-1],
            )
    return grid


def targets(table: Table, others: Others) -> list[Target]:
    """The figures that were asked for. Minima decide; the median stands beside them."""
    period, by_hand = table[PERIOD, 13, "a"], table[PERIOD, 13, "d"]
    found = [
        upper("13 objects: sample, write each, update", period.minimum, 8.0, "us", period.median),
        upper("the same against (d)", period.minimum / by_hand.minimum, 1.5, "times", period.median / by_hand.median),
    ]
    scan, paper = table[SCAN_FILL, 10_000, "a"], table.get((SCAN_FILL, 10_000, "b"))
    what = "10,000 objects: sample + update against (b)"
    if paper is None:
        found.append(Target(what, "at most 1 times", "-", "not measured: no compiler"))
    else:
        found.append(upper(what, scan.minimum / paper.minimum, 1.0, "times", scan.median / paper.median))
    found.append(upper("z-theta's control in virtual time, a period", others.control[0], 12.0, "us", others.control[1]))
    found.append(upper("a servo axis in virtual time, a period", others.axis[0], 6.0, "us", others.axis[1]))
    found += _of_zones(others.zones)
    found.append(upper("import umo", others.import_s, 0.25, "s", others.import_s))
    return found + [_against_real_time(name, ratio) for name, ratio in others.stations.items()]


def _of_zones(zones: dict[str, Figure]) -> list[Target]:
    found = []
    for kind in sorted({name.partition(",")[0] for name in zones}):
        umo, by_hand = zones[f"{kind}, umo"], zones[f"{kind}, numpy"]
        what = f"1,000 zones under PI on Vectors, {kind}, a period"
        found.append(upper(what, umo.minimum, 150.0, "us", umo.median))
        ratio = umo.minimum / by_hand.minimum, umo.median / by_hand.median
        found.append(upper("the same against plain numpy by hand", ratio[0], 1.5, "times", ratio[1]))
    return found


def target_grid(found: list[Target], title: str = "Targets") -> Grid:
    grid = Grid(title=title)
    for column in ("figure", "target", "measured: minimum (median)", "verdict"):
        grid.add_column(column)
    for target in found:
        grid.add_row(target.what, target.target, target.measured, target.verdict)
    return grid


Doing = Callable[[str], object]
"""Told what is being measured now."""


def stream(console: Console, title: str, seconds: float, measure: Callable[[Doing], Iterable[Target]]) -> list[Target]:
    """Measure, and print each row as soon as it is known; meanwhile what is being measured, and since when."""
    found: list[Target] = []
    console.print(f"{title}, about {duration(seconds)}", style="bold")
    head = Target("figure", "target", "measured: minimum (median)", "verdict")
    console.print(_line(head), style="bold", soft_wrap=True)
    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("")
        for target in measure(lambda what: bar.update(task, description=f"{what};")):
            found.append(target)
            console.print(_line(target), markup=False, highlight=False, soft_wrap=True)
    return found


def _line(target: Target) -> str:
    return f"{target.what:<66} {target.target:<22} {target.measured:<46} {target.verdict}".rstrip()


def duration(seconds: float) -> str:
    """`40 s` or `25 min`."""
    return f"{seconds:.0f} s" if seconds < 100 else f"{seconds / 60:.0f} min"


def other_grid(others: Others) -> Grid:
    grid = Grid(title="Other figures")
    grid.add_column("figure")
    grid.add_column("measured", justify="right")
    grid.add_row("bytes per object, declared (tracemalloc, 10,000 objects)", f"{others.declared_bytes:,.0f}")
    grid.add_row("bytes per object that connecting adds", f"{others.connected_bytes:,.0f}")
    grid.add_row("declaring 10,000 objects", f"{others.declare_s:.2f} s")
    grid.add_row("connecting 10,000 objects", f"{others.connect_s:.2f} s")
    return grid


def as_json(table: Table, others: Others, found: list[Target]) -> dict[str, Any]:
    return {
        "rows": ROWS,
        "compiler": None if native.missing() else native.version(),
        "us_per_period": [
            {"work": work, "objects": count, "row": row, "minimum": figure.minimum, "median": figure.median}
            for (work, count, row), figure in table.items()
        ],
        "others": asdict(others),
        "targets": [asdict(target) for target in found],
    }


def _against_real_time(name: str, ratio: float | str) -> Target:
    least = STATIONS[name][1]
    what, target = f"{name}, ratio to real time", f"at least {least:g} times"
    if isinstance(ratio, str):
        return Target(what, target, "-", f"not measured: {ratio}")
    return Target(what, target, f"{ratio:.1f} times", "met" if ratio >= least else f"missed by {1 - ratio / least:.0%}")


def upper(what: str, value: float, limit: float, unit: str, beside: float) -> Target:
    verdict = "met" if value <= limit else f"missed by {value / limit - 1:.0%}"
    return Target(what, f"at most {limit:g} {unit}", f"{value:.2f} ({beside:.2f}) {unit}", verdict)


def _cell(figure: Figure | None) -> str:
    if figure is None:
        return "-"
    return " / ".join(
        f"{number:.3f}" if number < 1 else f"{number:,.3g}" if number < 100 else f"{number:,.0f}"
        for number in (figure.minimum, figure.median)
    )


def _ratio(one: Figure | None, other: Figure | None) -> str:
    return "-" if one is None or other is None else f"{one.minimum / other.minimum:.2f}"
