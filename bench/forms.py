"""The forms of the process image side by side, machines of every size: `python -m bench --forms`.

The result is `ARRAYS_FROM` in umo/cycle/forms.py; docs/decisions/0001-forms-of-the-image.md records it.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from statistics import median
from unittest.mock import patch

from rich.table import Table as Grid

from bench.driver import Fill, Loop
from bench.machine import Umo
from bench.mix import commands, layout, readings
from bench.scan import Case, Figure, quiet, take_turns
from umo.cycle import forms
from umo.cycle.forms import ArrayImage, CompiledImage, ListImage
from umo.cycle.image import Image

SIZES = (13, 26, 39, 52, 65, 78, 91, 104, 130, 156, 195, 2000)
WORKS = {
    "sample + update, plain driver": (Loop, "sample_update"),
    "with every actuator written, plain driver": (Loop, "period"),
    "sample + update, driver fills arrays": (Fill, "sample_update"),
    "with every actuator written, driver fills arrays": (Fill, "period"),
}
FORMS: dict[str, type[Image]] = {"lists": ListImage, "arrays": ArrayImage}
if forms.extension is not None:
    FORMS["compiled"] = CompiledImage

Forms = dict[tuple[str, int, str], Figure]


def measure(rounds: int, sizes: Sequence[int] = SIZES) -> Forms:
    """Every form at every size, in turns."""
    with ExitStack() as stack:
        cases = [
            Case(work, count, form, getattr(make(count, driver, form, stack), verb))
            for count in sizes
            for work, (driver, verb) in WORKS.items()
            for form in FORMS
        ]
        with quiet():
            take_turns(cases, rounds)
    return {(case.work, case.count, case.row): Figure(min(case.times), median(case.times)) for case in cases}


def make(count: int, driver: type[Loop], form: str, stack: ExitStack) -> Umo:
    """A connected plant whose image has the form asked for."""
    plan = layout(count)
    with patch.object(forms, "form_for", lambda count: FORMS[form]):
        plant = Umo(plan, driver(plan.sensors, plan.actuators))
    stack.callback(plant.close)
    plant.prepare(commands(plan))
    plant.load(readings(plan))
    return plant


def grid(found: Forms) -> Grid:
    table = Grid(title="The forms of the process image, us per period, minimum / median")
    table.add_column("objects", justify="right")
    for work in WORKS:
        table.add_column(work, justify="right")
    for count in sorted({count for _, count, _ in found}):
        cells = []
        for work in WORKS:
            figures = {form: found[work, count, form] for form in FORMS}
            cells.append("\n".join(f"{form} {each.minimum:.1f} / {each.median:.1f}" for form, each in figures.items()))
        table.add_row(str(count), *cells, end_section=True)
    return table
