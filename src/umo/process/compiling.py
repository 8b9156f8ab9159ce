"""Compiled laws of a run, where its wiring asks for them: what compiles them is imported then only."""

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
    """Compile the laws of a machine that is not connected yet. None: the wiring does not ask for it, or something is in
    the way, which is said."""
    if not wired.process.compile:
        return None
    from umo.generate.compiled_laws import prepare

    try:
        return prepare(root, wired)
    except Exception as error:  # the laws run in any case
        say(f"the laws run in Python, not compiled: {text_of(error)}")
        return None


def start_compiled(prepared: PreparedLaws | None, machine: ConnectedMachine, say: Callable[[str], object]) -> None:
    """The machine has its laws, and no device is open yet: its laws are compared, then run compiled."""
    if prepared is None:
        return
    from umo.generate.compiled_laws import COMPARED, CompiledLaws
    from umo.generate.period_in_c import PeriodInC

    try:
        machine.attach(CompiledLaws(prepared))
        machine.attach(PeriodInC())
        say(f"the laws are compiled: C drives when each was the same as in Python for {COMPARED} of its periods")
    except Exception as error:  # such as a class that has none below it, or a library that was removed
        say(f"the laws run in Python, not compiled: {text_of(error)}")
