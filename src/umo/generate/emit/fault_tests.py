"""Names in C that are not part of the form."""

from __future__ import annotations

from umo.generate.form import MachineForm
from umo.generate.names import identifier

IS_LIMIT = "is_limit"
"""The name of the function that tests whether a fault is one that does not exist in Python."""


def tests_of(program: MachineForm) -> dict[tuple[type[BaseException], ...], str]:
    """Return, by the classes of errors, the functions that test whether a fault belongs to these classes."""
    stems = {kinds: identifier("_or_".join(each.__name__ for each in kinds)) for kinds in program.handled}
    return {kinds: f"is_{number}_{stem}" for number, (kinds, stem) in enumerate(stems.items())}
