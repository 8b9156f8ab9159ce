"""The layout of a machine: all parts of its period are made before any driver is opened."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from types import MappingProxyType
from typing import Any

from umo.cycle.capability import Capability, declared_capabilities
from umo.cycle.clock import Clock, WallClock
from umo.cycle.directory import axes_in
from umo.cycle.equipment import equipment_in
from umo.cycle.image import Image
from umo.cycle.machine import ConnectedMachine
from umo.cycle.machine_view import connect_compounds
from umo.cycle.off_cycle import off_cycle_drivers
from umo.cycle.part_periods import PartPeriods
from umo.cycle.showing import Showing
from umo.cycle.stopping import StopFlag
from umo.drivers.wrapping import bare
from umo.objects import Compound, walk
from umo.wiring.wired import Wired, apply_calibrations, apply_parameters


def machine_of(
    root: Compound, wired: Wired, stop: StopFlag, states: Mapping[str, Any] = MappingProxyType({})
) -> ConnectedMachine:
    """Return the machine of a wiring. Its objects must have their calibrations and parameters (`wired_numbers`).
    `states`: the states of its capabilities at the end of the last run."""
    clock = WallClock() if wired.period is None else Clock(wired.period)
    declared = declared_capabilities(root)
    rows = len(equipment_in(root)), len(axes_in(root)), sum(each.alarm_rows for each in declared)
    image = Image(wired, clock, *rows)
    if wired.injection is not None:
        wired.injection.clock, wired.injection.say = clock, image.events.log
    parts = PartPeriods() if any(rate.every > 1 for rate in wired.rates) else None
    attached = [*filter(None, [parts]), *off_cycle_drivers(image, wired), Showing(wired.injection), *declared]
    machine = ConnectedMachine(root, image, stop, wired.process.outputs, attached, states)
    connect_compounds(machine, None if parts is None else parts.view_of)
    return machine


def taken_parts(root: Compound, wired: Wired) -> list[Capability]:
    """Return the drivers that carry out parts of a machine by themselves. They are to be attached to the machine; its
    objects are not connected. Raises NotTranslated for a part that cannot be translated."""
    nodes = {node._path: node for node in walk(root)} if wired.controllers else {}
    drivers: list[Any] = []
    for path, name in wired.controllers.items():
        drivers.append(bare(wired.drivers[name]))
        drivers[-1].take_part(nodes[path], wired)
    return drivers


@contextmanager
def laid_out(root: Compound, wired: Wired) -> Iterator[ConnectedMachine]:
    """Return a context in which the objects behave as if they were connected; no device is opened, nothing is read or
    written."""
    with wired_numbers(root, wired):
        machine = machine_of(root, wired, StopFlag())
        try:
            yield machine
        finally:
            machine.disconnect()


@contextmanager
def wired_numbers(root: Compound, wired: Wired) -> Iterator[None]:
    """Return a context in which the objects have the calibrations of the wiring, and the machine has its parameters."""
    undo: list[Callable[[], object]] = []
    try:
        undo.append(apply_calibrations(wired.wires))
        apply_parameters(root, wired.parameters, undo.append)
        yield
    finally:
        for each in reversed(undo):
            each()
