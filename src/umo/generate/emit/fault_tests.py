"""Names in C that the form does not have."""

from __future__ import annotations

from umo.generate.form import MachineForm
from umo.generate.names import identifier


def tests_of(program: MachineForm) -> dict[tuple[type[BaseException], ...], str]:
    """The functions that tell whether a fault is of these classes of errors, by the classes."""
    stems = {kinds: identifier("_or_".join(each.__name__ for each in kinds)) for kinds in program.handled}
    return {kinds: f"is_{number}_{stem}" for number, (kinds, stem) in enumerate(stems.items())}
