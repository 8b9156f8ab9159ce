"""A machine with one axis on a simulated slide."""

from __future__ import annotations

from collections.abc import Callable, Coroutine
from typing import Any

import umo
from helpers.slide import HIGH, INDEX, Slide
from umo import BinaryActuator, BinarySensor, Compound, DigitalSensor, Interlock
from umo.control import Axis, IndexPulse
from umo.objects import atoms
from umo.states import EnableDisable, OnOff


class Machine(Compound):
    x: Axis
    enable: BinaryActuator[EnableDisable]
    switch: BinarySensor[OnOff]
    door: BinarySensor[OnOff]
    timer: DigitalSensor
    latched: bool = False

    def interlocks(self) -> Any:
        yield Interlock(lambda: self.door.read() is OnOff.ON, [self.x], "the door is open", latched=self.latched)


def machine(x: Axis, kind: type[Machine] = Machine) -> Machine:
    enable = BinaryActuator(EnableDisable, one=EnableDisable.ENABLE, default=EnableDisable.DISABLE)
    switch, door = (BinarySensor(OnOff, one=OnOff.ON) for _ in range(2))
    timer = DigitalSensor("sampling_period", minimum=0.0, maximum=1e9, resolution=1.0, synchronous=False)
    return kind(x=x, enable=enable, switch=switch, door=door, timer=timer)


def wiring(m: Machine, slide: Slide) -> dict[str, Any]:
    on = {"x.motor": "motor", "x.step": "step", "x.direction": "direction", "x.encoder": "counter", "enable": "enable"}
    on |= {"switch": "switch", "door": "door", "timer": "tick"}
    wire = {path: {"driver": "slide", "channel": on[path]} for path in (atom.path for atom in atoms(m))}
    wire["timer"]["period"] = "1 ms"
    return {"drivers": {"slide": slide}, "wire": wire}


Work = Callable[[Machine], Coroutine[Any, Any, Any]]


def run(m: Machine, slide: Slide, work: Work, watch: Callable[[Machine], object] | None = None) -> Any:
    connection = umo.connect(m, wiring(m, slide))
    with connection:
        if watch is not None:
            connection.machine.observers.append(lambda frame: watch(m))
        return umo.drive(m, work)


def index_pulse(m: Machine) -> IndexPulse:
    return IndexPulse(enable=m.enable, index=INDEX, stop=HIGH, jump=5.0, tolerance=1.0, clearance=2.0)
