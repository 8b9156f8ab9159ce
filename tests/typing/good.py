"""Both type checkers must accept this file as it stands; `reveal_type` is what an editor completes after the dot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import assert_type, reveal_type

import umo
from umo import BinaryActuator, BinarySensor, Compound, DigitalActuator, DigitalSensor, Quality, Vector
from umo.control import Lock, first, next_period, together, unless, until, wait
from umo.states import EnableDisable, OnOff, PassFail
from umo.testing import Scripted, VirtualTimer, periods, put


class ServoAxis(Compound):
    motor: DigitalActuator
    encoder: DigitalSensor
    encoder_zero: BinaryActuator[EnableDisable]
    speed: float = 100.0

    def control(self) -> None:
        super().control()
        self.motor.write(self.speed * self.dt)


class Gripper(Compound):
    vacuum: BinaryActuator[OnOff]
    pressure: BinarySensor[PassFail]


class Manipulator(Compound, stop_order=("z.motor",)):
    timer: DigitalSensor
    z: ServoAxis
    gripper: Gripper
    axes: Sequence[ServoAxis]
    grippers: Mapping[str, Gripper]


def axis() -> ServoAxis:
    return ServoAxis(
        motor=DigitalActuator("V", default=0.0, minimum=-10.0, maximum=10.0, resolution=10.0 / 2047, limits="clamp"),
        encoder=DigitalSensor("um", minimum=0.0, maximum=1.0, resolution=0.1, incremental=True),
        encoder_zero=BinaryActuator(
            EnableDisable, one=EnableDisable.ENABLE, default=EnableDisable.DISABLE, synchronous=False
        ),
    )


def gripper() -> Gripper:
    return Gripper(
        vacuum=BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF),
        pressure=BinarySensor(PassFail, one=PassFail.FAIL),
    )


manipulator = Manipulator(
    timer=DigitalSensor("sampling_period", minimum=0, maximum=99_999.9, resolution=1, synchronous=False),
    z=axis(),
    gripper=gripper(),
    axes=[axis(), axis()],
    grippers={"left": gripper()},
)

reveal_type(manipulator.z.motor)  # R: DigitalActuator
reveal_type(manipulator.z.encoder)  # R: DigitalSensor
reveal_type(manipulator.z.encoder_zero)  # R: BinaryActuator[EnableDisable]
reveal_type(manipulator.axes[0].motor)  # R: DigitalActuator
reveal_type(manipulator.grippers["left"].pressure)  # R: BinarySensor[PassFail]
reveal_type(manipulator.gripper.pressure.read())  # R: PassFail
reveal_type(manipulator.z.motor.read())  # R: float
reveal_type(manipulator.z.motor.quality)  # R: Quality
reveal_type(manipulator.gripper.vacuum.pending)  # R: OnOff

with umo.connect(manipulator, "wiring/simulated.toml") as m:
    reveal_type(m)  # R: Manipulator
    reveal_type(m.z.motor.write(1.0))  # R: bool
    while m.cycle.running:
        missed = m.timer.read()
        assert_type(missed, float)
        assert_type(m.sample(), bool)
        m.control()
        m.update()
    motors = Vector(each.motor for each in m.axes)
    reveal_type(motors[0])  # R: DigitalActuator
    motors.write([1.0, 2.0])
    Vector(g.vacuum for g in m.grippers.values()).write(OnOff.ON)
    m.gripper.vacuum.write(OnOff.ON)
    m.z.motor.write(2)
    if m.gripper.pressure.read() is PassFail.PASS and m.z.encoder.quality is Quality.GOOD:
        m.z.encoder.referenced()
    put(m.gripper.pressure, PassFail.FAIL)
    put(m.z.encoder, 0.5)
    periods(m, 3)


async def pick(m: Manipulator) -> int:
    tick = await next_period()
    assert_type(tick.period, float)
    await until(lambda: m.gripper.pressure.read() is PassFail.PASS, timeout="2 s")
    await together(wait(0.5), wait("20 ms"))
    moving = m.cycle.start(wait("1 s"))
    ended = await first(moving, wait(0.5))
    assert_type(ended.number, int)
    assert_type(moving.done, bool)
    assert_type(await unless(lambda: moving.done, wait(1.0)), bool)
    lock = Lock()
    async with lock:
        assert_type(lock.holder, str | None)
    return 1


umo.run(manipulator, {"drivers": {"box": Scripted(), "clock": VirtualTimer(missed=[0, 3])}}, pick)
