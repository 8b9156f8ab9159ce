"""Finds the rows of all drivers, runs them in turns, and makes the table."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from statistics import median
from typing import Any

from rich.table import Table as Grid

import bench.drivers as package
from bench.drivers.case import SIZES, Case, NotHere
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


def measure(rounds: int) -> tuple[list[Figures], list[str]]:
    """All rows, and why the rows of a driver are missing."""
    figures, missing = [], []
    for name in names():
        with ExitStack() as stack:
            try:
                rows = list(_rows(name, stack))
            except NotHere as error:
                missing.append(f"{name}: not measured: {error}")
                continue
            with quiet():
                for row in rows:
                    row.measure(CYCLES)  # to warm up
                    row.times = {key: [] for key in row.times}
                for _ in range(rounds):
                    for row in rows:
                        row.measure(CYCLES)
            figures += [_figures(row) for row in sorted(rows, key=lambda row: row.driver)]
    return figures, missing


def names() -> list[str]:
    """The modules that have rows."""
    return [found.name for found in pkgutil.iter_modules(package.__path__) if found.name not in ("case", "table")]


def module(name: str) -> Any:
    """The module of this driver's rows. Raises NotHere if a library of it is missing."""
    try:
        return importlib.import_module(f"bench.drivers.{name}")
    except ModuleNotFoundError as error:
        raise NotHere(f"{error.name} is not installed") from None


def _rows(name: str, stack: ExitStack) -> Iterator[Case]:
    cases = module(name).cases
    for channels in SIZES:
        yield from cases(channels, stack)


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


def as_json(figures: list[Figures]) -> list[dict[str, Any]]:
    return [vars(row) | {"ratio": row.ratio} for row in figures]
