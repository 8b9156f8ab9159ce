"""A machine with everything that its period has, before any driver is opened."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from umo.cycle.alarming import declared_alarms, engine_of
from umo.cycle.capability import Capability, capabilities_in
from umo.cycle.clock import Clock, WallClock
from umo.cycle.directory import axes_in
from umo.cycle.equipment import equipment_in
from umo.cycle.image import Image
from umo.cycle.machine import ConnectedMachine
from umo.cycle.machine_view import connect_compounds
from umo.cycle.off_cycle import OffCycleDrivers
from umo.cycle.stopping import StopFlag
from umo.objects import Compound
from umo.wiring.wired import Wired, apply_parameters


def machine_of(root: Compound, wired: Wired, stop: StopFlag) -> ConnectedMachine:
    """The machine of a wiring. Its objects are to have their calibrations and parameters (`wired_numbers`)."""
    clock = WallClock() if wired.period is None else Clock(wired.period)
    if wired.injection is not None:
        wired.injection.clock = clock
    alarms = declared_alarms(root)
    image = Image(wired, clock, len(equipment_in(root)), len(axes_in(root)), len(alarms))
    attached: list[Capability] = [*OffCycleDrivers.of(image, wired), *capabilities_in(root)]
    machine = ConnectedMachine(root, image, stop, wired.injection, wired.process.outputs, wired.rates, attached)
    connect_compounds(machine)
    machine.alarms = engine_of(alarms, image, machine.commands, machine.equipment.all)
    if machine.alarms is not None:
        machine.phases.showing.append(machine.alarms.look)
    return machine


@contextmanager
def laid_out(root: Compound, wired: Wired) -> Iterator[ConnectedMachine]:
    """Inside, the objects are as if they were connected; no device is opened, nothing is read or written."""
    with wired_numbers(root, wired):
        machine = machine_of(root, wired, StopFlag())
        try:
            yield machine
        finally:
            machine.disconnect()


@contextmanager
def wired_numbers(root: Compound, wired: Wired) -> Iterator[None]:
    """Inside, the objects have the calibrations of the wiring, and the machine has its parameters."""
    undo: list[Callable[[], object]] = []
    try:
        undo.extend(wire.apply().apply for wire in wired.wires)
        apply_parameters(root, wired.parameters, undo.append)
        yield
    finally:
        for each in reversed(undo):
            each()
