"""Each line marked `# E` must be refused by both type checkers, and no other line."""

from __future__ import annotations

from good import Gripper, Manipulator, ServoAxis, axis, gripper

from umo import BinaryActuator, BinarySensor, Compound, DigitalActuator
from umo.states import EnableDisable, OnOff, PassFail, UpDown


def wrong_values(m: Manipulator) -> None:
    m.gripper.vacuum.write(PassFail.PASS)  # E: a state of another type
    m.gripper.vacuum.write(1)  # E: a bare number is not a state
    m.gripper.vacuum.write(True)  # E: nor is a bool
    m.gripper.vacuum.write("ON")  # E: nor is a text
    m.z.motor.write(OnOff.ON)  # E: a state is not a number
    m.z.motor.write("5 V")  # E: nor is a text
    m.z.motor.write(None)  # E: nothing to write


def wrong_verbs(m: Manipulator) -> None:
    m.z.encoder.write(1.0)  # E: a sensor is not written
    m.gripper.pressure.write(PassFail.PASS)  # E: a sensor is not written
    m.z.motor.sample()  # E: an actuator is not sampled
    m.gripper.pressure.update()  # E: a sensor is not updated


def wrong_parts(m: Manipulator) -> None:
    m.z.moter.write(1.0)  # E: unknown part
    m.zz.motor.write(1.0)  # E: unknown part
    m.axes[0].brake.write(OnOff.ON)  # E: unknown part
    m.axes.append(axis())  # E: parts are fixed
    m.z.sped = 3.0  # E: no class declares it
    m.z.motor.value = 3.0  # E: nor this
    m.z.motor = axis().motor if m.z.motor > 3.0 else m.z.motor  # E: an object has no order


def wrong_children() -> None:
    Gripper(vacuum=gripper().pressure, pressure=gripper().pressure)  # E: a sensor in an actuator's place
    Gripper(vacuum=BinaryActuator(UpDown, one=UpDown.UP, default=UpDown.DOWN), pressure=gripper().pressure)  # E: states
    Gripper(vacuum=gripper().vacuum)  # E: missing child
    Gripper(vacuum=gripper().vacuum, pressure=gripper().pressure, lamp=gripper().vacuum)  # E: unknown child
    ServoAxis(gripper(), gripper(), gripper())  # E: parts are keywords
    Manipulator(timer=axis().encoder, z=gripper(), gripper=gripper(), axes=[], grippers={})  # E: wrong compound
    Manipulator(timer=axis().encoder, z=axis(), gripper=gripper(), axes=[gripper()], grippers={})  # E: in a list


def wrong_declarations() -> None:
    BinarySensor(OnOff, one=PassFail.FAIL, synchronous="no")  # E: no bool
    DigitalActuator("V", default=0.0, minimum=0.0, maximum=1.0, resolution=0.1, limits="ignore")  # E: no such limits
    DigitalActuator("V", 0.0, 0.0, 1.0, 0.1)  # E: keywords
    DigitalActuator("V", default=0.0, minimum=0.0, maximum=1.0)  # E: no resolution
    BinaryActuator(EnableDisable, default=EnableDisable.DISABLE)  # E: which state is one?


class Misspelt(Compound, stop_ordr=("motor",)):  # E: no class keyword
    motor: DigitalActuator
