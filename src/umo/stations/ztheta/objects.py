"""The 13 objects of the z-theta manipulator: the paper's Listing 5, with its numbers.

Departures from the listing: keywords, the lost minus sign of the z motor's minimum, `count` for the counterweight's
pressure (docs/paper.md gives the reasons). The grouping of the objects and their control are in `control.py`.
"""

from umo import BinaryActuator, BinarySensor, DigitalActuator, DigitalSensor
from umo.states import EnableDisable, OnOff, PassFail, Rotation, UpDown

from .control import Counterweight, Gripper, Manipulator, StepOutput, ThetaAxis, ZAxis


def machine() -> Manipulator:
    """Return the overhead manipulator (the paper's Figure 4): five compound objects, 13 atomic ones."""
    return Manipulator(
        z=ZAxis(
            motor=DigitalActuator(
                "V", default=0.0, minimum=-10.0, maximum=10.0, resolution=10.0 / 2047, limits="clamp"
            ),
            encoder=DigitalSensor(
                "um",
                minimum=55_000.0,
                maximum=129_000.0,
                resolution=4.64357,
                zero_offset=-147_871.0,
                incremental=True,
            ),
            encoder_zero=BinaryActuator(
                EnableDisable, one=EnableDisable.ENABLE, default=EnableDisable.DISABLE, synchronous=False
            ),
        ),
        theta=ThetaAxis(
            step=StepOutput(UpDown, one=UpDown.UP, default=UpDown.DOWN),
            direction=BinaryActuator(Rotation, one=Rotation.CW, default=Rotation.CW),
            encoder=DigitalSensor(
                "deg",
                minimum=-270.0,
                maximum=270.0,
                resolution=0.000529483,
                zero_offset=227.4438,
                incremental=True,
            ),
            encoder_zero=BinaryActuator(EnableDisable, one=EnableDisable.ENABLE, default=EnableDisable.DISABLE),
        ),
        counterweight=Counterweight(
            vacuum=BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF),
            pressure=DigitalSensor("count", minimum=0.0, maximum=1000.0, resolution=1.0),
        ),
        gripper=Gripper(
            vacuum=BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF),
            pressure=BinarySensor(PassFail, one=PassFail.FAIL),
        ),
        pressure_solenoid=BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF),
        timer=DigitalSensor("sampling_period", minimum=0.0, maximum=99_999.9, resolution=1.0, synchronous=False),
    )
