"""The machine: which actuators and sensors there are, in which units and ranges (the integrator's file)."""

from .control import Tank

from umo import BinaryActuator, BinarySensor, DigitalSensor
from umo.states import OpenClosed, PassFail


def machine() -> Tank:
    """Return a tank with an inlet, a drain, a level sensor and an overflow switch."""
    return Tank(
        inlet=BinaryActuator(OpenClosed, one=OpenClosed.OPEN, default=OpenClosed.CLOSED),
        drain=BinaryActuator(OpenClosed, one=OpenClosed.OPEN, default=OpenClosed.CLOSED),
        level=DigitalSensor("mm", minimum=0.0, maximum=500.0, resolution=0.5),
        overflow=BinarySensor(PassFail, one=PassFail.FAIL),
        timer=DigitalSensor("sampling_period", minimum=0.0, maximum=99_999.0, resolution=1.0, synchronous=False),
    )
