"""The compiled laws of a run. If the wiring does not request them, the compiler's modules are not imported."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from umo.cycle.machine import ConnectedMachine
from umo.errors import text_of
from umo.objects import Compound
from umo.wiring.wired import Wired

if TYPE_CHECKING:
    from umo.generate.compiled_laws import PreparedLaws


def prepare_if_asked(root: Compound, wired: Wired, say: Callable[[str], object]) -> PreparedLaws | None:
    """Compile the laws of a machine that is not connected yet. Return None if the wiring does not request it, or if
    there is an obstacle, which is printed."""
    if not wired.process.compile:
        return None
    from umo.generate.compiled_laws import prepare

    try:
        return prepare(root, wired)
    except Exception as error:  # the laws run in any case
        say(f"the laws run in Python, not compiled: {text_of(error)}")
        return None


def start_compiled(prepared: PreparedLaws | None, machine: ConnectedMachine, say: Callable[[str], object]) -> None:
    """Start the compiled laws of a machine that has its laws and no open device yet. The compiled laws are first
    compared with the laws in Python, then they replace these."""
    if prepared is None:
        return
    from umo.generate.compiled_laws import COMPARED, CompiledLaws
    from umo.generate.period_in_c import PeriodInC

    try:
        machine.attach(CompiledLaws(prepared))
        machine.attach(PeriodInC())
        say(
            f"the laws are compiled: C drives as soon as each law gave the same results as in Python for {COMPARED} "
            f"of its periods"
        )
    except Exception as error:  # such as a class that has none below it, or a library that was removed
        say(f"the laws run in Python, not compiled: {text_of(error)}")
