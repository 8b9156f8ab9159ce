"""Where the array form of the process image overtakes the list form: `python -m bench --forms`.

The result is `ARRAYS_FROM` in umo/cycle/forms.py; docs/decisions/0001-two-forms-of-the-image.md records it.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from statistics import median

from rich.table import Table as Grid

import umo.cycle.forms
from bench.driver import Fill, Loop
from bench.machine import Umo
from bench.mix import commands, layout, readings
from bench.scan import Case, Figure, quiet, take_turns

SIZES = (13, 26, 39, 52, 65, 78, 91, 104, 130, 156, 195)
WORKS = {
    "sample + update, plain driver": (Loop, "sample_update"),
    "with every actuator written, plain driver": (Loop, "period"),
    "sample + update, driver fills arrays": (Fill, "sample_update"),
    "with every actuator written, driver fills arrays": (Fill, "period"),
}
FORMS = {"lists": 10**9, "arrays": 0}

Forms = dict[tuple[str, int, str], Figure]


def measure(rounds: int, sizes: Sequence[int] = SIZES) -> Forms:
    """Both forms at every size, in turns."""
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
    chosen = umo.cycle.forms.ARRAYS_FROM
    umo.cycle.forms.ARRAYS_FROM = FORMS[form]
    try:
        plant = Umo(plan, driver(plan.sensors, plan.actuators))
    finally:
        umo.cycle.forms.ARRAYS_FROM = chosen
    stack.callback(plant.close)
    plant.prepare(commands(plan))
    plant.load(readings(plan))
    return plant


def grid(forms: Forms) -> Grid:
    found = Grid(title="The two forms of the process image, us per period, minimum / median")
    found.add_column("objects", justify="right")
    for work in WORKS:
        found.add_column(work, justify="right")
    for count in sorted({count for _, count, _ in forms}):
        cells = []
        for work in WORKS:
            lists, arrays = forms[work, count, "lists"], forms[work, count, "arrays"]
            pairs = [
                f"{form} {figure.minimum:.1f} / {figure.median:.1f}"
                for form, figure in (("lists", lists), ("arrays", arrays))
            ]
            cells.append("\n".join([*pairs, f"lists / arrays {lists.minimum / arrays.minimum:.2f}"]))
        found.add_row(str(count), *cells, end_section=True)
    return found
