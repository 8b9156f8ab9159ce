"""Finds the rows of all drivers, runs them in turns, and makes the table."""

from __future__ import annotations

import dataclasses
import importlib
import pkgutil
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from statistics import median
from typing import Any

from rich.table import Table as Grid

import bench.drivers as package
from bench.drivers.case import IN_KERNEL, SIZES, Case, NotHere
from bench.scan import quiet

TARGET = 1.2
CYCLES = 20
"""Of a row, before the next one has its turn."""


@dataclass(frozen=True)
class Figures:
    """One row, measured: us for each cycle, least and median."""

    driver: str
    library: str
    channels: int
    transfers: int | None
    umo: tuple[float, float]
    by_hand: tuple[float, float]

    @property
    def ratio(self) -> float:
        """Of medians: a transfer's least time is luck."""
        return self.umo[1] / self.by_hand[1]


Others = tuple[list[Figures], list[str]]


def measure(rounds: int, others: Callable[[list[str]], Others] | None = None, only: str = "") -> Others:
    """All rows, and what is missing and why. `others` measures the drivers that need the test kernel, or run outside
    of it; default: they are left out. `only`: the modules with this in their names."""
    figures: list[Figures] = []
    missing: list[str] = []
    elsewhere = []
    for name in (name for name in names() if only in name):
        try:
            cases = module(name).cases
            if getattr(module(name), "NEEDS_KERNEL", False) is not IN_KERNEL:
                elsewhere.append(name)
                continue
        except NotHere as error:
            missing.append(f"{name}: not measured: {error}")
            continue
        with ExitStack() as stack:
            rows, reasons = _rows(name, cases, stack)
            missing += reasons
            figures += _measured(rows, rounds)
    if elsewhere and others is not None:
        more, reasons = others(elsewhere)
        return figures + more, missing + reasons
    return figures, missing


def _measured(rows: list[Case], rounds: int) -> list[Figures]:
    with quiet():
        for row in rows:
            row.measure(CYCLES)  # to warm up
            row.times = {key: [] for key in row.times}
        for _ in range(rounds):
            for row in rows:
                row.measure(CYCLES)
    return [_figures(row) for row in sorted(rows, key=lambda row: row.driver)]


def names() -> list[str]:
    """The modules that have rows."""
    return [
        found.name for found in pkgutil.iter_modules(package.__path__) if found.name not in ("case", "kernel", "table")
    ]


def module(name: str) -> Any:
    """The module of this driver's rows. Raises NotHere if a library of it is missing."""
    try:
        return importlib.import_module(f"bench.drivers.{name}")
    except ModuleNotFoundError as error:
        raise NotHere(f"{error.name} is not installed") from None


def _rows(
    name: str, cases: Callable[[int, ExitStack], Iterator[Case]], stack: ExitStack
) -> tuple[list[Case], list[str]]:
    """The rows of all sizes, and why some are missing."""
    rows: list[Case] = []
    reasons: dict[str, list[int]] = {}
    for channels in SIZES:
        try:
            rows += cases(channels, stack)
        except NotHere as error:
            reasons.setdefault(str(error), []).append(channels)
    return rows, [f"{name}: {_sizes(sizes)}not measured: {reason}" for reason, sizes in reasons.items()]


def _sizes(sizes: list[int]) -> str:
    return "" if len(sizes) == len(SIZES) else f"{' and '.join(map(str, sizes))} channels "


def _figures(row: Case) -> Figures:
    umo, by_hand = ((min(times), median(times)) for times in row.times.values())
    return Figures(row.driver, row.library, row.channels, row.transfers, umo, by_hand)


def grid(figures: list[Figures]) -> Grid:
    grid = Grid(title="Drivers: us for a cycle, read_many and write_many: minimum / median")
    for column in ("driver", "library"):
        grid.add_column(column)
    for column in ("channels", "transfers", "umo", "library by hand", "ratio", f"at most {TARGET:g}"):
        grid.add_column(column, justify="right")
    for row, below in zip(figures, [*figures[1:], None], strict=True):
        grid.add_row(
            row.driver,
            row.library,
            str(row.channels),
            "-" if row.transfers is None else str(row.transfers),
            *(f"{least:.1f} / {middle:.1f}" for least, middle in (row.umo, row.by_hand)),
            f"{row.ratio:.2f}",
            "yes" if row.ratio <= TARGET else "NO",
            end_section=below is not None and below.driver.partition(",")[0] != row.driver.partition(",")[0],
        )
    return grid


def from_json(rows: list[dict[str, Any]]) -> list[Figures]:
    """Of `as_json`."""
    fields = [field.name for field in dataclasses.fields(Figures)]
    return [Figures(**{key: tuple(v) if isinstance(v := row[key], list) else v for key in fields}) for row in rows]


def as_json(figures: list[Figures]) -> list[dict[str, Any]]:
    return [vars(row) | {"ratio": row.ratio} for row in figures]
