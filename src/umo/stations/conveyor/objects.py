"""The 8 objects of the conveyor. Their groups and their control are in `control.py`."""

from umo import BinaryActuator, BinarySensor, DigitalActuator, DigitalSensor
from umo.states import OnOff, OpenClosed

from .control import Beam, Belt, Conveyor, Sorter


def machine() -> Conveyor:
    """Return a belt on a frequency drive, two light barriers, a diverter and an emergency stop."""
    return Conveyor(
        sorter=Sorter(
            belt=Belt(
                run=BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF),
                setpoint=DigitalActuator("m/s", default=0, minimum=0, maximum=1, resolution=1 / 16384, slew_rate=0.5),
                speed=DigitalSensor("m/s", minimum=-0.1, maximum=1.1, resolution=1 / 16384),
            ),
            entry=BinarySensor(Beam, one=Beam.COVERED),
            exit=BinarySensor(Beam, one=Beam.COVERED),
            diverter=BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF),
            emergency_stop=BinarySensor(OpenClosed, one=OpenClosed.CLOSED),  # pressed: OPEN, as a broken wire is
        ),
        timer=DigitalSensor("sampling_period", minimum=0, maximum=99_999, resolution=1, synchronous=False),
    )
