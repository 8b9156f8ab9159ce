"""`umo tune law` on each plant of a grid, and what python-control says of the gains that it tells."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import inf, log10
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from typer.testing import CliRunner

from helpers.true_margins import judged
from helpers.tuning_plants import AMPLITUDE, Plant, station
from umo.commissioning.tuning.margins import Gains
from umo_command.app import app

DECIBELS, DEGREES = 2.0, 5.0
"""A stated margin is at most so much better than the true one, in `WITHIN` of the sets."""
WITHIN = 0.95
TOLD_SHARE = 0.6
"""Share of the plants whose gains are told, at least."""
SETTINGS = ("gain", "integral_time", "derivative_time", "filter_time")
REST = 5
"""Periods before the experiment."""


@dataclass(frozen=True)
class JudgedSet:
    """One set of gains that was told as stable."""

    name: str
    stable: bool
    stated: tuple[float, float]
    true: tuple[float, float]

    @property
    def excess(self) -> tuple[float, float]:
        """By how much the stated margins are better than the true ones, dB and degrees."""
        if not self.stable:
            return inf, inf
        (gain, phase), (true_gain, true_phase) = self.stated, self.true
        decibels = 0.0 if true_gain == inf else 20.0 * (log10(gain) - log10(true_gain))
        return decibels, 0.0 if true_phase == inf else phase - true_phase

    @property
    def is_true(self) -> bool:
        decibels, degrees = self.excess
        return decibels <= DECIBELS and degrees <= DEGREES


@dataclass(frozen=True)
class Verdict:
    """What was told of a plant, and what is true."""

    plant: Plant
    refused: str
    """The sentence with which no gains are told; empty: they are."""
    model: str = ""
    sets: tuple[JudgedSet, ...] = ()

    @property
    def told(self) -> bool:
        return not self.refused

    @property
    def lines(self) -> Iterator[str]:
        """The plant, then what was told of it; margins: stated, and in brackets the true ones."""
        plant = self.plant
        yield f"{plant.family}: {plant.described()}"
        if self.refused:
            yield f"      refused: {self.refused}"
            return
        told = []
        for each in self.sets:
            (gain, phase), (true_gain, true_phase) = each.stated, each.true
            mark = "" if each.is_true else " !" if each.stable else " UNSTABLE"
            told.append(f"{each.name} {gain:.2f} ({true_gain:.2f}), {phase:.0f} ({true_phase:.0f}) deg{mark}")
        yield f"      {self.model}: {'; '.join(told)}"


@dataclass(frozen=True)
class Tally:
    """The counts of some verdicts."""

    verdicts: Sequence[Verdict]

    @property
    def told(self) -> int:
        return sum(each.told for each in self.verdicts)

    @property
    def sets(self) -> list[JudgedSet]:
        """All that were told as stable."""
        return [each for one in self.verdicts for each in one.sets]

    @property
    def unstable(self) -> int:
        return sum(not each.stable for each in self.sets)

    @property
    def true(self) -> int:
        return sum(each.is_true for each in self.sets)

    @property
    def meets_its_aims(self) -> bool:
        enough = self.told >= TOLD_SHARE * len(self.verdicts)
        return enough and not self.unstable and self.true >= WITHIN * len(self.sets)

    @property
    def lines(self) -> Iterator[str]:
        for family in sorted({each.plant.family for each in self.verdicts}):
            of_it = Tally([each for each in self.verdicts if each.plant.family == family])
            yield f"  {family:22} {of_it.told:3} of {len(of_it.verdicts):3} told"
        share = 100.0 * self.true / max(len(self.sets), 1)
        yield f"{self.told} of {len(self.verdicts)} told, {len(self.sets)} sets as stable; {self.unstable} are unstable"
        yield f"margins at most {DECIBELS:g} dB and {DEGREES:g} degrees better than true: {self.true} ({share:.1f} %)"


def verdict(plant: Plant) -> Verdict:
    """Make the experiment on the station of the plant, by the command line, and judge what it tells."""
    with TemporaryDirectory() as folder:
        result = CliRunner().invoke(app, [*map(str, words(plant, Path(folder)))])
    if result.exit_code:
        assert result.exit_code in (1, 2), result.output
        assert "Traceback" not in result.output
        assert "Error:" not in result.output, result.output
        return Verdict(plant, " ".join(result.stderr.split("umo: ")[-1].split()))
    data = json.loads(result.stdout)
    return Verdict(plant, "", data["model"]["kind"], tuple(_judged_sets(plant, data)))


def words(plant: Plant, folder: Path) -> list[Any]:
    """The arguments of the command."""
    at, lasts = REST * plant.dt, plant.lasts
    excitation = [f"--{plant.experiment}", f"{AMPLITUDE:g}%", "--at", f"{at:g} s", "--for", f"{lasts:g} s"]
    return ["tune", "law", station(plant, folder), "servo", *excitation, "--json"]


def _judged_sets(plant: Plant, data: dict[str, Any]) -> list[JudgedSet]:
    found = []
    for each in data["sets"]:
        stated = tuple(inf if each[name] is None else each[name] for name in ("gain_margin", "phase_margin"))
        if stated[0] <= 1.0 or stated[1] <= 0.0:
            continue  # told as unstable
        gains = Gains(**{name: each[name] for name in SETTINGS if each[name] is not None})
        stable, *true = judged(plant, gains)
        found.append(JudgedSet(each["name"], stable, stated, (true[0], true[1])))  # type: ignore[arg-type]
    return found
