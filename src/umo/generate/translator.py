"""Translates the control code of a connected machine to C: lowers it to the form, simplifies it and prints it."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from typing import Any

from umo.generate.check.form_effects import effects_of
from umo.generate.check.shape import shaped
from umo.generate.emit import program_text
from umo.generate.lower.passes import lowered
from umo.generate.translation import ControllerTarget, Translation, Untranslatable
from umo.objects import Compound

TRIED = (3, 11), (3, 12), (3, 13)
"""The versions of Python with which translation was tested. Syntax trees, `sum`, `math.hypot` and the watched
attributes depend on the version."""


def translate(
    machine: Compound,
    conditions: Sequence[Callable[[], Any]],
    steps: Sequence[Callable[[], Any]],
    target: ControllerTarget,
) -> Translation:
    """Return the conditions and the steps of a machine in C. Conditions return a bool; the results of steps are
    ignored. `problems` receives the code that cannot be translated."""
    if sys.version_info[:2] not in TRIED:
        tried, found = (", ".join(f"{one}.{two}" for one, two in each) for each in (TRIED, [sys.version_info[:2]]))
        told = f"it was tested on Python {tried}, and this is {found}"
        return Translation(problems=[Untranslatable("", 0, "control code", told, "one of these")])
    program, entry, world = lowered(machine, conditions, steps, target)
    program = shaped(program, [each.name for each in entry.values()])
    return Translation(
        header=program_text.header_text(program),
        members=program_text.members_text(program),
        source=program_text.source_text(program, target),
        fault_names=program_text.faults_text(world.faults),
        init=program_text.begin_text(program, target) if not world.problems else Translation().init,
        access=program_text.access_text(program),
        effects=effects_of(program),
        entry=entry,
        faults=world.faults,
        files=program.files,
        layout=world.fields.layout(),
        structs=world.fields.filled,
        host_calls=[f"{world.fields.known(each, '').path}.{name}" for each, name in world.hosts],
        text_makers=world.text_makers,
        kinds=world.kinds,
        hosts=world.hosts,
        known=world.known,
        notes=world.notes,
        problems=world.problems,
        refused_conditions=world.refused_conditions,
        on_host=world.on_host,
    )
