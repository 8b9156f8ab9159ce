"""Laws that `setup` makes of what a wiring sets, or a restart restores, are compiled as they are."""

from __future__ import annotations

from typing import Annotated, Any

import pytest

from helpers.compiling import CompiledRun
from helpers.generating import Fragile, needs_a_compiler, wired
from helpers.machines import timer
from umo import Compound, DigitalActuator, DigitalSensor, Number
from umo.control import Servo
from umo.cycle.connect import connect
from umo.generate.compiled_laws import COMPARED, CompiledLaws, prepare
from umo.testing import VirtualTimer
from umo.wiring import resolve

pytestmark = needs_a_compiler


UNITS = {"gain": "V/mm", "N": ""}


class Oven(Compound):
    timer: DigitalSensor
    level: DigitalSensor
    motor: DigitalActuator
    gain: Annotated[float, Number("V/mm", 0.0, 10.0, tunable=True, kept=True)] = 0.5
    N: Annotated[int, Number("", 1, 5, kept=True)] = 2

    def setup(self) -> None:
        self.servo = Servo(self.level, self.motor, gain=self.gain, integral_time=60.0)

    def control(self) -> None:
        for _ in range(self.N):
            self.servo.control(50.0, dt=self.dt)


def oven() -> Oven:
    return Oven(
        timer=timer(),
        level=DigitalSensor("mm", minimum=0.0, maximum=100.0, resolution=0.5),
        motor=DigitalActuator("V", default=0.0, minimum=0.0, maximum=100.0, resolution=0.01),
    )


@pytest.mark.parametrize("parameters", [{}, {"gain": 0.25}, {"gain": 0.25, "N": 3}, {"servo.gain": 0.125}])
def test_a_station_with_parameters_compiles(parameters: dict[str, Any]) -> None:
    with CompiledRun(oven(), parameters=parameters) as run:
        expected = parameters.get("servo.gain", parameters.get("gain", 0.5))
        assert run.m.servo.gain == expected and parameters.get("N", 2) == run.m.N
        integral = run.m.servo.integral
        run.step()
        assert run.m.servo.integral > integral
        run.m.servo.gain = 0.75
        run.step()
        assert run.m.motor.pending == pytest.approx(0.75 * 50.0 + run.m.servo.integral, abs=0.1)
        assert run.laws.state == "compiled"


@pytest.mark.parametrize("kept", [{}, {"gain": 0.25}, {"N": 3}])
def test_so_does_one_whose_numbers_are_restored(kept: dict[str, Any]) -> None:
    machine, box = oven(), Fragile()
    wiring = resolve(machine, wired(machine, box, VirtualTimer()))
    prepared = prepare(machine, wiring)
    connection = connect(machine, wiring)
    connection.kept = {path: {"value": value, "unit": UNITS[path], "type": "number"} for path, value in kept.items()}
    made: list[CompiledLaws] = []
    connection.laid_out = lambda machine: made.append(machine.attach(CompiledLaws(prepared)))
    with connection as m:
        assert (m.gain, m.N) == (kept.get("gain", 0.5), kept.get("N", 2))
        for _ in range(COMPARED + 2):
            m.timer.read()
            m.sample()
            m.control()
            m.update()
        assert made[0].state == "compiled" and m.servo.gain == m.gain
