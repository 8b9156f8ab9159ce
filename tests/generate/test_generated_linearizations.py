"""Linearizations of every size on a controller: each gives what Python does, or is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from helpers.generating import Beside, Fragile, needs_a_compiler, wired
from helpers.machines import timer
from helpers.tiers import some
from umo import Compound, DigitalActuator, DigitalSensor, LookupTable, Thermocouple
from umo.control import value_of
from umo.cycle.connect import connect
from umo.generate.controller_model import MOST, laid_out, too_many
from umo.objects import Quality
from umo.objects.linearization import Linearization
from umo.objects.thermocouple import KINDS
from umo.testing import VirtualTimer
from umo.wiring import resolve

LARGE = 40_000
"""Points of a LookupTable: more than a number of 16 bits holds."""


class Probe(Compound):
    """What is read through a linearization, and written through its inverse."""

    read: DigitalSensor
    written: DigitalActuator
    timer: DigitalSensor

    def control(self) -> None:
        self.written.write(value_of(self.read, Quality.OUT_OF_RANGE))


def probe(low: float, high: float, resolution: float, linearization: Linearization) -> Probe:
    given: dict[str, Any] = {"minimum": low, "maximum": high, "linearization": linearization}
    return Probe(
        read=DigitalSensor("degC", resolution=resolution, **given),
        written=DigitalActuator("degC", default=low, resolution=resolution / 7, limits="clamp", **given),
        timer=timer(),
    )


def equal_in_both(machine: Probe, inputs: np.ndarray[Any, Any], folder: Path) -> list[float]:
    """The values that Python and C have of these electrical inputs, equal to the bit."""
    box, found = Fragile(), []
    running = connect(machine, wired(machine, box, VirtualTimer([0] * len(inputs))))
    raws = np.rint(inputs / machine.read.resolution).astype(int).tolist()
    box.set("read", raws[0])
    with running:
        both = Beside.translated(running, box, folder)
        for raw in raws:
            both.step(1, [raw], [False], [False])
            assert both.difference() == ""
            found.append(both.c.value(both.model.objects[0].slot))
    return found


def ranges() -> list[Any]:
    """Each type over its usual range, and over all of it."""
    each = [(kind, start) for kind, of in KINDS.items() for start in dict.fromkeys([of.usual, of.start])]
    return [pytest.param(kind, start, id=f"{kind}{start:g}") for kind, start in each]


@pytest.mark.full
@needs_a_compiler
@pytest.mark.parametrize(("kind", "start"), some(lambda case: case.id == "B50", ranges()))
def test_a_thermocouple_is_the_same_in_c_over_all_of_its_range(kind: str, start: float, tmp_path: Path) -> None:
    end = KINDS[kind].end
    one = Thermocouple(kind).over(start, end)
    low, high = one.to_input(start), one.to_input(end)
    inputs = np.linspace(low - 0.1 * (high - low), high + 0.1 * (high - low), 301)
    values = equal_in_both(probe(start, end, 1e-5, Thermocouple(kind)), inputs, tmp_path)
    assert values[0] < start < values[150] < end < values[-1]


@pytest.mark.full
@needs_a_compiler
def test_a_table_of_more_points_than_16_bits_count_is_the_same_in_c(tmp_path: Path) -> None:
    xs = np.linspace(0.0, 10.0, LARGE)
    table = LookupTable(xs.tolist(), (xs**2).tolist())
    values = equal_in_both(probe(0.0, 100.0, 1e-4, table), np.linspace(-1.0, 11.0, 301), tmp_path)
    assert values[150] == pytest.approx(25.0, abs=1e-6) and values[-1] > 100.0


def test_more_objects_than_a_controller_counts_are_refused() -> None:
    machine = probe(0.0, 100.0, 0.01, LookupTable([0, 100], [0.0, 100.0]))
    wiring = resolve(machine, wired(machine, Fragile(), VirtualTimer([])))
    with laid_out(machine, wiring) as model:
        assert list(too_many(model)) == []
        one = replace(model.objects[0], invalid_raws=tuple(range(MOST + 1)))
        many = replace(model, objects=[one] * (MOST + 1))
        of_machine, of_one, *_ = map(str, too_many(many))
    assert of_machine == "the machine: it has 32768 objects; a controller has 32767 at most"
    assert of_one == "read: it has 32768 invalid raw integers; a controller has 32767 at most"
